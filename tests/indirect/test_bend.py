"""Hessian of a record against second differences of Lambert's formula."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.app.viewer.show.record_inspector import COLUMNS
from irrsplat.records.weight import reach
from irrsplat.scene.model import Scene
from tests.gather import test_gradients as occluder
from tests.support.worlds import Gathered, Lit, floor, material, polygon_vector, quad, scene, sites

UP = np.array([0.0, 1.0, 0.0])
KIND = "trace"


def rectangle(x: float, z: float, y: float) -> np.ndarray:
    """Return the corners (4, 3) of a downward rectangle around the y axis, with half sides x and z, at height y."""
    return np.array([[-x, y, -z], [x, y, -z], [x, y, z], [-x, y, z]])


EMITTERS = {"patch": rectangle(0.5, 0.3, 1.5), "strip": rectangle(3.0, 0.1, 1.0)}


def under(corners: np.ndarray) -> Scene:
    """Return a polygon of L = 1, and a black floor far below, so that the maximum radius, the diagonal, has no effect."""
    point_light = quad(corners[0], corners[1] - corners[0], corners[3] - corners[0], material(0.0, 1.0))
    return scene(point_light, floor(8.0, -8.0, material(0.0)))


def places(count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Return points below the emitters with upward normals, so that all of an emitter is above their horizon."""
    return np.random.default_rng(0).uniform((-1, 0, -1), (1, 0.3, 1), (count, 3)), np.tile(UP, (count, 1))


def hessian(E: object, p: np.ndarray, step: float = 2e-3) -> np.ndarray:
    """Return second derivatives (N, 2, 2) of E(p) along x and z, by central differences."""
    assert callable(E)
    x, z = step * np.array([1.0, 0.0, 0.0]), step * np.array([0.0, 0.0, 1.0])
    mixed = (E(p + x + z) - E(p + x - z) - E(p - x + z) + E(p - x - z)) / (4.0 * step**2)
    own = [(E(p + d) - 2.0 * E(p) + E(p - d)) / step**2 for d in (x, z)]
    return np.stack([np.stack([own[0], mixed], -1), np.stack([mixed, own[1]], -1)], -2)


def record_hessian(found: Gathered) -> np.ndarray:
    """Return the Hessian (N, 2, 2) of records with upward normals, along x and z."""
    along = found.axis[:, [0, 2]]
    across = np.stack([-along[:, 1], along[:, 0]], 1)
    parts = [b[:, None, None] * v[:, :, None] * v[:, None] for b, v in zip(found.bend.T, (along, across), strict=True)]
    return found.E[:, :1, None] * (parts[0] + parts[1])


def relative(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return |found - truth|/|truth| (N,) of matrices."""
    return np.linalg.norm(found - truth, axis=(1, 2)) / np.linalg.norm(truth, axis=(1, 2))


@pytest.mark.parametrize("emitter", EMITTERS)
def test_hessian_of_a_light(ctx: moderngl.Context, emitter: str) -> None:
    """The error against second differences of Lambert's formula is within 12 % at the default 64, and half at twice the side."""
    corners, (p, n) = EMITTERS[emitter], places()
    truth = hessian(lambda q: polygon_vector(corners, q) @ UP, p)
    lit = Lit(ctx, under(corners))
    found = {side: lit.gather(sites(p, n), side, KIND) for side in (16, 32, 64, 128)}
    off = {side: float(np.median(relative(record_hessian(one), truth))) for side, one in found.items()}
    assert off[64] < 0.12 and off[64] < 0.7 * off[32] < 0.5 * off[16] and off[128] < 0.7 * off[64], off
    assert np.quantile(relative(record_hessian(found[64]), truth), 0.9) < 0.25
    # no part is missing or counted twice
    assert (record_hessian(found[64]) * truth).sum() / (truth**2).sum() == pytest.approx(1.0, abs=0.03)


def test_hessian_behind_a_board(ctx: moderngl.Context) -> None:
    """With the board in front of the light at half its distance, the Hessian is exact in the limit.

    Where the rims of board and light cross, the crossing slides along both as the record moves; without this term the
    Hessian is nearly exact. The rest is the noise of rays, which lie anywhere in their strata.
    """
    inside = np.random.default_rng(1).uniform((0.22, 0.0, -0.18), (0.58, 0.01, -0.02), (40, 3))
    lit = Lit(ctx, replace(occluder.world(), meshes=(*occluder.world().meshes, floor(8.0, -8.0, material(0.0)))))
    for p, sides in ((inside, (32, 64, 128)), (occluder.places()[0], (64,))):
        truth = hessian(lambda q: occluder.vector(q) @ UP, p)
        off = {side: float(np.median(relative(record_hessian(lit.gather(sites(p, UP), side, KIND)), truth))) for side in sides}
        if p is inside:
            assert off[128] < 0.03 and off[128] < 0.4 * off[64] < 0.4 * off[32], off
        assert off[64] < 0.25, off


def test_under_a_sky_alone_records_have_the_greatest_radius() -> None:
    """Under a uniform sky the Hessian is 0 and R the diagonal; without any light a picture is black without NaN."""
    bare = scene(floor(), sky=1.0)
    for world, E in ((bare, np.pi), (replace(bare, sky=(0.0, 0.0, 0.0)), 0.0)):
        with irrsplat.Renderer(world, (40, 40), bounces=1, gather=KIND, gather_size=16) as renderer:
            frame, records = renderer.render(), renderer.cache.records
            settings = replace(renderer.settings, radius_max=0.0)
            radii = reach(records.read(*COLUMNS), records.luminance_floor, world.cameras[0], renderer.size, settings)
        seen = np.isfinite(frame.depth)
        assert np.allclose(frame.irradiance[seen], E, rtol=1e-3)
        assert len(radii) and np.allclose(radii, renderer.settings.a * world.diagonal, rtol=1e-3)
