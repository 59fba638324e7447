"""The panel of the scale of false colours, there while they are shown."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.ui.layout import READABLE, Layout
from irrsplat.core.color import LUMINOUS_EFFICACY
from irrsplat.meter.readings import Unit

_UNITS: tuple[Unit, ...] = ("lux", "W/m2")
_LEAST, _MOST = 0.01, 1e6  # of the upper end, where the slider goes; others are typed (Ctrl+click)


def light_is_shown(actions: Actions) -> bool:
    """Return True if a side shows light in false colours."""
    session = actions.session
    return bool(session.views) and any(session.options.buffers[side] == "light" for side, _ in session.sides())


def draw_light_scale(actions: Actions, layout: Layout) -> None:
    session, label = actions.session, layout.label
    scale, high = session.options.light_scale, session.light_scale.ends[1]
    units = [replace(scale, unit=unit).shown_unit for unit in _UNITS]
    _, chosen = imgui.combo(label("unit"), _UNITS.index(scale.unit), units)
    if _UNITS[chosen] != scale.unit:
        factor = LUMINOUS_EFFICACY if scale.unit == "W/m2" else 1.0 / LUMINOUS_EFFICACY
        highest = None if scale.highest is None else scale.highest * factor
        scale, high = replace(scale, unit=_UNITS[chosen], highest=highest), high * factor
    maximum = label("maximum")
    flipped, automatic = imgui.checkbox("auto", scale.highest is None)
    imgui.set_item_tooltip("a round number above nearly all that is seen")
    if flipped:
        scale = replace(scale, highest=None if automatic else high)
    imgui.set_next_item_width(layout.beside(layout.widget, READABLE * layout.scale))
    imgui.begin_disabled(scale.highest is None)
    moved, value = imgui.slider_float(maximum, high, _LEAST, _MOST, "%.4g", imgui.SliderFlags_.logarithmic)
    imgui.end_disabled()
    imgui.set_item_tooltip("the upper end of the scale; Ctrl+click: type it")
    if moved and scale.highest is not None and value > 0.0:
        scale = replace(scale, highest=float(f"{value:.6g}"))  # imgui's are float32
    scale = replace(scale, lines=imgui.checkbox("lines", scale.lines)[1])
    imgui.set_item_tooltip("isolines between the steps of the scale")
    session.options.light_scale = scale
