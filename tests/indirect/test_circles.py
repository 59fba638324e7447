"""No visible circles: where a record's reach ends, the irradiance has no edge that one sees, as the paper's own has."""

from __future__ import annotations

import numpy as np
import pytest

import irrsplat
from irrsplat.image.frame import Frame
from tests.support.fine import LUMINANCE, ROUND, SIZE, load

pytestmark = pytest.mark.long


def bend(E: np.ndarray) -> np.ndarray:
    """(N, 2) second differences along the row and the column, of the values (5, N) at ROUND."""
    return np.stack([E[1] + E[2] - 2.0 * E[0], E[3] + E[4] - 2.0 * E[0]], -1)


def rims(frame: Frame, pixels: np.ndarray, truth: np.ndarray, mean: float) -> float:
    """The share of pixels (N, 2) where E bends otherwise than the `truth` (N, 2) by over 1 % of the `mean` E."""
    E = np.stack([frame.irradiance[tuple((pixels + step).T)] @ LUMINANCE for step in np.array(ROUND)]).astype(float)
    return float((np.abs(bend(E) - truth).max(1) > 0.01 * mean).mean())


def test_our_circles_are_a_tenth_of_the_papers() -> None:
    """E bends at a rim as it does not in truth, which is a fine gather at the pixel and its neighbours, in frames of one turn.

    Where the truth itself bends by over half a per cent of the mean, shading is too steep to see a rim, and is left out.
    """
    world = irrsplat.load("cornell")
    fine = load("cornell", world)
    truth, mean = bend(fine.E), float(fine.E[0].mean())
    even = np.abs(truth).max(1) < 0.005 * mean
    assert even.mean() > 0.6
    share = {}
    for preset in ("default", "paper"):
        frame = irrsplat.render(world, (SIZE, SIZE), preset=preset, bounces=1)
        share[preset] = rims(frame, fine.pixels[even], truth[even], mean)
    assert share["paper"] > 0.3, f"the paper's circles are there to be seen: {share}"
    assert share["default"] <= share["paper"] / 10.0, share
