"""No visible circles: where a record's reach ends, the irradiance has no edge that one sees, as the paper's own has."""

from __future__ import annotations

import moderngl
import numpy as np

import irrsplat
from irrsplat.core.buffers import Sites
from irrsplat.image.frame import Frame
from irrsplat.indirect.paper_scan import Seen, read_back
from irrsplat.reference.fine_gather import smooth
from tests.gather.test_gradient_scenes import LUMINANCE, Gatherer

SIZE = 200  # pixels
COUNT = 400  # of them
ROUND = ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0))  # a pixel and its neighbours


def bend(E: np.ndarray) -> np.ndarray:
    """(N, 2) second differences along the row and the column, of the values (5, N) at ROUND."""
    return np.stack([E[1] + E[2] - 2.0 * E[0], E[3] + E[4] - 2.0 * E[0]], -1)


def rims(frame: Frame, pixels: np.ndarray, truth: np.ndarray, mean: float) -> float:
    """The share of pixels (N, 2) where E bends otherwise than the `truth` (N, 2) by over 1 % of the `mean` E."""
    E = np.stack([frame.irradiance[tuple((pixels + step).T)] @ LUMINANCE for step in np.array(ROUND)]).astype(float)
    return float((np.abs(bend(E) - truth).max(1) > 0.01 * mean).mean())


def test_our_circles_are_a_tenth_of_the_papers(ctx: moderngl.Context) -> None:
    """E bends at a rim as it does not in truth, which is a fine gather at the pixel and its neighbours, in frames of one turn.

    Where the truth itself bends by over half a per cent of the mean, shading is too steep to see a rim, and is left out.
    """
    world = irrsplat.load("cornell")
    frames = {}
    for preset in ("default", "paper"):
        with irrsplat.Renderer(world, (SIZE, SIZE), preset, ctx=ctx, bounces=1) as renderer:
            frames[preset] = renderer.render()
            seen = read_back(renderer.frame(gather=False)[0].gbuffer)
    pixels = np.random.default_rng(2).permutation(np.argwhere(smooth(seen, 0.002 * world.diagonal)))[:COUNT]
    fine = Gatherer(ctx, world, "raster", 128)
    E = np.stack([fine(sites(seen, pixels + step)).E for step in np.array(ROUND)])
    truth, mean = bend(E), float(E[0].mean())
    even = np.abs(truth).max(1) < 0.005 * mean
    assert even.mean() > 0.6
    share = {preset: rims(frame, pixels[even], truth[even], mean) for preset, frame in frames.items()}
    assert share["paper"] > 0.3, f"the paper's circles are there to be seen: {share}"
    assert share["default"] <= share["paper"] / 10.0, share


def sites(seen: Seen, pixels: np.ndarray) -> Sites:
    """The points at pixels (N, 2)."""
    at = tuple(pixels.T)
    return Sites(seen.position[at], seen.normal[at], seen.geometric[at])
