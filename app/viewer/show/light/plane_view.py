"""The measuring plane in the picture: false colours with isolines, where no surface hides it."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.app.viewer.show.light.measuring_plane import MeasuredPlane
from irrsplat.app.viewer.show.screen import Region, view_uniforms
from irrsplat.core.color import LUMINANCE
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target, table_texture
from irrsplat.image.view import View
from irrsplat.meter.light_scale import PERCENTILE, STEPS, LightScale, false_colours

_OPACITY = 0.8
_OVER = DrawState(blend="over", depth_clamp=True)


class PlaneView(Owner):
    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.program = Program(ctx, "viewer/markers/plane", "viewer/markers/plane")

    def owned(self) -> tuple[Resource | None, ...]:
        return (self.program,)

    def draw(self, target: Target, view: View, measured: MeasuredPlane, scale: LightScale, region: Region | None) -> None:
        """Draw the plane by a scale with an upper end."""
        readings, plane = measured.readings, measured.plane
        places = np.zeros((len(readings.counts), 4), np.float32)
        places[:, 0], places[:, 1] = scale.place(readings.total @ scale.weights), readings.counts
        texture = table_texture(self.ctx, places.reshape(measured.rows, measured.columns, 4))
        try:
            self.program(
                target,
                mode=moderngl.TRIANGLE_STRIP,
                vertices=4,
                state=_OVER,
                scissor=region,
                **view_uniforms(target, view.gbuffer, view.camera),
                corner=plane.corner,
                u=plane.u,
                v=plane.v,
                places=texture,
                steps=float(STEPS) if scale.lines else 0.0,
                opacity=_OPACITY,
                palette=false_colours(),
            )
        finally:
            texture.release()


def scale_of(measured: MeasuredPlane, scale: LightScale) -> LightScale:
    """Return the scale with an upper end for the plane, its own or a round number."""
    watts = (measured.readings.total @ LUMINANCE)[measured.readings.counts]
    return scale.up_to(float(np.percentile(watts, PERCENTILE)) if len(watts) else 0.0)
