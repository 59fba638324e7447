"""Markers over a buffer: records as discs, the measuring plane, and the pixels of one record."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import Legend, Programs, colour_map, view_uniforms
from irrsplat.app.viewer.show.light.measuring_plane import MeasuredPlane
from irrsplat.core.buffers import Records
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Region, Target, table_texture
from irrsplat.image.view import View
from irrsplat.meter.light_scale import STEPS, false_colours
from irrsplat.records.weight import record_defines, view_radius_uniforms
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings

_OVER = DrawState(blend="over", depth_clamp=True)
_WIDTH = 1.75  # pixels: half the width of a line
_SEGMENTS = 24  # the most straight pieces of a disc: at a radius of 80 pixels their error is 0.7 pixels
_TINT = (0.1, 0.85, 1.0)  # display colour of the pixels to which the inspected record contributes
_OPACITY = 0.8  # opacity of the measuring plane
_SPAN = 0.01, 0.5  # share of a·diagonal: the radii at the ends of the colour scale


class Markers(Owner):
    """The painter of markers over the content of a target, or of a `region` of it, without the parts that surfaces hide."""

    def __init__(self, programs: Programs) -> None:
        ctx = self.ctx = programs.ctx
        self.programs = programs
        self.number = ctx.buffer(reserve=4)  # the number of the record that `contributes` draws

    def owned(self) -> tuple[Resource | None, ...]:
        return (self.number,)

    def discs(
        self, target: Target, view: View, records: Records, settings: Settings, scene: Scene, region: Region | None
    ) -> None:
        """Draw every record as an ellipse of radii a·R in this view, in its tangent plane, coloured by its radius a·R_k."""
        if not records.count:
            return
        low, high = np.log(radius_range(settings, scene))
        uniforms = {
            **self._of_records(target, view, records, settings),
            "colours": self.programs.colours,
            "size": target.size,
            "span": (low, 1.0 / (high - low)),
            "width": _WIDTH,
            "segments": _SEGMENTS,
        }
        program = self.programs("viewer/markers/discs", "viewer/markers/discs", record_defines(settings.gradients))
        self._draw(program, target, uniforms, region, vertices=2 * _SEGMENTS + 2, instances=records.count)

    def _of_records(self, target: Target, view: View, records: Records, settings: Settings) -> dict[str, Any]:
        """Return the uniforms of programs that draw records."""
        radii = view_radius_uniforms(view.camera, view.gbuffer.position.size, settings)
        return {**records.uniforms, **view_uniforms(target, view.gbuffer, view.camera), **radii}

    def _draw(self, program: Program, target: Target, uniforms: dict[str, Any], region: Region | None, **draws: Any) -> None:
        """Draw strips of triangles. Uniforms that the program does not declare are left out."""
        strip, state = moderngl.TRIANGLE_STRIP, _OVER
        program(target, mode=strip, state=state, scissor=region, **{"vertices": 4, **draws}, **program.declared(uniforms))

    def plane(self, target: Target, view: View, measured: MeasuredPlane, region: Region | None) -> None:
        """Draw the measuring plane in false colours with isolines."""
        readings, plane, scale = measured.readings, measured.plane, measured.scale
        places = np.zeros((len(readings.counts), 4), np.float32)
        places[:, 0], places[:, 1] = scale.place(readings.total @ scale.weights), readings.counts
        texture = table_texture(self.ctx, places.reshape(measured.rows, measured.columns, 4))
        uniforms = {
            **view_uniforms(target, view.gbuffer, view.camera),
            "corner": plane.corner,
            "u": plane.u,
            "v": plane.v,
            "places": texture,
            "steps": float(STEPS),
            "opacity": _OPACITY,
            "palette": false_colours(),
        }
        try:
            self._draw(self.programs("viewer/markers/plane", "viewer/markers/plane"), target, uniforms, region)
        finally:
            texture.release()

    def contributes(
        self, target: Target, view: View, records: Records, number: int, settings: Settings, region: Region | None = None
    ) -> None:
        """Tint the pixels that record `number` contributes to, in `region` of the target."""
        uniforms = {**self._of_records(target, view, records, settings), "forward": -view.camera.axes[2], "tint": _TINT}
        self.number.write(np.array([number], "i4").tobytes())
        program = self.programs("viewer/markers/covers", "indirect/splat", record_defines(settings.gradients))
        self._draw(program, target, uniforms, region, numbers=self.number)


def radius_legend(settings: Settings, scene: Scene) -> Legend:
    low, high = radius_range(settings, scene)
    return Legend("radius a·R_k before the view limits it, logarithmic", f"{low:.2g}", f"{high:.2g}", "m", colour_map())


def radius_range(settings: Settings, scene: Scene) -> tuple[float, float]:
    """Return the radii a·R_k in metres at the ends of the colour scale of records."""
    return _SPAN[0] * settings.a * scene.diagonal, _SPAN[1] * settings.a * scene.diagonal
