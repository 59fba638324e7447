"""The Hessian of a record against second differences of Lambert's formula."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.app.viewer.show.record_table import read
from irrsplat.scene.model import Scene
from tests.gather import test_gradients as occluder
from tests.support.worlds import Gathered, Lit, floor, material, polygon_vector, quad, scene, sites

UP = np.array([0.0, 1.0, 0.0])
KIND = "trace"


def rectangle(x: float, z: float, y: float) -> np.ndarray:
    """The corners (4, 3) of a rectangle about the y axis that faces down, of half sides x and z, at the height y."""
    return np.array([[-x, y, -z], [x, y, -z], [x, y, z], [-x, y, z]])


EMITTERS = {"patch": rectangle(0.5, 0.3, 1.5), "strip": rectangle(3.0, 0.1, 1.0)}


def under(corners: np.ndarray) -> Scene:
    """A polygon of L = 1, and a black floor so far below that the greatest radius there is, the diagonal, says nothing here."""
    lamp = quad(corners[0], corners[1] - corners[0], corners[3] - corners[0], material(0.0, 1.0))
    return scene(lamp, floor(8.0, -8.0, material(0.0)))


def places(count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Points below the emitters, and normals that are all up, so that nothing of them is below the horizon."""
    return np.random.default_rng(0).uniform((-1, 0, -1), (1, 0.3, 1), (count, 3)), np.tile(UP, (count, 1))


def hessian(E: object, p: np.ndarray, step: float = 2e-3) -> np.ndarray:
    """(N, 2, 2) second derivatives of E(p) along x and z, by central differences."""
    assert callable(E)
    x, z = step * np.array([1.0, 0.0, 0.0]), step * np.array([0.0, 0.0, 1.0])
    mixed = (E(p + x + z) - E(p + x - z) - E(p - x + z) + E(p - x - z)) / (4.0 * step**2)
    own = [(E(p + d) - 2.0 * E(p) + E(p - d)) / step**2 for d in (x, z)]
    return np.stack([np.stack([own[0], mixed], -1), np.stack([mixed, own[1]], -1)], -2)


def said(found: Gathered) -> np.ndarray:
    """(N, 2, 2) the Hessian that records with normals up hold, along x and z."""
    along = found.axis[:, [0, 2]]
    across = np.stack([-along[:, 1], along[:, 0]], 1)
    parts = [b[:, None, None] * v[:, :, None] * v[:, None] for b, v in zip(found.bend.T, (along, across), strict=True)]
    return found.E[:, :1, None] * (parts[0] + parts[1])


def relative(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(N,) |found - truth|/|truth| of matrices."""
    return np.linalg.norm(found - truth, axis=(1, 2)) / np.linalg.norm(truth, axis=(1, 2))


@pytest.mark.parametrize("emitter", EMITTERS)
def test_hessian_of_a_lamp(ctx: moderngl.Context, emitter: str) -> None:
    """Against second differences of Lambert's formula: right within 10 % at the default 64, half as wrong with twice the side."""
    corners, (p, n) = EMITTERS[emitter], places()
    truth = hessian(lambda q: polygon_vector(corners, q) @ UP, p)
    lit = Lit(ctx, under(corners))
    found = {side: lit.gather(sites(p, n), side, KIND) for side in (16, 32, 64, 128)}
    off = {side: float(np.median(relative(said(one), truth))) for side, one in found.items()}
    assert off[64] < 0.1 and off[64] < 0.7 * off[32] < 0.5 * off[16] and off[128] < 0.7 * off[64], off
    assert np.quantile(relative(said(found[64]), truth), 0.9) < 0.25
    # nothing of it is missing or counted twice
    assert (said(found[64]) * truth).sum() / (truth**2).sum() == pytest.approx(1.0, abs=0.03)


def test_hessian_behind_a_board(ctx: moderngl.Context) -> None:
    """All of the board before the lamp, at half its distance: right in the limit. Where its rim crosses the lamp's, the crossing
    slides along both as the record moves, which is left out: still nearly right."""
    inside = np.random.default_rng(1).uniform((0.22, 0.0, -0.18), (0.58, 0.01, -0.02), (40, 3))
    lit = Lit(ctx, replace(occluder.world(), meshes=(*occluder.world().meshes, floor(8.0, -8.0, material(0.0)))))
    for p, sides in ((inside, (32, 64, 128)), (occluder.places()[0], (64,))):
        truth = hessian(lambda q: occluder.vector(q) @ UP, p)
        off = {side: float(np.median(relative(said(lit.gather(sites(p, UP), side, KIND)), truth))) for side in sides}
        if p is inside:
            assert off[128] < 0.02 and off[128] < 0.4 * off[64] < 0.4 * off[32], off
        assert off[64] < 0.25, off


def test_under_a_sky_alone_records_have_the_greatest_radius() -> None:
    """Nothing is seen but sky: nothing bends, R is the diagonal; and with no light at all a picture is black without NaN."""
    bare = scene(floor(), sky=1.0)
    for world, E in ((bare, np.pi), (replace(bare, sky=(0.0, 0.0, 0.0)), 0.0)):
        with irrsplat.Renderer(world, (40, 40), bounces=1, gather=KIND, gather_size=16) as renderer:
            frame, table = renderer.render(), read(renderer.cache.records)
            reach = table.reach(world.cameras[0], renderer.size, replace(renderer.settings, radius_max=0.0))
        seen = np.isfinite(frame.depth)
        assert np.allclose(frame.irradiance[seen], E, rtol=1e-3)
        assert len(table) and np.allclose(reach, renderer.settings.a * world.diagonal, rtol=1e-3)
