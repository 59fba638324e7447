"""The panel of all settings, stage by stage: a widget each, made from its declaration."""

from __future__ import annotations

from typing import cast

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.input.idle_settings import BASIC, why_idle
from irrsplat.app.viewer.ui.layout import PANEL_WIDTH, Layout, accent
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
_WIDTH, _NUMBER = 166.0, 62.0  # of a setting's widgets together, and of its number; window coordinates at scale 1
_IDLE = 0.45  # opacity of settings that change nothing
_TOOLTIP = 28.0  # width of the text, in heights of the font
_COSTLY = ("shadow", "gather")  # stages whose settings make every record anew


class SettingsPanel:
    """Draws the settings of the side that panels change; what is being dragged and not yet let go of is kept here."""

    def __init__(self, actions: Actions, layout: Layout) -> None:
        self.actions, self.layout = actions, layout
        self._drafts: dict[str, float | int] = {}
        self._typed: tuple[str, float | int] | None = None  # the setting whose number is being typed, and how it stands
        self.room = 0.0  # for a setting's widgets, where another panel draws some; window coordinates
        self.stacked = False  # whether names are above their widgets
        self._sought = ""  # the setting that is scrolled to

    def show(self, name: str) -> None:
        """Open the panel with all settings, at the one of this name."""
        self.actions.panels.settings = self.actions.panels.expert = True
        self._sought = name

    def draw(self) -> None:
        """Draw it where it is open."""
        actions = self.actions
        if not actions.panels.settings:
            return
        self.layout.place_panel("settings", PANEL_WIDTH, 0.0, tall=True, numbers=actions.panels.hud)
        shown, opened = imgui.begin("settings", True)
        floats = self.layout.keep_inside("settings")
        self.layout.panel_right = imgui.get_window_pos().x + imgui.get_window_width() if floats else 0.0
        actions.panels.settings = bool(opened)
        if shown:
            if actions.session.options.split == "presets":
                self.draw_sides()
            self.draw_presets()
            _, actions.panels.expert = imgui.checkbox("expert settings too", actions.panels.expert)
            for stage, first in _STAGES.items():
                self._stage(stage, first)
        imgui.end()

    def _stage(self, stage: str, first: bool) -> None:
        """Draw the settings of a stage: all of them, or the basic ones and those that differ from the preset."""
        chosen, settings = self.actions.session.settings(self.actions.side)
        base, expert = preset(chosen), self.actions.panels.expert
        shown = [
            d
            for d in SETTINGS.values()
            if d.stage == stage and (expert or d.name in BASIC or getattr(settings, d.name) != getattr(base, d.name))
        ]
        if any(d.name == self._sought for d in shown):
            imgui.set_next_item_open(True)
        title = stage if expert else f"{stage}##basic"  # each has its own state
        if shown and imgui.collapsing_header(title, imgui.TreeNodeFlags_.default_open if first or not expert else 0):
            for declaration in shown:
                self.draw_setting(declaration)

    def draw_sides(self) -> None:
        imgui.text("side")
        for side, word in enumerate(("left", "right")):
            imgui.same_line()
            if imgui.radio_button(word, self.actions.side == side):
                self.actions.side = side

    def draw_presets(self) -> None:
        actions = self.actions
        name, settings = actions.session.settings(actions.side)
        base = preset(name)
        changed = any(getattr(settings, key) != getattr(base, key) for key in SETTINGS)
        shown = name + "*" * changed
        arrow = imgui.get_frame_height() + 2.0 * imgui.get_style().frame_padding.x
        label = self.label("preset")
        imgui.set_next_item_width(self.room or max(self._width, imgui.calc_text_size(shown).x + arrow))
        if imgui.begin_combo(label, shown):
            for one in PRESETS:
                if imgui.selectable(one, one == name)[0]:
                    self._drafts.clear()
                    actions.attempt(lambda one=one: actions.session.use_preset(actions.side, one))  # type: ignore[misc]
            imgui.end_combo()
        imgui.set_item_tooltip("all settings at once (*: some differ); paper: the algorithm as published (M: to it and back)")

    @property
    def _width(self) -> float:
        """Of a setting's widgets together, window coordinates."""
        return self.room or _WIDTH * self.layout.scale

    def draw_setting(self, declaration: Declaration) -> None:
        """Draw one line: the widget, its name, and an arrow back to the preset's value where it differs."""
        d, actions = declaration, self.actions
        chosen, settings = actions.session.settings(actions.side)
        value, base = getattr(settings, d.name), getattr(preset(chosen), d.name)
        idle = why_idle(d.name, settings)
        imgui.push_id(d.name)
        if d.name == self._sought:
            imgui.set_scroll_here_y()
            imgui.set_keyboard_focus_here()
            self._sought = ""
        if idle is not None:
            imgui.push_style_var(imgui.StyleVar_.alpha, _IDLE * imgui.get_style().alpha)
        imgui.begin_group()
        new = self._widget(d, value, base)
        imgui.end_group()
        if idle is not None:
            imgui.pop_style_var()
        if imgui.begin_item_tooltip():
            imgui.push_text_wrap_pos(_TOOLTIP * imgui.get_font_size())
            imgui.text_wrapped(d.help)
            if idle is not None:
                imgui.text_colored(accent(), f"no effect now: {idle}")
            imgui.text_disabled(f"{d.flag}  {d.range}; in preset {chosen}: {_in_words(base)}")
            if d.kind in ("int", "float"):
                imgui.text_disabled("click the number, or Ctrl+click the slider, to type; double-click: as in the preset")
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
            actions.attempt(lambda: actions.session.change(actions.side, **changed))

    def _widget(self, d: Declaration, value: Value, base: Value) -> Value:
        """Draw a setting's widget; the value as the user leaves it."""
        label = self.label(d.name.replace("_", " "))
        if d.kind == "bool":
            return imgui.checkbox(label, bool(value))[1]
        imgui.set_next_item_width(self._width)
        if d.kind == "choice":
            return d.choices[imgui.combo(label, d.choices.index(str(value)), list(d.choices))[1]]
        return self._number_or_word(d, label, value, base) if d.word else self._slider(d, label, value, base, self._width)

    def label(self, name: str) -> str:
        """Return the label of a widget; a name above it is drawn here."""
        if self.stacked:
            imgui.text_unformatted(name)
        return f"##{name}" if self.stacked else name

    def _number_or_word(self, d: Declaration, label: str, value: Value, base: Value) -> Value:
        """Draw a box for the setting's word beside the slider, which shows what the word stands for while it is chosen."""
        flipped, automatic = imgui.checkbox(d.word, value == d.word)
        imgui.same_line()
        width = self._width - imgui.get_item_rect_size().x - imgui.get_style().item_spacing.x
        resolved = self._resolved(d)
        if flipped:
            return d.word if automatic else round(resolved, 3)
        if not automatic:
            return self._slider(d, label, value, base, width)
        imgui.set_next_item_width(width)
        imgui.begin_disabled()
        imgui.slider_float(label, resolved, *_SPANS[d.name], "%.3g")
        imgui.end_disabled()
        return value

    def _slider(self, d: Declaration, label: str, value: Value, base: Value, width: float) -> Value:
        """Draw the number, and a slider beside it; one whose change costs much gives its new value only when it is let go of."""
        gap, wide = imgui.get_style().item_inner_spacing.x, width >= 1.6 * self._number_width
        if wide:
            typed = self._number(d, value)
            if typed is not None:
                self._drafts.pop(d.name, None)
                return typed
            imgui.same_line(0.0, gap)
        imgui.set_next_item_width(max(width - self._number_width - gap, 20.0) if wide else width)
        low, high = _SPANS.get(d.name, (d.low or 0, d.high or 0))
        draft = self._drafts.get(d.name, float(value) if d.kind == "float" else int(value))
        flags = imgui.SliderFlags_.logarithmic if d.name in _LOGARITHMIC else 0
        if d.kind == "int":
            moved, draft = imgui.slider_int(label, int(draft), int(low), int(high), "", flags)
        else:
            moved, draft = imgui.slider_float(label, float(draft), float(low), float(high), "", flags)
        active = imgui.is_item_active()
        if imgui.is_item_hovered() and imgui.is_mouse_double_clicked(0):
            imgui.internal.clear_active_id()  # else the slider would go on to follow the mouse
            self._drafts.pop(d.name, None)
            return base
        if d.unit:
            imgui.same_line(0.0, gap)
            imgui.text_disabled(d.unit)
        if not moved and d.name not in self._drafts:
            return value
        draft = _within(d, draft)
        if d.stage not in _COSTLY and d.name != "max_records":
            return draft
        self._drafts[d.name] = draft
        return value if active else self._drafts.pop(d.name)

    @property
    def _number_width(self) -> float:
        """Of a setting's number, window coordinates."""
        return _NUMBER * self.layout.scale

    def _number(self, d: Declaration, value: Value) -> Value | None:
        """Draw the setting's number to be clicked and typed; the new one once it is entered."""
        shown = self._drafts.get(d.name, value)
        imgui.set_next_item_width(self._number_width)
        typed: float | int
        if d.kind == "int":
            edited, typed = imgui.input_int("##number", int(shown), 0, 0)
        else:
            edited, typed = imgui.input_float("##number", float(shown), 0.0, 0.0, "%.4g")
        if edited:
            self._typed = d.name, typed
        if not imgui.is_item_deactivated_after_edit() or self._typed is None or self._typed[0] != d.name:
            return None
        typed, self._typed = self._typed[1], None
        return _within(d, typed)

    def _resolved(self, d: Declaration) -> float:
        """The number that a setting's word stands for at the moment."""
        session, side = self.actions.session, self.actions.side
        settings = session.settings(side)[1]
        if d.name == "bounces":
            return int(session.renderer(side).scheduler.gatherer.bounces(settings)["bounces"])
        return settings.threshold if d.name == "tolerance" else session.exposure


def _within(d: Declaration, value: float | int) -> float | int:
    """A number of imgui's, which are float32, as the setting takes it."""
    return min(max(float(f"{value:.6g}") if d.kind == "float" else value, d.low or 0), d.high or 0)


def _in_words(value: Value) -> str:
    return ("on" if value else "off") if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)
