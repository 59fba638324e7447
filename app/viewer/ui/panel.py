"""The panels of settings and lights: a slider for every setting, made from settings.py, and the scene's lamps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions, Lamp
from irrsplat.settings import PRESETS, SETTINGS, Declaration, preset

WIDTH = 268.0  # of the panels, window coordinates at scale 1
_WIDGET = 128.0
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
}
_LOGARITHMIC = {"a", "tolerance", "radius_min", "radius_max", "budget", "shadow_size", "gather_size", "warmup", "max_records"}
_STAGES = {"shadow": False, "gather": False, "splat": True, "examine": True, "composite": True, "view": False}  # open at first?


class Panel:
    """Draws the panels of a actions; what is being dragged and not yet let go of is kept here."""

    def __init__(self, actions: Actions) -> None:
        self.actions = actions
        self._drafts: dict[str, Any] = {}
        self.floor = 0.0  # window coordinates kept free below the panels

    def settings(self, scale: float) -> None:
        """The window of all settings, stage by stage."""
        actions = self.actions
        if not actions.panels.settings:
            return
        _place(8.0, 30.0, scale, self.floor)
        shown, actions.panels.settings = imgui.begin("settings", True, imgui.WindowFlags_.always_auto_resize)
        if shown:
            if actions.session.options.split == "presets":
                imgui.text("side")
                for side, word in enumerate(("left", "right")):
                    imgui.same_line()
                    if imgui.radio_button(word, actions.side == side):
                        actions.side = side
            self._presets(scale)
            for stage, first in _STAGES.items():
                flags = imgui.TreeNodeFlags_.default_open if first else 0
                if imgui.collapsing_header(stage, flags):
                    for declaration in SETTINGS.values():
                        if declaration.stage == stage:
                            self._setting(declaration, scale)
        imgui.end()

    def _presets(self, scale: float) -> None:
        name, settings = self.actions.session.settings(self.actions.side)
        base = preset(name)
        changed = any(getattr(settings, key) != getattr(base, key) for key in SETTINGS)
        imgui.set_next_item_width(_WIDGET * scale)
        if imgui.begin_combo("preset", name + (" (changed)" if changed else "")):
            for one in PRESETS:
                if imgui.selectable(one, one == name)[0]:
                    self.use(one)
            imgui.end_combo()
        imgui.set_item_tooltip("all settings at once; paper: the algorithm as published (M switches to it and back)")

    def use(self, name: str) -> None:
        """Set the side at hand to a preset."""
        self._drafts.clear()
        self.actions.trying(lambda: self.actions.session.use(self.actions.side, name))

    def _setting(self, declaration: Declaration, scale: float) -> None:
        """One line: the widget, its name, and an arrow back to the preset's value where it differs."""
        d, actions = declaration, self.actions
        chosen, settings = actions.session.settings(actions.side)
        value, base = getattr(settings, d.name), getattr(preset(chosen), d.name)
        imgui.push_id(d.name)
        new = self._widget(d, value, scale)
        imgui.set_item_tooltip(f"{d.help}\n{d.range}; in preset {chosen}: {_word(base)}\n{d.flag}")
        if value != base:
            imgui.same_line()
            if imgui.small_button("←"):
                new = base
            imgui.set_item_tooltip(f"back to {_word(base)}")
        imgui.pop_id()
        if new != value:
            actions.trying(lambda: actions.session.change(actions.side, **{d.name: new}))

    def _widget(self, d: Declaration, value: Any, scale: float) -> Any:
        """The value as the user leaves it; sliders of what is dear to change speak when they are let go of."""
        label = d.name.replace("_", " ")
        if d.kind == "bool":
            return imgui.checkbox(label, value)[1]
        if d.kind == "choice":
            imgui.set_next_item_width(_WIDGET * scale)
            i = imgui.combo(label, d.choices.index(value), list(d.choices))[1]
            return d.choices[i]
        width = _WIDGET * scale
        if d.word:
            flipped, automatic = imgui.checkbox(d.word, value == d.word)
            imgui.set_item_tooltip("chosen by itself")
            imgui.same_line()
            width -= imgui.get_item_rect_size().x + imgui.get_style().item_spacing.x
            resolved = self._resolved(d)
            if flipped:
                return d.word if automatic else round(resolved, 3)
            if automatic:
                imgui.set_next_item_width(width)
                imgui.begin_disabled()
                imgui.slider_float(label, resolved, *_SPANS[d.name], "%.3g")
                imgui.end_disabled()
                return value
        imgui.set_next_item_width(width)
        low, high = _SPANS.get(d.name, (d.low, d.high))
        draft = self._drafts.get(d.name, value)
        flags = imgui.SliderFlags_.logarithmic if d.name in _LOGARITHMIC else 0
        unit = f" {d.unit}".replace("%", "%%") if d.unit else ""
        if d.kind == "int":
            moved, draft = imgui.slider_int(label, int(draft), int(low or 0), int(high or 0), "%d" + unit, flags)
        else:
            moved, draft = imgui.slider_float(label, float(draft), float(low or 0), float(high or 0), "%.3g" + unit, flags)
        if not moved and d.name not in self._drafts:
            return value
        draft = min(max(float(f"{draft:.6g}") if d.kind == "float" else draft, d.low or 0), d.high or 0)  # imgui's are float32
        if d.stage not in ("shadow", "gather") and d.name != "max_records":
            return draft
        self._drafts[d.name] = draft  # what all records are gathered from, or what they go by: not at every pixel of the way
        if imgui.is_item_active():
            return value
        return self._drafts.pop(d.name)

    def _resolved(self, d: Declaration) -> float:
        """What a setting's word stands for at the moment."""
        session = self.actions.session
        _, settings = session.settings(self.actions.side)
        if d.name == "bounces":
            return int(
                session.active[min(self.actions.side, len(session.active) - 1)].scheduler.gatherer.bounces(settings)["bounces"]
            )
        return settings.threshold if d.name == "tolerance" else session.exposure

    # ---- lights ----------------------------------------------------------------------------------------------------

    def lights(self, scale: float) -> None:
        """The window of the scene's lights: pick one, move it, dim it."""
        actions = self.actions
        if not actions.panels.lights:
            return
        _place(8.0 + WIDTH, 30.0, scale, self.floor)
        shown, actions.panels.lights = imgui.begin("lights", True, imgui.WindowFlags_.always_auto_resize)
        if shown:
            if not actions.lamps:
                imgui.text_disabled("the scene has no lights of its own;\nwhat glows and the sky light it")
            for i, lamp in enumerate(actions.lamps):
                title = lamp.light.name or f"light {i + 1}"
                if imgui.selectable(f"{title}  {_kind(lamp)}##{i}", i == actions.lamp)[0]:
                    actions.lamp = i
            if actions.lamp < len(actions.lamps):
                imgui.separator()
                self._lamp(actions.lamps[actions.lamp], scale)
        imgui.end()

    def _lamp(self, lamp: Lamp, scale: float) -> None:
        actions, light, scene = self.actions, lamp.light, self.actions.session.scene
        width = 1.4 * _WIDGET * scale
        changed, lamp.on = imgui.checkbox("on", lamp.on)
        imgui.set_next_item_width(width)
        moved, lamp.stops = imgui.slider_float("stops", lamp.stops, -8.0, 8.0, "%+.2f")
        changed |= moved
        imgui.set_item_tooltip("brighter or dimmer than in the file")
        imgui.set_next_item_width(width)
        step = scene.diagonal / 500.0 if not light.directional else 0.01
        moved, place = imgui.drag_float3("towards" if light.directional else "position", list(light.position), step, 0, 0, "%.3f")
        x, y, z = place
        if moved and (any(place) or not light.directional):
            lamp.light, changed = replace(light, position=(x, y, z)), True
        if light.spot_target is not None:
            imgui.set_next_item_width(width)
            moved, aim = imgui.drag_float3("aims at", list(light.spot_target), step, 0, 0, "%.3f")
            if moved and tuple(aim) != tuple(lamp.light.position):
                lamp.light, changed = replace(lamp.light, spot_target=(aim[0], aim[1], aim[2])), True
        imgui.set_next_item_width(width)
        most = max(*actions.loaded(actions.lamp).light.color, 1e-30)  # so that black is a way back, too
        moved, tint = imgui.color_edit3("colour", [c / most for c in light.color], imgui.ColorEditFlags_.float)
        if moved:
            lamp.light, changed = replace(lamp.light, color=(tint[0] * most, tint[1] * most, tint[2] * most)), True
        if not light.directional:
            if imgui.button("to the eye"):
                lamp.light, changed = replace(lamp.light, position=actions.session.camera.eye), True
            imgui.same_line()
        if imgui.button("as loaded"):
            actions.lamps[actions.lamp] = actions.loaded(actions.lamp)
            changed = True
        if changed:
            actions.relight()


def _kind(lamp: Lamp) -> str:
    if lamp.light.directional:
        return "(directional)"
    return "(point)" if lamp.light.spot_target is None else "(spot)"


def _word(value: Any) -> str:
    return ("on" if value else "off") if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)


def _place(x: float, y: float, scale: float, floor: float) -> None:
    """Where a window is when it is first opened, and how far it may grow; window coordinates at scale 1."""
    view = imgui.get_main_viewport()
    imgui.set_next_window_pos((x * scale, y * scale), imgui.Cond_.first_use_ever)
    imgui.set_next_window_size_constraints((0.0, 0.0), (2.0 * WIDTH * scale, max(view.size.y - y * scale - floor, 40.0)))
