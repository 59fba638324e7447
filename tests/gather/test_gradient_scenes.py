"""The translation gradient in the bundled scenes, by both gathers, against finite differences of one of 65 536 rays."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.core.buffers import Sites
from irrsplat.gather.look import gather_records
from irrsplat.gather.reduce import ReducePass
from irrsplat.indirect.paper_scan import read_back
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings
from tests.support.worlds import Lit

COUNT = 40  # points
STEP = 0.02  # of R_k
FLAT = 0.1  # of E: where it changes by less than this over R_k there is no gradient to speak of
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709


@dataclass(frozen=True)
class Found:
    """Of N records: luminance E (N,), R (N,) and ∇E of the luminance (N, 3)."""

    E: np.ndarray
    R: np.ndarray
    gradient: np.ndarray


class Gatherer:
    """Gathers by `how` with so many texels a `side`. A record's turn about its normal goes by its place among the sites, so that
    sites that have moved a little see by the same directions, and aliasing cancels in differences."""

    def __init__(self, ctx: moderngl.Context, world: Scene, how: str, side: int) -> None:
        self.lit = Lit(ctx, world, Settings().shadow_size)
        self.look = self.lit.look(side, how)
        self.reduce, self.cache = ReducePass(ctx, True), RecordCache(ctx)

    def __call__(self, where: Sites, seed: int = 0) -> Found:
        self.cache.truncate(0)
        numbers = self.cache.append(where) + np.arange(len(where))
        gather_records(self.look, self.reduce, self.lit.light, self.cache, numbers, seed)
        E, R, gradient = self.cache.records.read("irradiance", "radius", "gradient").values()
        return Found(E @ LUMINANCE, R, np.einsum("ncx,c->nx", gradient, LUMINANCE))


def visible(ctx: moderngl.Context, world: Scene) -> Sites:
    """Points that the scene's camera sees, drawn at random."""
    with irrsplat.Renderer(world, (160, 160), ctx=ctx, bounces=1) as renderer:
        seen = read_back(renderer.frame(gather=False)[0].gbuffer)
    at = tuple(np.random.default_rng(5).permutation(np.argwhere(seen.mask))[:COUNT].T)
    return Sites(seen.position[at], seen.normal[at], seen.geometric[at])


def tangents(n: np.ndarray) -> np.ndarray:
    """(2, N, 3): two unit vectors across unit vectors n (N, 3) and each other."""
    one = np.cross(n, np.where(np.abs(n[:, :1]) < 0.7, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    return np.stack([one, np.cross(n, one)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "turns", "limit"), [("cornell", 1, 0.035), ("curved", 1, 0.05), ("door", 1, 0.15), ("atrium", 3, 0.17)]
)
def test_translation_gradient_in_scenes(ctx: moderngl.Context, name: str, turns: int, limit: float) -> None:
    """(E(p + δ) - E(p - δ))/2δ along the surface, δ = 2 % of R, against the gradient: at the default 64² its median error is
    below the limit, and it grows with each coarser gather, 32² and 16².

    turns: of how many rotations of its frame the reference is the mean; among the atrium's columns one alone is too noisy.
    """
    world = irrsplat.load(name)
    where = visible(ctx, world)
    fine = Gatherer(ctx, world, "trace", 256)
    here = fine(where)
    along = tangents(where.normal.astype(float))
    step = STEP * here.R[:, None]
    truth = np.zeros((len(where), 2))
    for axis, t in enumerate(along):
        for sign in (1.0, -1.0):
            moved = Sites((where.position + sign * step * t).astype("f4"), where.normal, where.geometric)
            for seed in range(turns):
                truth[:, axis] += sign * fine(moved, seed).E / (2.0 * step[:, 0] * turns)
    slope = np.linalg.norm(truth, axis=1)
    steep = slope * here.R > FLAT * here.E
    assert steep.sum() > 0.8 * COUNT
    for how in ("raster", "trace"):
        error = {}
        for side in (16, 32, 64):
            found = np.einsum("tni,ni->nt", along, Gatherer(ctx, world, how, side)(where).gradient)
            error[side] = float(np.median((np.linalg.norm(found - truth, axis=1) / np.maximum(slope, 1e-30))[steep]))
        assert error[64] <= limit, f"{how}: {error}"
        assert error[64] < error[32] < error[16], f"{how}: {error}"
