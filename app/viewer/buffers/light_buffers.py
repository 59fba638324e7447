"""Buffers made of the view: light in false colours, the sum of weights, requests for records, and the reference."""

from __future__ import annotations

import numpy as np

from irrsplat.app.common.error_colours import BRIGHT, DARK, FULL, GREY, error_colours
from irrsplat.app.viewer.buffers.shown_buffer import (
    GROUND,
    Canvas,
    Identity,
    Legend,
    ShownBuffer,
    ViewSource,
    colour_map,
    depth_at,
)
from irrsplat.app.viewer.buffers.texture_buffers import NO_TOLERANCE, TextureBuffer, draw_requests, irradiance_at
from irrsplat.app.viewer.show.screen import texel
from irrsplat.meter.light_scale import STEPS, false_colours
from irrsplat.settings import Settings


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

    def value(self, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        if not depth_at(source, x, y):
            return None
        direct = texel(source.renderer.direct_irradiance(source.view), x, y)[:3]
        total = direct + irradiance_at(source.view, x, y)
        return np.array([total @ source.light_scale.weights], np.float32)

    def legend(self, source: ViewSource) -> Legend:
        scale = source.light_scale
        low, high = scale.ends
        lines = f"a line every {(high - low) / STEPS:.4g} {scale.shown_unit}" if scale.lines else ""
        return Legend(lines, f"{low:.4g}", f"{high:.4g}", scale.shown_unit, false_colours())


_DECADES = 50.0  # the scale goes so far above and below 1/a: Σw is 0, or at least 1/a


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
        draw_requests(canvas, source, source.settings.threshold)

    def legend(self, source: ViewSource) -> Legend:
        settings = source.settings
        contradiction = f", or whose records differ by {100.0 * settings.spread:.3g} %" if settings.spread else ""
        return Legend(f"orange: pixels with Σw below {settings.threshold:.3g}{contradiction}")


def weight_range(settings: Settings) -> tuple[float, float]:
    """The ends of the logarithmic scale of Σw; the threshold lies inside."""
    least, threshold = 1.0 / settings.a, settings.threshold
    low, high = 0.5 * least, _DECADES * least
    return (min(low, 0.5 * threshold) if threshold > 0.0 else low), max(high, 2.0 * threshold)


NO_REFERENCE = "no reference of this view yet; Y traces it"


class ErrorBuffer(ShownBuffer):
    """The error against the reference, in the colours of `irrsplat verify`."""

    needs_reference = True

    def inputs(self, source: ViewSource) -> object:
        return Identity(source.reference)

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        reference = source.reference
        if reference is None:
            return draw_requests(canvas, source, NO_TOLERANCE)
        bright, dark, grey = (np.array(colour) / 255.0 for colour in (BRIGHT, DARK, GREY))
        canvas.picture(
            source,
            "error",
            source.view.sums,
            reference=reference.values,
            full=reference.full,
            bright=bright,
            dark=dark,
            unseen=grey,
        )

    def value(self, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        known = source.reference is not None and depth_at(source, x, y) is not None
        found = texel(source.reference.values, x, y) if source.reference is not None and known else None
        if found is None or found[3] == 0.0:
            return None
        error: np.ndarray = np.mean(irradiance_at(source.view, x, y) - found[:3], keepdims=True)
        return error

    def legend(self, source: ViewSource) -> Legend:
        reference = source.reference
        if reference is None:
            return Legend(NO_REFERENCE)
        text = f"mean of the channels; in full colour at {100.0 * FULL:g} % of the reference's mean; grey: no surface"
        colours = error_colours(np.linspace(-1.0, 1.0, 64))
        return Legend(f"{text}; {reference.about}", f"{-reference.full:.3g}", f"{reference.full:.3g}", self.unit, colours)
