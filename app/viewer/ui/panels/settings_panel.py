"""The settings, stage by stage: a widget each, made from its declaration."""

from __future__ import annotations

from typing import cast

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.prompts import OF_RENDERS
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
_COSTLY = ("shadow", "gather")  # stages whose settings make every record anew: a slider changes them when it is released


class SettingsPanel:
    """Draws the settings of the side that panels change."""

    def __init__(self, actions: Actions, layout: Layout) -> None:
        self.actions, self.layout = actions, layout
        self._draft: tuple[str, float | int] | None = None  # the costly setting whose slider is dragged, and its value there

    def draw(self) -> None:
        panels = self.actions.panels
        for stage in _STAGES:
            if panels.sought and SETTINGS[panels.sought].stage == stage:
                imgui.set_next_item_open(True)
            if imgui.collapsing_header(stage, imgui.TreeNodeFlags_.default_open if stage in _OPEN else 0):
                for declaration in SETTINGS.values():
                    if declaration.stage == stage and declaration.name not in OF_RENDERS:
                        self.draw_setting(declaration)

    def draw_sides(self) -> None:
        """Draw the choice of the side that panels and keys change."""
        imgui.text("side")
        for side, word in enumerate(("left", "right")):
            imgui.same_line()
            if imgui.radio_button(word, self.actions.session.options.side == side):
                self.actions.session.options.side = side

    def draw_presets(self) -> None:
        actions = self.actions
        chosen, settings = actions.session.settings(actions.session.options.side)
        differs = any(getattr(settings, name) != getattr(preset(chosen), name) for name in SETTINGS)
        if imgui.begin_combo(self.layout.label("preset"), f"{chosen}{' *' if differs else ''}"):
            for name in PRESETS:
                if imgui.selectable(name, name == chosen)[0]:
                    actions.attempt(lambda name=name: actions.use_preset(name))  # type: ignore[misc]
            imgui.end_combo()
        imgui.set_item_tooltip("all settings at once (*: some differ); paper: the algorithm as published")

    def draw_setting(self, declaration: Declaration) -> None:
        """Draw one line: the widget, its name, and an arrow back to the preset's value where it differs."""
        d, actions = declaration, self.actions
        chosen, settings = actions.session.settings(actions.session.options.side)
        value, base = getattr(settings, d.name), getattr(preset(chosen), d.name)
        imgui.push_id(d.name)
        if d.name == actions.panels.sought:
            imgui.set_scroll_here_y()
            actions.panels.sought = ""
        imgui.begin_group()
        new = self._widget(d, value)
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

    def _widget(self, d: Declaration, value: Value) -> Value:
        """Draw the widget of a setting; return its value afterwards."""
        label = self.layout.label(d.name.replace("_", " "))
        style = imgui.get_style()
        width = self.layout.widget - imgui.calc_text_size("←").x - 2.0 * style.frame_padding.x - style.item_spacing.x
        if d.kind == "bool":
            return imgui.checkbox(label, bool(value))[1]
        if d.kind == "choice":
            imgui.set_next_item_width(width)
            return d.choices[imgui.combo(label, d.choices.index(str(value)), list(d.choices))[1]]
        if not d.word:
            return self._slider(d, label, value, width)
        flipped, automatic = imgui.checkbox(d.word, value == d.word)
        width = self.layout.beside(width, READABLE * self.layout.scale)
        resolved = self._resolved(d)
        if flipped:
            return d.word if automatic else round(resolved, 3)
        imgui.begin_disabled(automatic)
        moved = self._slider(d, label, resolved if automatic else value, width)
        imgui.end_disabled()
        return value if automatic else moved

    def _slider(self, d: Declaration, label: str, value: Value, width: float) -> Value:
        """Draw a slider; return its value."""
        low, high = _SPANS.get(d.name, (d.low or 0, d.high or 0))
        now = self._draft[1] if self._draft is not None and self._draft[0] == d.name else cast(float, value)
        flags = imgui.SliderFlags_.logarithmic if d.name in _LOGARITHMIC else 0
        imgui.set_next_item_width(width)
        unit = f" {d.unit.replace('%', '%%')}" if d.unit and not d.word else ""
        if d.kind == "int":
            moved, now = imgui.slider_int(label, int(now), int(low), int(high), f"%d{unit}", flags)
        else:
            moved, now = imgui.slider_float(label, float(now), float(low), float(high), f"%.3g{unit}", flags)
        now = min(max(float(f"{now:.6g}") if d.kind == "float" else now, d.low or 0), d.high or 0)  # imgui's are float32
        if d.stage not in _COSTLY and d.name != "max_records":
            return now if moved else value
        if moved and imgui.is_item_active():
            self._draft = d.name, now
        if imgui.is_item_active() or self._draft is None or self._draft[0] != d.name:
            return now if moved and not imgui.is_item_active() else value
        self._draft = None
        return now

    def _resolved(self, d: Declaration) -> float:
        """Return the number that the word of a setting stands for now."""
        session, side = self.actions.session, self.actions.session.options.side
        settings = session.settings(side)[1]
        if d.name == "bounces":
            return int(session.renderer(side).scheduler.gatherer.bounces(settings)["bounces"])
        return settings.threshold if d.name == "tolerance" else session.exposure


def _in_words(value: Value) -> str:
    return ("on" if value else "off") if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)
