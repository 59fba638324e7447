"""Why a point is dark: its light by source, what blocks the others, and sight lines to all of them in the picture."""

from __future__ import annotations

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.ui.layout import AMBER, WHITE, Layout, dot, line
from irrsplat.app.viewer.ui.panels.fields import light_digits
from irrsplat.scene import ray_caster

_BLOCKED = (0.93, 0.36, 0.30, 1.0)


def draw_why(actions: Actions, display: Display) -> None:
    found, surface = display.point_light(), actions.session.options.surface
    if found is None or surface is None:
        here = ray_caster.available()
        imgui.text_wrapped("click on a surface" if here else f"needs the extra embree: {ray_caster.INSTALL}")
        return
    for source in found.sources:
        lit = f"{light_digits(source.lux)} lux" if not source.reason else source.reason
        imgui.text_wrapped(f"{source.name}: {lit}")
    imgui.text_wrapped(f"sky: {100.0 * found.sky_share:.0f} % of the hemisphere, {light_digits(found.sky_lux)} lux")
    imgui.set_item_tooltip("share weighted by the cosine; transparent surfaces count as opaque")
    total = display.light_at(surface[0])
    if total is None:
        imgui.text_disabled("the point is not in view")
        return
    direct = sum(source.lux for source in found.sources) + found.sky_lux
    imgui.separator()
    imgui.text(f"direct: {light_digits(direct)} lux")
    imgui.text(f"indirect: {light_digits(max(total - direct, 0.0))} lux")
    imgui.set_item_tooltip("reflected by other surfaces: what the picture has there, without direct light")


def draw_sight_lines(actions: Actions, display: Display, layout: Layout) -> None:
    """Draw the point and the sight lines."""
    found, session = display.point_light(), actions.session
    surface = session.options.surface
    here = None if found is None or surface is None else layout.seen(session.camera, surface[0])
    if found is None or here is None:
        return
    with layout.over_picture() as draw:
        for source in found.sources:
            line(draw, here, layout.seen(session.camera, source.end), _BLOCKED if source.reason else AMBER)
        dot(draw, here, WHITE)
