"""Markers over a buffer: records as discs, the measuring plane, and the pixels of one record."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import Canvas, Identity, Legend, Picture, Programs, colour_map, view_uniforms
from irrsplat.app.viewer.show.light.measuring_plane import MeasuredPlane
from irrsplat.core.buffers import Records, Uniforms
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target, table_texture
from irrsplat.image.view import View
from irrsplat.meter.light_scale import STEPS, false_colours
from irrsplat.records.culling import reaching
from irrsplat.records.record_cache import RecordCache
from irrsplat.records.weight import record_defines, view_radius_uniforms
from irrsplat.settings import Settings

_OVER = DrawState(blend="over", depth_clamp=True)
_LAYER = DrawState(blend="premultiplied")
_CLIPPED = replace(_LAYER, depth_clamp=True, clip_planes=1)
_WIDTH = 1.75  # pixels: half the width of a line
_SEGMENTS = 24  # the most straight pieces of a disc: at a radius of 80 pixels their error is 0.7 pixels
_TINT = (0.1, 0.85, 1.0)  # display colour of the pixels to which the inspected record contributes
_OPACITY = 0.8  # opacity of the measuring plane
_SPAN = 0.01, 0.5  # share of a·extent: the radii at the ends of the colour scale


class _Layer(Owner):
    """A side's discs of the first `count` records, in `new`. While changed records renew them, all earlier ones are in `old`."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.old, self.new = self.own(Picture(ctx, size, alpha="A")), self.own(Picture(ctx, size, alpha="A"))
        self.count, self.revision, self.renews, self._of = 0, 0, False, cast(object, None)

    def begin(self, of: object, cache: RecordCache) -> None:
        """Begin again for another view, and for changed records once all discs are drawn. of: the view and its settings."""
        if of != self._of or (self.count >= cache.count and self.revision != cache.revision):
            self.old, self.new, self.renews = self.new, self.old, of == self._of
            self.new.clear()
            self.count, self.revision, self._of = 0, cache.revision, of


class Markers(Owner):
    """The painter of markers over the content of a canvas, without the parts that surfaces hide."""

    def __init__(self, programs: Programs) -> None:
        self.ctx, self.programs = programs.ctx, programs
        self.numbers = self.own(self.ctx.buffer(reserve=4))  # of the records that are drawn
        self._layers = self.own(Workshop())

    def discs(
        self, canvas: Canvas, view: View, cache: RecordCache, settings: Settings, extent: float, side: int, most: int
    ) -> bool:
        """Draw every record as an ellipse of radii a·R in this view, in its tangent plane, coloured by its radius a·R_k.

        extent: the scene's, in metres, for the colours. most: the greatest number of discs that a call adds to those of the last
        call. Return True if all records have one.
        """
        target = canvas.target
        layer = self._layers.get(f"side {side}", target.size, lambda: _Layer(self.ctx, target.size))
        layer.begin((Identity(view.gbuffer), Identity(cache), settings, canvas.region), cache)
        numbers = reaching(cache, layer.count, view.camera, view.gbuffer.position.size, settings)
        chosen, (low, high) = numbers[:most].astype("i4"), np.log(radius_range(settings, extent))
        if len(chosen):
            uniforms = {"size": target.size, "span": (low, 1.0 / (high - low)), "width": _WIDTH, "segments": _SEGMENTS}
            uniforms |= {**self._of_records(target, view, cache.records, settings), "colours": self.programs.colours}
            program = self.programs("viewer/markers/discs", "viewer/markers/discs", record_defines(settings.gradients))
            below = replace(canvas, target=layer.new)
            self._draw(program, below, uniforms, chosen, state=_CLIPPED, vertices=2 * _SEGMENTS + 2)
        layer.count = cache.count if len(chosen) == len(numbers) else int(chosen[-1]) + 1
        layer.renews &= layer.count < cache.count
        shown = {"part_0": (layer.old if layer.renews else layer.new).textures[0], "start": (0, 0)}
        self._draw(self.programs("lib/place"), canvas, shown, state=_LAYER)
        return layer.count >= cache.count and layer.revision == cache.revision

    def _of_records(self, target: Target, view: View, records: Records, settings: Settings) -> Uniforms:
        radii = view_radius_uniforms(view.camera, view.gbuffer.position.size, settings)
        return {**records.uniforms, **view_uniforms(target, view.gbuffer, view.camera), **radii}

    def _draw(self, program: Program, canvas: Canvas, uniforms: Uniforms, numbers: Any = None, **draws: Any) -> None:
        """Draw a strip of triangles, or one for each of the records of these `numbers`; with the uniforms that are declared."""
        if numbers is not None:
            self.numbers.orphan(numbers.nbytes)
            self.numbers.write(numbers)
            draws |= {"instances": len(numbers), "numbers": self.numbers}
        whole = {"mode": moderngl.TRIANGLE_STRIP, "state": _OVER, "vertices": 4, **draws}
        program(canvas.target, scissor=canvas.region, **whole, **program.declared(uniforms))

    def plane(self, canvas: Canvas, view: View, measured: MeasuredPlane) -> None:
        """Draw the measuring plane in false colours with isolines."""
        readings, plane, scale = measured.readings, measured.plane, measured.scale
        places = np.zeros((len(readings.counts), 4), np.float32)
        places[:, 0], places[:, 1] = scale.place(readings.total @ scale.weights), readings.counts
        texture = table_texture(self.ctx, places.reshape(measured.rows, measured.columns, 4))
        uniforms = {
            **view_uniforms(canvas.target, view.gbuffer, view.camera),
            "corner": plane.corner,
            "u": plane.u,
            "v": plane.v,
            "places": texture,
            "steps": float(STEPS),
            "opacity": _OPACITY,
            "palette": false_colours(),
        }
        try:
            self._draw(self.programs("viewer/markers/plane", "viewer/markers/plane"), canvas, uniforms)
        finally:
            texture.release()

    def contributes(self, canvas: Canvas, view: View, records: Records, number: int, settings: Settings) -> None:
        """Tint the pixels that record `number` contributes to."""
        uniforms = {**self._of_records(canvas.target, view, records, settings), "forward": -view.camera.axes[2], "tint": _TINT}
        program = self.programs("viewer/markers/covers", "indirect/splat", record_defines(settings.gradients))
        self._draw(program, canvas, uniforms, np.array([number], "i4"))


def radius_legend(settings: Settings, extent: float) -> Legend:
    low, high = radius_range(settings, extent)
    return Legend("radius a·R_k before the view limits it, logarithmic", f"{low:.2g}", f"{high:.2g}", "m", colour_map())


def radius_range(settings: Settings, extent: float) -> tuple[float, float]:
    """Return the radii a·R_k in metres at the ends of the colour scale of records, for a scene of this extent."""
    return _SPAN[0] * settings.a * extent, _SPAN[1] * settings.a * extent
