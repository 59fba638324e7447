"""The panel of the scene's lights: pick one, move it, dim it; and where they are in the picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.lamps import Lamp
from irrsplat.app.viewer.ui.layout import AMBER, WIDGET_WIDTH, Layout

_OFF, _SHADE = (0.5, 0.5, 0.5, 1.0), (0.0, 0.0, 0.0, 0.7)  # colours of a lamp that is off, and around any


class LightsPanel:
    """Draws the lights' panel, and the lights in the picture while it is open."""

    def __init__(self, actions: Actions, layout: Layout) -> None:
        self.actions, self.layout = actions, layout

    def draw(self) -> None:
        """Draw the panel where it is open."""
        actions, lamps = self.actions, self.actions.lamps
        if not actions.panels.lights:
            return
        self.layout.place_panel(1)
        shown, opened = imgui.begin("lights", True, imgui.WindowFlags_.always_auto_resize)
        actions.panels.lights = bool(opened)
        if shown:
            if not lamps.all:
                imgui.text_disabled("the scene has no lights of its own;\nwhat glows and the sky light it")
            for i, lamp in enumerate(lamps.all):
                title = lamp.light.name or f"light {i + 1}"
                if imgui.selectable(f"{title}  ({lamp.light.kind})##{i}", i == lamps.selected)[0]:
                    lamps.selected = i
            if lamps.selected < len(lamps.all):
                imgui.separator()
                if self._edit(lamps.all[lamps.selected]):
                    actions.relight()
        imgui.end()

    def _edit(self, lamp: Lamp) -> bool:
        """Draw the widgets of a lamp; whether one has changed it."""
        session, lamps, light = self.actions.session, self.actions.lamps, lamp.light
        width = 1.4 * WIDGET_WIDTH * self.layout.scale
        changed, lamp.on = imgui.checkbox("on", lamp.on)
        imgui.set_next_item_width(width)
        moved, lamp.stops = imgui.slider_float("stops", lamp.stops, -8.0, 8.0, "%+.2f")
        changed |= moved
        imgui.set_item_tooltip("brighter or dimmer than in the file")
        imgui.set_next_item_width(width)
        step = session.scene.diagonal / 500.0 if not light.directional else 0.01
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
        brightest = max(*lamps.as_loaded(lamps.selected).light.color, 1e-30)  # as loaded, so that black is no dead end
        moved, tint = imgui.color_edit3("colour", [c / brightest for c in light.color], imgui.ColorEditFlags_.float)
        if moved:
            color = (tint[0] * brightest, tint[1] * brightest, tint[2] * brightest)
            lamp.light, changed = replace(light, color=color), True
        if not light.directional:
            if imgui.button("to the eye"):
                lamp.light, changed = replace(light, position=session.camera.eye), True
            imgui.same_line()
        if imgui.button("as loaded"):
            lamps.reset(lamps.selected)
            changed = True
        return changed

    def draw_positions(self) -> None:
        """Draw a ring where each light is, while the panel is open; the one picked is filled."""
        session, lamps = self.actions.session, self.actions.lamps
        if not self.actions.panels.lights:
            return
        camera, view = session.camera, imgui.get_main_viewport()
        draw = imgui.get_background_draw_list()
        for i, lamp in enumerate(lamps.all):
            if lamp.light.directional:
                continue
            x, y, z = camera.axes @ (np.asarray(lamp.light.position) - np.asarray(camera.eye))
            if z >= 0.0:
                continue
            per_metre = view.size.y / camera.screen / -z
            place = (0.5 * view.size.x + x * per_metre, 0.5 * view.size.y - y * per_metre)
            colour = imgui.get_color_u32(AMBER if lamp.on else _OFF)
            draw.add_circle(place, 9.0, imgui.get_color_u32(_SHADE), 0, 4.0)
            draw.add_circle(place, 9.0, colour, 0, 2.0)
            if i == lamps.selected:
                draw.add_circle_filled(place, 5.0, colour)
