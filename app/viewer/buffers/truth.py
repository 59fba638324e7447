"""The path-traced truth of irradiance, and the error against it, in the colours of `irrsplat verify`."""

from __future__ import annotations

import numpy as np

from irrsplat.app.common.error_colours import BRIGHT, DARK, FULL, GREY, error_colours
from irrsplat.app.viewer.buffers.legend import Legend
from irrsplat.app.viewer.buffers.shown_buffer import Canvas, Identity, ShownBuffer, Values, ViewSource, depth_at
from irrsplat.app.viewer.buffers.texture_buffers import draw_irradiance, exposed_white, great_irradiance, irradiance_at
from irrsplat.app.viewer.buffers.weight import draw_dim_picture
from irrsplat.app.viewer.show.screen import Texels

NO_TRUTH = "no reference of this view yet; Y traces it"


class ReferenceBuffer(ShownBuffer):
    """The truth of each cell of pixels, as a white surface reflects it."""

    needs_truth = True

    def inputs(self, source: ViewSource) -> object:
        """The truth."""
        return Identity(source.truth)

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        """Draw the truth; the dim picture until it is traced."""
        truth = source.truth
        if truth is None:
            draw_dim_picture(canvas, source)
        else:
            draw_irradiance(canvas, source, truth.values, truth.lattice.stride, truth.lattice.margin)

    def values(self, source: ViewSource) -> Values | None:
        """Its texels, once every pixel is traced."""
        truth = source.truth
        return Values(truth.values, 0, great_irradiance(source)) if truth is not None and truth.lattice.stride == 1 else None

    def value(self, texels: Texels, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        """W/m², three channels: of the cell that the pixel lies in."""
        if source.truth is None or depth_at(texels, source, x, y) is None:
            return None
        found = texels(source.truth.values, *source.truth.lattice.cell(x, y))
        return found[:3] if found[3] > 0.0 else None

    def legend(self, source: ViewSource) -> Legend:
        """Unit and exposure, and how it was traced."""
        if source.truth is None:
            return Legend(NO_TRUTH)
        return Legend(f"{exposed_white(self.unit, source)}; {source.truth.about}", unit=self.unit)


class ErrorBuffer(ReferenceBuffer):
    """Irradiance minus its truth, the mean of the channels, in the middle of each cell of pixels."""

    def values(self, source: ViewSource) -> Values | None:
        """None: no texture holds them."""
        return None

    def draw(self, canvas: Canvas, source: ViewSource) -> None:
        """Draw the error; the dim picture until the truth is traced."""
        truth = source.truth
        if truth is None:
            return draw_dim_picture(canvas, source)
        bright, dark, grey = (np.array(colour) / 255.0 for colour in (BRIGHT, DARK, GREY))
        canvas.picture(
            source,
            "error",
            source.view.sums,
            truth=truth.values,
            full=truth.full,
            stride=truth.lattice.stride,
            margin=truth.lattice.margin,
            bright=bright,
            dark=dark,
            unseen=grey,
        )

    def value(self, texels: Texels, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        """W/m², one number."""
        truth, found = source.truth, super().value(texels, source, x, y)
        if truth is None or found is None:
            return None
        middle = truth.lattice.middle(truth.lattice.cell(x, y), truth.size)
        error: np.ndarray = np.mean(irradiance_at(texels, source.view, *middle) - found, keepdims=True)
        return error

    def legend(self, source: ViewSource) -> Legend:
        """The scale of errors, and how the truth was traced."""
        truth = source.truth
        if truth is None:
            return Legend(NO_TRUTH)
        text = f"mean of the channels; in full colour at {100.0 * FULL:g} % of the reference's mean; grey: no surface"
        colours = error_colours(np.linspace(-1.0, 1.0, 64))
        return Legend(f"{text}; {truth.about}", f"{-truth.full:.3g}", f"{truth.full:.3g}", self.unit, colours)
