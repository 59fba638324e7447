"""The settings, stage by stage: a widget each, made from its declaration."""

from __future__ import annotations

from typing import cast

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.prompts import OF_RENDERS
from irrsplat.app.viewer.ui.layout import READABLE, Layout
from irrsplat.settings import PRESETS, SETTINGS, Declaration, SettingValues, preset

Value = float | int | bool | str

# ends of sliders whose ranges are far wider than usual values; other values are typed (Ctrl+click)
_SPANS: dict[str, tuple[float, float]] = {
    "adapt": (0.0, 2.0),
    "seed": (0, 100),
    "bounces": (0, 16),
    "radius_min": (0.0, 5.0),
    "radius_max": (0.0, 20.0),
    "tolerance": (0.0, 100.0),
    "warmup": (0, 5000),
    "max_records": (1000, 1_000_000),
    "exposure": (-10.0, 10.0),
    "budget": (10.0, 1000.0),
    "viewer_samples": (0, 256),
    "viewer_quality": (0.0, 5.0),
}
_LOGARITHMIC = {
    *("a", "tolerance", "radius_min", "radius_max", "budget", "shadow_size", "gather_size", "warmup", "max_records"),
}
_STAGES = ("shadow", "gather", "splat", "examine", "composite", "view")
_OPEN = ("splat", "examine", "composite")  # stages that are unfolded at first
_TOOLTIP = 28.0  # width of the text, in heights of the font
_COSTLY = ("shadow", "gather")  # stages whose settings make every record anew: their numbers are typed


def draw_settings(actions: Actions, layout: Layout) -> None:
    """Draw all settings of the side that panels change, stage by stage."""
    panels = actions.panels
    for stage in _STAGES:
        if panels.sought and SETTINGS[panels.sought].stage == stage:
            imgui.set_next_item_open(True)
        if imgui.collapsing_header(stage, imgui.TreeNodeFlags_.default_open if stage in _OPEN else 0):
            for declaration in SETTINGS.values():
                if declaration.stage == stage and declaration.name not in OF_RENDERS:
                    draw_setting(actions, layout, declaration)


def draw_sides(actions: Actions) -> None:
    """Draw the choice of the side that panels and keys change."""
    imgui.text("side")
    for side, word in enumerate(("left", "right")):
        imgui.same_line()
        if imgui.radio_button(word, actions.session.options.side == side):
            actions.session.options.side = side


def draw_presets(actions: Actions, layout: Layout) -> None:
    chosen, settings = actions.session.settings(actions.session.options.side)
    differs = any(getattr(settings, name) != getattr(preset(chosen), name) for name in SETTINGS)
    if imgui.begin_combo(layout.label("preset"), f"{chosen}{' *' if differs else ''}"):
        for name in PRESETS:
            if imgui.selectable(name, name == chosen)[0]:
                actions.attempt(lambda name=name: actions.use_preset(name))  # type: ignore[misc]
        imgui.end_combo()
    imgui.set_item_tooltip("all settings at once (*: some differ); paper: the algorithm as published")


def draw_setting(actions: Actions, layout: Layout, d: Declaration) -> None:
    """Draw one line: the widget, its name, and an arrow back to the preset's value where it differs."""
    chosen, settings = actions.session.settings(actions.session.options.side)
    value, base = getattr(settings, d.name), getattr(preset(chosen), d.name)
    imgui.push_id(d.name)
    if d.name == actions.panels.sought:
        imgui.set_scroll_here_y()
        actions.panels.sought = ""
    imgui.begin_group()
    new = _widget(actions, layout, d, value)
    imgui.end_group()
    if imgui.begin_item_tooltip():
        imgui.push_text_wrap_pos(_TOOLTIP * imgui.get_font_size())
        imgui.text_wrapped(d.help)
        imgui.text_disabled(f"{d.flag}  {d.range}; in preset {chosen}: {_in_words(base)}")
        if d.kind in ("int", "float"):
            imgui.text_disabled("Ctrl+click: type a number")
        imgui.pop_text_wrap_pos()
        imgui.end_tooltip()
    if value != base:
        imgui.same_line()
        if imgui.small_button("←"):
            new = base
        imgui.set_item_tooltip(f"back to {_in_words(base)}")
    imgui.pop_id()
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
    if not d.word:
        return _number(d, label, value, width)
    flipped, automatic = imgui.checkbox(d.word, value == d.word)
    width = layout.beside(width, READABLE * layout.scale)
    resolved = _resolved(actions, d)
    if flipped:
        return d.word if automatic else round(resolved, 3)
    imgui.begin_disabled(automatic)
    moved = _number(d, label, resolved if automatic else value, width)
    imgui.end_disabled()
    return value if automatic else moved


def _number(d: Declaration, label: str, value: Value, width: float) -> Value:
    """Draw a slider, or a field to type into where a change makes every record anew; return its value."""
    low, high = _SPANS.get(d.name, (d.low or 0, d.high or 0))
    flags = imgui.SliderFlags_.logarithmic if d.name in _LOGARITHMIC else 0
    imgui.set_next_item_width(width)
    unit = f" {d.unit.replace('%', '%%')}" if d.unit and not d.word else ""
    entered = imgui.InputTextFlags_.enter_returns_true
    now: float
    if d.kind == "int" and d.stage in _COSTLY:
        moved, now = imgui.input_int(label, cast(int, value), 0, 0, entered)
    elif d.kind == "int":
        moved, now = imgui.slider_int(label, cast(int, value), int(low), int(high), f"%d{unit}", flags)
    else:
        moved, now = imgui.slider_float(label, cast(float, value), float(low), float(high), f"%.3g{unit}", flags)
    now = min(max(float(f"{now:.6g}") if d.kind == "float" else now, d.low or 0), d.high or 0)  # imgui's are float32
    return now if moved else value


def _resolved(actions: Actions, d: Declaration) -> float:
    """Return the number that the word of a setting stands for now."""
    session, side = actions.session, actions.session.options.side
    settings = session.settings(side)[1]
    if d.name == "bounces":
        return int(session.renderer(side).scheduler.gatherer.bounces(settings)["bounces"])
    return settings.threshold if d.name == "tolerance" else session.exposure


def _in_words(value: Value) -> str:
    return ("on" if value else "off") if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)
