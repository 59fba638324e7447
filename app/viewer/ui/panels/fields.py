"""Widgets of lights and objects: colours in sRGB, and outputs in photometric units."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imgui_bundle import imgui

from irrsplat.app.viewer.editing.photometry import described
from irrsplat.app.viewer.ui.layout import Layout
from irrsplat.core.color import linear_from_srgb, srgb


def edit_colour(label: str, linear: Sequence[float]) -> tuple[bool, tuple[float, float, float]]:
    """Draw the field of a linear colour, with 0..255 and hex values in sRGB. Return True if it was changed, and the colour.

    A component above 1 sets the scale: the field shows the colour relative to the largest component.
    """
    scale = max(1.0, *linear)
    shown = srgb(np.asarray(linear, float) / scale).tolist()
    changed, values = imgui.color_edit3(label, shown)
    red, green, blue = (scale * linear_from_srgb(np.clip(values, 0.0, 1.0))).tolist() if changed else linear
    return changed, (red, green, blue)


def edit_output(layout: Layout, unit: str, value: float, least: float, most: float) -> float | None:
    """Draw a logarithmic slider with the unit as its label; return the new value if the user changed it to one of 0 or more."""
    form = "%.0f" if value >= 1000.0 else "%.4g"  # no powers of ten
    changed, output = imgui.slider_float(layout.label(unit), value, least, most, form, imgui.SliderFlags_.logarithmic)
    imgui.set_item_tooltip(described(unit, value))
    return output if changed and output >= 0.0 else None


def light_digits(value: float | None) -> str:
    """Return a value of light with the digits that a light meter has; "" for None."""
    return "" if value is None else f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"
