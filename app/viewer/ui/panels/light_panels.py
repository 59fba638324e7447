"""Sections of the side panel about light in numbers: the measuring plane, and why a point is dark."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.shown_buffer import Legend
from irrsplat.app.viewer.show.display import Display
from irrsplat.app.viewer.show.light.measuring_plane import scene_height
from irrsplat.app.viewer.ui.layout import WHITE, Layout
from irrsplat.app.viewer.ui.legends import draw_scale
from irrsplat.meter.light_scale import STEPS, false_colours
from irrsplat.scene import ray_caster

_MOST_VALUES = 81  # about: values drawn over the picture
_SHADE = (0.0, 0.0, 0.0, 0.8)
_NEARER = 0.999  # share of the way from the eye to a point of the plane: the point itself may lie on a surface


def draw_plane(actions: Actions, layout: Layout) -> None:
    session = actions.session
    plane = session.plane
    height = imgui.slider_float(layout.label("height"), plane.height, 0.0, scene_height(session.scene), "%.4g m")[1]
    imgui.set_item_tooltip("above the lowest point of the scene; Ctrl+click: type it")
    plane.height = max(float(f"{height:.4g}"), 0.0)  # imgui's values are float32
    if plane.share is not None:
        imgui.text_disabled("measuring…" if plane.share == 0.0 else f"measuring: {100.0 * plane.share:.0f} %")
    if (measured := plane.measured) is None:
        return
    scale = measured.scale
    found, (low, high) = measured.readings.summary(scale.unit), scale.ends
    if found["mean"] is not None:
        imgui.text(f"mean {light_digits(found['mean'])} {scale.shown_unit}, at {measured.height:g} m")
        imgui.text(f"{light_digits(found['minimum'])} … {light_digits(found['maximum'])} {scale.shown_unit}")
        if found["uniformity"] is not None:
            imgui.text(f"uniformity {found['uniformity']:.2f} (least/mean)")
    lines = f"a line every {light_digits((high - low) / STEPS)} {scale.shown_unit}"
    legend = Legend(lines, light_digits(low), light_digits(high), scale.shown_unit, false_colours())
    draw_scale(legend, layout.scale, layout.room)


def draw_values(actions: Actions, layout: Layout) -> None:
    """Draw values over the picture at some visible points of the plane."""
    session = actions.session
    measured = session.plane.measured
    if not session.options.plane or not session.views or measured is None:
        return
    readings = measured.readings
    step = int(np.ceil(np.sqrt(max(measured.rows * measured.columns / _MOST_VALUES, 1.0))))
    numbers = np.arange(measured.rows * measured.columns).reshape(measured.rows, measured.columns)
    some = numbers[step // 2 :: step, step // 2 :: step].ravel()
    some = some[readings.counts[some]]
    points, eye = readings.position[some], np.asarray(session.camera.eye)
    if ray_caster.available():
        seen = session.renderers[0].world.caster.free(np.broadcast_to(eye, points.shape), eye + _NEARER * (points - eye))
        some, points = some[seen], points[seen]
    values = readings.total[some] @ measured.scale.weights
    drawn = list[tuple[float, float]]()
    with layout.over_picture() as draw:
        for point, value in zip(points.tolist(), values.tolist(), strict=True):
            place, text = layout.seen(session.camera, point), light_digits(value)
            size = imgui.calc_text_size(text)
            if place is not None and all(abs(place[0] - x) > size.x or abs(place[1] - y) > size.y for x, y in drawn):
                drawn.append(place)
                left, top = place[0] - 0.5 * size.x, place[1] - 0.5 * size.y
                draw.add_text((left + 1.0, top + 1.0), imgui.get_color_u32(_SHADE), text)
                draw.add_text((left, top), imgui.get_color_u32(WHITE), text)


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


def light_digits(value: float | None) -> str:
    """Return a value of light with as many digits as a light meter prints; "" for None."""
    return "" if value is None else f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"
