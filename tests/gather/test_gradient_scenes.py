"""The translation gradient in the bundled scenes, by both gathers, against finite differences of one of 65 536 rays."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.core.buffers import Sites
from tests.support.fine import RAYS, SLOPES, Gatherer, Slopes, load, tangents

FLAT = 0.1  # of E: where it changes by less than this over R_k there is no gradient to speak of


@pytest.mark.parametrize(("name", "limit"), [("cornell", 0.035), ("curved", 0.05), ("door", 0.15), ("atrium", 0.17)])
def test_translation_gradient_in_scenes(ctx: moderngl.Context, name: str, limit: float) -> None:
    """(E(p + δ) - E(p - δ))/2δ along the surface, δ = 2 % of R, against the gradient: at the default 64² its median error is
    below the limit, and it grows with each coarser gather, 32² and 16²."""
    world = irrsplat.load(name)
    truth = load(Slopes, name, world)
    along = tangents(truth.normal.astype(float))
    slope = np.linalg.norm(truth.slope, axis=1)
    steep = slope * truth.R > FLAT * truth.E
    assert steep.sum() > 0.8 * len(steep)
    for how in ("raster", "trace"):
        error = {}
        for side in (16, 32, 64):
            with Gatherer(ctx, world, how, side) as gatherer:
                found = np.einsum("tni,ni->nt", along, gatherer(truth.sites).gradient)
            error[side] = float(np.median((np.linalg.norm(found - truth.slope, axis=1) / np.maximum(slope, 1e-30))[steep]))
        assert error[64] <= limit, f"{how}: {error}"
        assert error[64] < error[32] < error[16], f"{how}: {error}"


@pytest.mark.parametrize("name", SLOPES)
def test_the_kept_truth_is_what_so_many_rays_find(ctx: moderngl.Context, name: str) -> None:
    world = irrsplat.load(name)
    truth, few = load(Slopes, name, world), slice(3)
    with Gatherer(ctx, world, "trace", RAYS) as fine:
        found = fine(Sites(truth.position[few], truth.normal[few], truth.geometric[few]))
    assert np.allclose(found.E, truth.E[few], rtol=1e-3) and np.allclose(found.R, truth.R[few], rtol=1e-3)
