"""The slider of a light's output in a photometric unit."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.editing.photometry import described
from irrsplat.app.viewer.ui.layout import Layout


def edit_output(layout: Layout, unit: str, value: float, least: float, most: float) -> float | None:
    """Draw a logarithmic slider with the unit as its label; return the new value if the user changed it to one of 0 or more."""
    form = "%.0f" if value >= 1000.0 else "%.4g"  # no powers of ten
    changed, output = imgui.slider_float(layout.label(unit), value, least, most, form, imgui.SliderFlags_.logarithmic)
    imgui.set_item_tooltip(described(unit, value))
    return output if changed and output >= 0.0 else None
