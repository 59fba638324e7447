"""The panel of the measuring plane: its height, its summary and its scale; and its values over the picture."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.buffers.shown_buffer import Legend
from irrsplat.app.viewer.ui.layout import WHITE, Layout
from irrsplat.app.viewer.ui.legends import draw_scale
from irrsplat.app.viewer.ui.panels.fields import light_digits
from irrsplat.meter.light_scale import STEPS, false_colours
from irrsplat.scene import ray_caster

_MOST_VALUES = 81  # over the picture, about
_SHADE = (0.0, 0.0, 0.0, 0.8)
_NEARER = 0.999  # of the way from the eye to a point of the plane, which may lie on a surface


def draw_plane(actions: Actions, layout: Layout) -> None:
    session = actions.session
    plane, top = session.plane, float(np.ptp(session.scene.corners @ np.asarray(session.scene.up)))
    height = imgui.slider_float(layout.label("height"), plane.height, 0.0, top, "%.2f m")[1]
    imgui.set_item_tooltip("above the lowest point of the scene; Ctrl+click: type it")
    plane.height = max(round(height, 3), 0.0)
    if plane.share is not None:
        imgui.text_disabled("measuring…" if plane.share == 0.0 else f"measuring: {100.0 * plane.share:.0f} %")
    if (measured := plane.measured) is None:
        return
    scale = measured.scaled(session.options.light_scale)
    found, (low, high) = measured.readings.summary(scale.unit), scale.ends
    if found["mean"] is not None:
        imgui.text(f"mean {light_digits(found['mean'])} {scale.shown_unit}, at {measured.height:.2f} m")
        imgui.text(f"{light_digits(found['minimum'])} … {light_digits(found['maximum'])} {scale.shown_unit}")
        if found["uniformity"] is not None:
            imgui.text(f"uniformity {found['uniformity']:.2f} (least/mean)")
    lines = f"a line every {light_digits((high - low) / STEPS)} {scale.shown_unit}" if scale.lines else ""
    legend = Legend(lines, light_digits(low), light_digits(high), scale.shown_unit, false_colours())
    draw_scale(legend, layout.scale, layout.room)


def draw_values(actions: Actions, layout: Layout) -> None:
    """Draw values over the picture at some of the points of the plane that are seen."""
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
    values = readings.total[some] @ session.options.light_scale.weights
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
