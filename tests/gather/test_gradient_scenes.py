"""The translation gradient in bundled scenes, by both gathers, against finite differences of gathers of 65 536 rays."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

import irrsplat
from tests.support.fine import Gatherer, Slopes, load, tangents

FLAT = 0.1  # of E: where it changes by less than this over R_k there is no gradient to speak of
SLOW = ("curved", 0.05), ("door", 0.15), ("atrium", 0.18)


@pytest.mark.parametrize("how", ["raster", "trace"])
@pytest.mark.parametrize(
    ("name", "limit"),
    [("cornell", 0.035), *(pytest.param(*more, marks=pytest.mark.long) for more in SLOW)],
)
def test_translation_gradient_in_scenes(ctx: moderngl.Context, name: str, limit: float, how: str) -> None:
    """(E(p + δ) - E(p - δ))/2δ along the surface, δ = 2 % of R, against the gradient: at the default 64² its median error is
    below the limit, and it grows with each coarser gather."""
    world = irrsplat.load(name)
    truth = load(Slopes, name, world)
    slope = np.linalg.norm(truth.slope, axis=1)
    steep = slope * truth.R > FLAT * truth.E
    error = {}
    for side in (16, 32, 64):
        with Gatherer(ctx, world, how, side) as gatherer:
            found = np.einsum("tni,ni->nt", tangents(truth.normal.astype(float)), gatherer(truth.sites).gradient)
        error[side] = float(np.median((np.linalg.norm(found - truth.slope, axis=1) / np.maximum(slope, 1e-30))[steep]))
    assert error[64] <= limit and error[64] < error[32] < error[16] and steep.sum() > 0.8 * len(steep), error
