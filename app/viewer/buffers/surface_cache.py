"""The surface cache, looked up at every pixel: irradiance of all bounces but the last."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import Canvas, Identity, Legend, ShownBuffer, ViewSource, depth_at
from irrsplat.app.viewer.buffers.texture_buffers import draw_irradiance, exposed_white
from irrsplat.app.viewer.show.screen import Texels

NO_SURFACE_CACHE = "no surface cache: it is made for more than one bounce"


class SurfaceCacheBuffer(ShownBuffer):
    """The cache's irradiance as a white surface reflects it."""

    def inputs(self, source: ViewSource) -> object:
        surface = source.renderer.scheduler.gatherer.surface_now
        return None if surface is None else Identity(surface.result)

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        found = looked_up(source)
        if found is None:
            canvas.blank()
        else:
            draw_irradiance(canvas, source, found)

    def value(self, texels: Texels, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        found = looked_up(source)
        return texels(found, x, y)[:3] if found is not None and depth_at(texels, source, x, y) else None

    def legend(self, source: ViewSource) -> Legend:
        if looked_up(source) is None:
            return Legend(NO_SURFACE_CACHE)
        return Legend(exposed_white(self.unit, source), unit=self.unit)


def looked_up(source: ViewSource) -> moderngl.Texture | None:
    """The texture of a lookup at every pixel of the view; None where there is no cache."""
    return source.renderer.scheduler.gatherer.surface_at(source.view.gbuffer)
