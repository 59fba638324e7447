"""Why a point is dark: its light by source, what blocks the others, and sight lines to all of them in the picture."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.shown_buffer import Identity
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.show.light.why_dark import PointLight, light_at
from irrsplat.app.viewer.ui.layout import AMBER, WHITE, Layout
from irrsplat.core.memo import Memo
from irrsplat.scene import ray_caster

_SHADE = (0.0, 0.0, 0.0, 0.55)
_BLOCKED = (0.93, 0.36, 0.30, 1.0)


class WhyPanel:
    def __init__(self, actions: Actions, display: Display, layout: Layout) -> None:
        self.actions, self.display, self.layout = actions, display, layout
        self._memo = Memo()

    def _light(self) -> PointLight | None:
        session = self.actions.session
        if not session.options.why or session.options.surface is None or not session.views or not ray_caster.available():
            return None
        renderer, surface = session.renderers[0], session.options.surface
        known = Identity(renderer.scene), surface
        return self._memo.get("light", known, lambda: light_at(renderer.scene, renderer.world.caster, *surface))

    def draw(self) -> None:
        found, surface = self._light(), self.actions.session.options.surface
        if found is None or surface is None:
            here = ray_caster.available()
            imgui.text_wrapped("click on a surface" if here else f"needs the extra embree: {ray_caster.INSTALL}")
            return
        for source in found.sources:
            lit = f"{_lux(source.lux)} lux" if not source.reason else source.reason
            imgui.text_wrapped(f"{source.name}: {lit}")
        imgui.text_wrapped(f"sky: {100.0 * found.sky_share:.0f} % of the hemisphere, {_lux(found.sky_lux)} lux")
        imgui.set_item_tooltip("share weighted by the cosine; transparent surfaces count as opaque")
        total = self.display.light_at(surface[0])
        if total is None:
            imgui.text_disabled("the point is not in view")
            return
        direct = sum(source.lux for source in found.sources) + found.sky_lux
        imgui.separator()
        imgui.text(f"direct: {_lux(direct)} lux")
        imgui.text(f"indirect: {_lux(max(total - direct, 0.0))} lux")
        imgui.set_item_tooltip("reflected by other surfaces: what the picture has there, without direct light")

    def draw_lines(self) -> None:
        """Draw the point and the sight lines."""
        found, session = self._light(), self.actions.session
        surface = session.options.surface
        here = None if found is None or surface is None else self.layout.seen(session.camera, surface[0])
        if found is None or here is None:
            return
        with self.layout.over_picture() as draw:
            for source in found.sources:
                there = self.layout.seen(session.camera, source.end)
                if there is not None:
                    draw.add_line(here, there, imgui.get_color_u32(_SHADE), 3.0)
                    draw.add_line(here, there, imgui.get_color_u32(_BLOCKED if source.reason else AMBER), 1.5)
            draw.add_circle_filled(here, 6.0, imgui.get_color_u32(_SHADE))
            draw.add_circle_filled(here, 4.0, imgui.get_color_u32(WHITE))


def _lux(value: float) -> str:
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"
