"""All light that falls on visible surfaces, in false colours with isolines."""

from __future__ import annotations

import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import GROUND, Canvas, Legend, ShownBuffer, ViewSource, depth_at
from irrsplat.app.viewer.buffers.texture_buffers import irradiance_at
from irrsplat.app.viewer.show.screen import Texels
from irrsplat.meter.light_scale import STEPS, false_colours


class LightBuffer(ShownBuffer):
    """Irradiance or illuminance by the scale that the user has set, whatever the surface reflects."""

    def inputs(self, source: ViewSource) -> object:
        return source.light_scale

    def unit_shown(self, source: ViewSource) -> str:
        return source.light_scale.shown_unit

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        scale, colours = source.light_scale, false_colours()
        low, high = scale.ends
        canvas.picture(
            source,
            "light",
            source.view.sums,
            direct=source.renderer.direct_irradiance(source.view),
            weights=scale.weights,
            low=low,
            high=high,
            steps=float(STEPS) if scale.lines else 0.0,
            ground=GROUND,
            palette=colours,
        )

    def value(self, texels: Texels, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        if not depth_at(texels, source, x, y):
            return None
        direct = texels(source.renderer.direct_irradiance(source.view), x, y)[:3]
        total = direct + irradiance_at(texels, source.view, x, y)
        return np.array([total @ source.light_scale.weights], np.float32)

    def legend(self, source: ViewSource) -> Legend:
        scale = source.light_scale
        low, high = scale.ends
        lines = f"a line every {(high - low) / STEPS:.4g} {scale.shown_unit}" if scale.lines else ""
        return Legend(lines, f"{low:.4g}", f"{high:.4g}", scale.shown_unit, false_colours())
