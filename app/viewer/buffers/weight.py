"""The sum of the records' weights at a pixel, and the pixels that request a record."""

from __future__ import annotations

import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import Canvas, Legend, ViewSource, colour_map
from irrsplat.app.viewer.buffers.texture_buffers import TextureBuffer
from irrsplat.settings import Settings

_DECADES = 50.0  # the scale goes so far above and below 1/a: Σw is 0, or at least 1/a
_NO_TOLERANCE = -1.0  # which no weight is below


class WeightBuffer(TextureBuffer):
    """Σw on a logarithmic scale, with the contour of the threshold."""

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        low, high = weight_range(source.settings)
        canvas.picture(source, "weight", self.texture(source.view), low=low, high=high, threshold=source.settings.threshold)

    def legend(self, source: ViewSource) -> Legend:
        low, high = weight_range(source.settings)
        threshold = source.settings.threshold
        mark = float(np.log(threshold / low) / np.log(high / low)) if threshold > 0.0 else None
        text = f"logarithmic; the line is the tolerance {threshold:.3g}, black on the side that requests records"
        return Legend(text, f"{low:.3g}", f"{high:.3g}", "", colour_map(), mark)


class AskingBuffer(TextureBuffer):
    """The pixels that request a record, orange over the dim picture; the value is Σw."""

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        _draw_asking(canvas, source, source.settings.threshold)

    def legend(self, source: ViewSource) -> Legend:
        settings = source.settings
        contradiction = f", or whose records differ by {100.0 * settings.spread:.3g} %" if settings.spread else ""
        return Legend(f"orange: pixels with Σw below {settings.threshold:.3g}{contradiction}")


def draw_dim_picture(canvas: Canvas, source: ViewSource) -> None:
    """Draw the picture dim and grey, as the ground for what is not there yet."""
    _draw_asking(canvas, source, _NO_TOLERANCE)


def _draw_asking(canvas: Canvas, source: ViewSource, tolerance: float) -> None:
    splats = source.view.splats
    canvas.picture(
        source,
        "asking",
        splats.weight,
        image=source.view.image,
        gain=source.gain,
        sums=splats.sums,
        tolerance=tolerance,
        spread=source.settings.spread,
        luminance_floor=splats.luminance_floor,
    )


def weight_range(settings: Settings) -> tuple[float, float]:
    """The ends of the logarithmic scale of Σw; the threshold lies inside."""
    least, threshold = 1.0 / settings.a, settings.threshold
    low, high = 0.5 * least, _DECADES * least
    return (min(low, 0.5 * threshold) if threshold > 0.0 else low), max(high, 2.0 * threshold)
