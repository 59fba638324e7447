"""The path-traced reference of irradiance, and the error against it, in the colours of `irrsplat verify`."""

from __future__ import annotations

import numpy as np

from irrsplat.app.common.error_colours import BRIGHT, DARK, FULL, GREY, error_colours
from irrsplat.app.viewer.buffers.shown_buffer import Canvas, Identity, Legend, ShownBuffer, ViewSource, depth_at
from irrsplat.app.viewer.buffers.texture_buffers import draw_irradiance, exposed_white, irradiance_at
from irrsplat.app.viewer.buffers.weight import draw_dim_picture
from irrsplat.app.viewer.show.screen import Texels

NO_REFERENCE = "no reference of this view yet; Y traces it"


class ReferenceBuffer(ShownBuffer):
    """The reference, as a white surface reflects it."""

    needs_reference = True

    def inputs(self, source: ViewSource) -> object:
        return Identity(source.reference)

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        reference = source.reference
        if reference is None:
            draw_dim_picture(canvas, source)
        else:
            draw_irradiance(canvas, source, reference.values)

    def value(self, texels: Texels, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        if source.reference is None or depth_at(texels, source, x, y) is None:
            return None
        found = texels(source.reference.values, x, y)
        return found[:3] if found[3] > 0.0 else None

    def legend(self, source: ViewSource) -> Legend:
        if source.reference is None:
            return Legend(NO_REFERENCE)
        return Legend(f"{exposed_white(self.unit, source)}; {source.reference.about}", unit=self.unit)


class ErrorBuffer(ReferenceBuffer):
    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        reference = source.reference
        if reference is None:
            return draw_dim_picture(canvas, source)
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

    def value(self, texels: Texels, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        found = super().value(texels, source, x, y)
        if found is None:
            return None
        error: np.ndarray = np.mean(irradiance_at(texels, source.view, x, y) - found, keepdims=True)
        return error

    def legend(self, source: ViewSource) -> Legend:
        reference = source.reference
        if reference is None:
            return Legend(NO_REFERENCE)
        text = f"mean of the channels; in full colour at {100.0 * FULL:g} % of the reference's mean; grey: no surface"
        colours = error_colours(np.linspace(-1.0, 1.0, 64))
        return Legend(f"{text}; {reference.about}", f"{-reference.full:.3g}", f"{reference.full:.3g}", self.unit, colours)
