"""The panel of all settings, stage by stage: a widget each, made from its declaration."""

from __future__ import annotations

from typing import cast

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.ui.layout import WIDGET_WIDTH, Layout
from irrsplat.settings import PRESETS, SETTINGS, Declaration, SettingValues, preset

Value = float | int | bool | str

# where a slider goes, of ranges that are far wider than what is used; other values are typed (Ctrl+click)
_SPANS: dict[str, tuple[float, float]] = {
    "adapt": (0.0, 2.0),
    "seed": (0, 100),
    "bounces": (0, 16),
    "radius_min": (0.0, 5.0),
    "radius_max": (0.0, 20.0),
    "tolerance": (0.0, 100.0),
    "warmup": (0, 5000),
    "max_rounds": (1, 200),
    "max_records": (1000, 1_000_000),
    "exposure": (-10.0, 10.0),
    "budget": (10.0, 1000.0),
    "samples": (1, 256),
    "viewer_samples": (0, 256),
    "quality": (0.0, 5.0),
    "viewer_quality": (0.0, 5.0),
}
_LOGARITHMIC = {
    *("a", "tolerance", "radius_min", "radius_max", "budget", "shadow_size", "gather_size", "warmup", "max_records"),
    "texture_memory",
}
_STAGES = {  # open at first?
    "shadow": False,
    "gbuffer": False,
    "gather": False,
    "splat": True,
    "examine": True,
    "composite": True,
    "view": False,
}
_COSTLY = ("shadow", "gather")  # stages whose settings make every record anew


class SettingsPanel:
    """Draws the settings of the side that panels change; what is being dragged and not yet let go of is kept here."""

    def __init__(self, actions: Actions, layout: Layout) -> None:
        self.actions, self.layout = actions, layout
        self._drafts: dict[str, float | int] = {}

    def draw(self) -> None:
        """Draw it where it is open."""
        actions = self.actions
        if not actions.panels.settings:
            return
        self.layout.place_panel(0)
        shown, opened = imgui.begin("settings", True, imgui.WindowFlags_.always_auto_resize)
        actions.panels.settings = bool(opened)
        if shown:
            if actions.session.options.split == "presets":
                self._sides()
            self._presets()
            for stage, first in _STAGES.items():
                if imgui.collapsing_header(stage, imgui.TreeNodeFlags_.default_open if first else 0):
                    for declaration in SETTINGS.values():
                        if declaration.stage == stage:
                            self._setting(declaration)
        imgui.end()

    def _sides(self) -> None:
        imgui.text("side")
        for side, word in enumerate(("left", "right")):
            imgui.same_line()
            if imgui.radio_button(word, self.actions.side == side):
                self.actions.side = side

    def _presets(self) -> None:
        actions = self.actions
        name, settings = actions.session.settings(actions.side)
        base = preset(name)
        changed = any(getattr(settings, key) != getattr(base, key) for key in SETTINGS)
        shown = name + (" (changed)" if changed else "")
        arrow = imgui.get_frame_height() + 2.0 * imgui.get_style().frame_padding.x
        imgui.set_next_item_width(max(self._width, imgui.calc_text_size(shown).x + arrow))
        if imgui.begin_combo("preset", shown):
            for one in PRESETS:
                if imgui.selectable(one, one == name)[0]:
                    self._drafts.clear()
                    actions.attempt(lambda one=one: actions.session.use_preset(actions.side, one))  # type: ignore[misc]
            imgui.end_combo()
        imgui.set_item_tooltip("all settings at once; paper: the algorithm as published (M switches to it and back)")

    @property
    def _width(self) -> float:
        """Of a widget, window coordinates."""
        return WIDGET_WIDTH * self.layout.scale

    def _setting(self, declaration: Declaration) -> None:
        """Draw one line: the widget, its name, and an arrow back to the preset's value where it differs."""
        d, actions = declaration, self.actions
        chosen, settings = actions.session.settings(actions.side)
        value, base = getattr(settings, d.name), getattr(preset(chosen), d.name)
        imgui.push_id(d.name)
        new = self._widget(d, value)
        imgui.set_item_tooltip(f"{d.help}\n{d.range}; in preset {chosen}: {_in_words(base)}\n{d.flag}")
        if value != base:
            imgui.same_line()
            if imgui.small_button("←"):
                new = base
            imgui.set_item_tooltip(f"back to {_in_words(base)}")
        imgui.pop_id()
        if new != value:
            changed = cast(SettingValues, {d.name: new})
            actions.attempt(lambda: actions.session.change(actions.side, **changed))

    def _widget(self, d: Declaration, value: Value) -> Value:
        """Draw a setting's widget; the value as the user leaves it."""
        label = d.name.replace("_", " ")
        if d.kind == "bool":
            return imgui.checkbox(label, bool(value))[1]
        imgui.set_next_item_width(self._width)
        if d.kind == "choice":
            return d.choices[imgui.combo(label, d.choices.index(str(value)), list(d.choices))[1]]
        return self._number_or_word(d, label, value) if d.word else self._slider(d, label, value, self._width)

    def _number_or_word(self, d: Declaration, label: str, value: Value) -> Value:
        """Draw a box for the setting's word beside the slider, which shows what the word stands for while it is chosen."""
        flipped, automatic = imgui.checkbox(d.word, value == d.word)
        imgui.set_item_tooltip("chosen by itself")
        imgui.same_line()
        width = self._width - imgui.get_item_rect_size().x - imgui.get_style().item_spacing.x
        resolved = self._resolved(d)
        if flipped:
            return d.word if automatic else round(resolved, 3)
        if not automatic:
            return self._slider(d, label, value, width)
        imgui.set_next_item_width(width)
        imgui.begin_disabled()
        imgui.slider_float(label, resolved, *_SPANS[d.name], "%.3g")
        imgui.end_disabled()
        return value

    def _slider(self, d: Declaration, label: str, value: Value, width: float) -> Value:
        """Draw a slider; one whose change costs much gives its new value only when it is let go of."""
        imgui.set_next_item_width(width)
        low, high = _SPANS.get(d.name, (d.low or 0, d.high or 0))
        draft = self._drafts.get(d.name, float(value) if d.kind == "float" else int(value))
        flags = imgui.SliderFlags_.logarithmic if d.name in _LOGARITHMIC else 0
        unit = f" {d.unit}".replace("%", "%%") if d.unit else ""
        if d.kind == "int":
            moved, draft = imgui.slider_int(label, int(draft), int(low), int(high), "%d" + unit, flags)
        else:
            moved, draft = imgui.slider_float(label, float(draft), float(low), float(high), "%.3g" + unit, flags)
        if not moved and d.name not in self._drafts:
            return value
        draft = min(max(float(f"{draft:.6g}") if d.kind == "float" else draft, d.low or 0), d.high or 0)  # imgui's are float32
        if d.stage not in _COSTLY and d.name != "max_records":
            return draft
        self._drafts[d.name] = draft
        return value if imgui.is_item_active() else self._drafts.pop(d.name)

    def _resolved(self, d: Declaration) -> float:
        """The number that a setting's word stands for at the moment."""
        session, side = self.actions.session, self.actions.side
        settings = session.settings(side)[1]
        if d.name == "bounces":
            return int(session.renderer(side).scheduler.gatherer.bounces(settings)["bounces"])
        return settings.threshold if d.name == "tolerance" else session.exposure


def _in_words(value: Value) -> str:
    return ("on" if value else "off") if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)
