"""The settings, stage by stage. The widget of each setting is made from its declaration."""

from __future__ import annotations

from typing import cast

from imgui_bundle import imgui, imgui_ctx

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.prompts import OF_RENDERS
from irrsplat.app.viewer.session import overrides
from irrsplat.app.viewer.ui.layout import Layout
from irrsplat.settings import PRESETS, SETTINGS, Declaration, SettingValues, preset

Value = float | int | bool | str

SLIDERS: dict[str, tuple[float, float]] = {  # the first settings, and the ends of their sliders; the user types other values
    "a": (0.01, 2.0),
    "tolerance": (0.01, 100.0),
    "blend": (0.0, 1.0),
    "exposure": (-10.0, 10.0),
}
_LOGARITHMIC = ("a", "tolerance")
_STEP = 0.01  # share of a value by which a drag of one pixel changes it
_STAGES = ("shadow", "gather", "splat", "examine", "composite", "view")
_OPEN = ("splat", "examine", "composite")  # stages that start unfolded
_TOOLTIP = 28.0  # font heights: the width of a tooltip's text


def draw_settings(actions: Actions, layout: Layout) -> None:
    """Draw all settings of the side that panels change, stage by stage."""
    sought = actions.panels.sought
    for stage in _STAGES:
        if sought and SETTINGS[sought].stage == stage:
            imgui.set_next_item_open(True)
        if imgui.collapsing_header(stage, imgui.TreeNodeFlags_.default_open if stage in _OPEN else 0):
            for declaration in SETTINGS.values():
                if declaration.stage == stage and declaration.name not in OF_RENDERS:
                    draw_setting(actions, layout, declaration)


def draw_presets(actions: Actions, layout: Layout) -> None:
    options = actions.session.options
    renderer = actions.session.renderer(options.side)
    chosen, differs = renderer.preset, bool(overrides(renderer.preset, renderer.settings))
    name = f"preset {('left', 'right')[options.side]}" if options.split else "preset"
    if imgui.begin_combo(layout.label(name), f"{chosen}{' *' if differs else ''}"):
        for name in PRESETS:
            if imgui.selectable(name, name == chosen)[0]:
                actions.attempt(lambda name=name: actions.use_preset(name))  # type: ignore[misc]
        imgui.end_combo()
    imgui.set_item_tooltip("all settings at once (*: some differ); paper: the algorithm as published")


def draw_setting(actions: Actions, layout: Layout, d: Declaration) -> None:
    """Draw the line of a setting: its widget, its name, and an arrow back to its word (such as auto) or the preset's value."""
    renderer = actions.session.renderer(actions.session.options.side)
    value, base = getattr(renderer.settings, d.name), getattr(preset(renderer.preset), d.name)
    with imgui_ctx.push_id(d.name):
        if d.name == actions.panels.sought:
            imgui.set_scroll_here_y()
            actions.panels.sought = ""
        with imgui_ctx.begin_group():
            new = _widget(actions, layout, d, value)
        if imgui.begin_item_tooltip():
            with imgui_ctx.push_text_wrap_pos(_TOOLTIP * imgui.get_font_size()):
                imgui.text_wrapped(d.help)
                imgui.text_disabled(f"{d.flag}  {d.range}; in preset {renderer.preset}: {_in_words(base)}")
                if d.kind in ("int", "float"):
                    imgui.text_disabled("Ctrl+click: type a number")
            imgui.end_tooltip()
        back = d.word if d.word and value != d.word else base
        if value != back:
            imgui.same_line()
            if imgui.small_button("←"):
                new = back
            imgui.set_item_tooltip(f"back to {_in_words(back)}")
    if new != value:
        changed = cast(SettingValues, {d.name: new})
        actions.attempt(lambda: actions.session.change(actions.session.options.side, **changed))


def _widget(actions: Actions, layout: Layout, d: Declaration, value: Value) -> Value:
    """Draw the widget of a setting; return its value afterwards."""
    label = layout.label(d.name.replace("_", " "))
    style = imgui.get_style()
    width = layout.widget - imgui.calc_text_size("←").x - 2.0 * style.frame_padding.x - style.item_spacing.x
    if d.kind == "bool":
        return imgui.checkbox(label, bool(value))[1]
    if d.kind == "choice":
        imgui.set_next_item_width(width)
        return d.choices[imgui.combo(label, d.choices.index(str(value)), list(d.choices))[1]]
    number = _resolved(actions, d) if value == d.word else cast(float, value)
    moved, now = _number(d, label, number, f" ({d.word})" if value == d.word else "", width)
    return now if moved else value


def _number(d: Declaration, label: str, number: float, word: str, width: float) -> tuple[bool, float]:
    """Draw a slider for a setting of SLIDERS, and a field to drag or to type into for any other setting.

    Return True if the user changed the number, and the number. word: text behind the number.
    """
    least, most = d.low or 0, d.high or 0
    imgui.set_next_item_width(width)
    unit = (f" {d.unit}" if d.unit and not d.word else word).replace("%", "%%")
    if d.name in SLIDERS:
        flags = imgui.SliderFlags_.logarithmic if d.name in _LOGARITHMIC else 0
        moved, now = imgui.slider_float(label, number, *SLIDERS[d.name], f"%.3g{unit}", flags)
    elif d.kind == "int":
        moved, now = imgui.drag_int(label, int(number), max(_STEP * abs(number), 0.1), int(least), int(most), f"%d{unit}")
    else:
        moved, now = imgui.drag_float(label, number, max(_STEP * abs(number), 0.001), least, most, f"%.3g{unit}")
    return moved, min(max(float(f"{now:.6g}") if d.kind == "float" else now, least), most)  # imgui's values are float32


def _resolved(actions: Actions, d: Declaration) -> float:
    """Return the number that the word of a setting (such as auto) means now."""
    renderer = actions.session.renderer(actions.session.options.side)
    if d.name == "bounces":
        return int(renderer.scheduler.gatherer.bounces(renderer.settings)["bounces"])
    return renderer.settings.threshold if d.name == "tolerance" else actions.session.auto_exposure.stops


def _in_words(value: Value) -> str:
    return ("on" if value else "off") if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)
