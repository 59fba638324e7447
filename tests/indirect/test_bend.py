"""How light bends around a record: its Hessian against Lambert's formula, and the ellipses that records reach by it."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.app.viewer.show.record_table import read
from irrsplat.scene.model import Scene
from tests.gather import test_gradients as occluder
from tests.support.worlds import Gathered, Lit, box, floor, material, polygon_vector, quad, scene, sites

UP = np.array([0.0, 1.0, 0.0])
KINDS = ("raster", "trace")


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


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("emitter", EMITTERS)
def test_hessian_of_a_lamp(ctx: moderngl.Context, emitter: str, kind: str) -> None:
    """Against second differences of Lambert's formula: right within 10 % at the default 64, half as wrong with twice the side."""
    corners, (p, n) = EMITTERS[emitter], places()
    truth = hessian(lambda q: polygon_vector(corners, q) @ UP, p)
    lit = Lit(ctx, under(corners))
    found = {side: lit.gather(sites(p, n), side, kind) for side in (16, 32, 64, 128)}
    off = {side: float(np.median(relative(said(one), truth))) for side, one in found.items()}
    assert off[64] < 0.1 and off[64] < 0.7 * off[32] < 0.5 * off[16] and off[128] < 0.7 * off[64], off
    assert np.quantile(relative(said(found[64]), truth), 0.9) < 0.25
    # nothing of it is missing or counted twice
    assert (said(found[64]) * truth).sum() / (truth**2).sum() == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("emitter", EMITTERS)
def test_the_axis_is_the_eigenvector_of_least_curvature(ctx: moderngl.Context, emitter: str, kind: str) -> None:
    corners, (p, n) = EMITTERS[emitter], places()
    value, way = np.linalg.eigh(hessian(lambda q: polygon_vector(corners, q) @ UP, p))
    order = np.argsort(np.abs(value), axis=1)
    value, way = np.take_along_axis(value, order, 1), np.take_along_axis(way, order[:, None], 2)
    found = Lit(ctx, under(corners)).gather(sites(p, n), 64, kind)
    assert np.abs(found.axis[:, 1]).max() < 1e-5 and np.allclose(np.linalg.norm(found.axis, axis=1), 1.0, atol=1e-5)
    cosine = np.abs((way[..., 0] * found.axis[:, [0, 2]]).sum(1))
    assert (cosine > 0.99).mean() > 0.9
    clear = np.abs(value[:, 1]) > 1.3 * np.abs(value[:, 0])  # else rounding decides which is the lesser
    assert clear.sum() > 30 and (np.sign(found.bend[clear, 1]) == np.sign(value[clear, 1])).all()
    assert np.median(np.abs(found.bend[:, 1] * found.E[:, 0] / value[:, 1] - 1.0)) < 0.1


@pytest.mark.parametrize("kind", KINDS)
def test_hessian_behind_a_board(ctx: moderngl.Context, kind: str) -> None:
    """All of the board before the lamp, at half its distance: right in the limit. Where its rim crosses the lamp's, the crossing
    slides along both as the record moves, which is left out: still nearly right."""
    inside = np.random.default_rng(1).uniform((0.22, 0.0, -0.18), (0.58, 0.01, -0.02), (40, 3))
    lit = Lit(ctx, replace(occluder.world(), meshes=(*occluder.world().meshes, floor(8.0, -8.0, material(0.0)))))
    for p, sides in ((inside, (32, 64, 128)), (occluder.places()[0], (64,))):
        truth = hessian(lambda q: occluder.vector(q) @ UP, p)
        off = {side: float(np.median(relative(said(lit.gather(sites(p, UP), side, kind)), truth))) for side in sides}
        if p is inside:
            assert off[128] < 0.02 and off[128] < 0.4 * off[64] < 0.4 * off[32], off
        assert off[64] < (0.1 if p is inside and kind == "raster" else 0.25), off


@pytest.mark.parametrize("kind", KINDS)
def test_ellipses_lie_along_a_strip_and_along_the_edge_of_a_shadow(ctx: moderngl.Context, kind: str) -> None:
    """Under a long lamp, and in the penumbra of a board's straight edge, light stays the same along x and changes across."""
    p = np.random.default_rng(3).uniform((-0.5, 0.0, -0.12), (0.5, 0.0, 0.12), (40, 3))
    board = quad((-8.0, 0.8, 0.0), (16.0, 0.0, 0.0), (0.0, 0.0, 6.0), material(0.0))
    lamp = rectangle(8.0, 0.4, 1.6)
    for world in (under(rectangle(8.0, 0.05, 0.7)), scene(*under(lamp).meshes, board)):
        found = Lit(ctx, world).gather(sites(p, UP), 64, kind)
        radii = np.sqrt(2.0 / np.abs(found.bend))
        # near the middle between where light bends up and where it bends down it does not bend at all
        long = radii[:, 0] > 1.5 * radii[:, 1]
        assert long.mean() > 0.75 and np.median(radii[:, 0] / radii[:, 1]) > 3.0
        assert (np.abs(found.axis[long, 0]) > 0.95).mean() > 0.95


@pytest.mark.parametrize("gather", KINDS)
def test_under_a_sky_alone_records_have_the_greatest_radius(gather: str) -> None:
    """Nothing is seen but sky: nothing bends, R is the diagonal; and with no light at all a picture is black without NaN."""
    bare = scene(floor(), sky=1.0)
    for world, E in ((bare, np.pi), (replace(bare, sky=(0.0, 0.0, 0.0)), 0.0)):
        with irrsplat.Renderer(world, (40, 40), gather=gather, gather_size=16) as renderer:
            frame, table = renderer.render(), read(renderer.cache.records)
            reach = table.reach(world.cameras[0], renderer.size, replace(renderer.settings, radius_max=0.0))
        seen = np.isfinite(frame.depth)
        assert np.allclose(frame.irradiance[seen], E, rtol=1e-3)
        assert len(table) and np.allclose(reach, renderer.settings.a * world.diagonal, rtol=1e-3)


@pytest.mark.parametrize("settings", [{"radius": "harmonic"}, {"gradients": False}])
def test_harmonic_radii_are_circles(settings: dict[str, object]) -> None:
    """Of R_k within E/|∇E| where there are gradients: the same whatever light does along any axis."""
    room = scene(
        box((-1, -1, -1), (1, 1, 1), material(0.5), outward=False),
        quad((-0.5, 0.99, -0.1), (1, 0, 0), (0, 0, 0.2), material(0.0, 9.0)),
    )
    room = replace(room, cameras=(replace(room.cameras[0], eye=(0.0, -0.9, 0.9), target=(0.0, 0.0, -1.0), up=(0.0, 1.0, 0.0)),))
    options = {"gather_size": 16, "radius_min": 0.0, "radius_max": 0.0, "adapt": 0.0, "spread": 0.0, **settings}
    with irrsplat.Renderer(room, (40, 40), **options) as renderer:
        renderer.render()
        table = read(renderer.cache.records)
        reach = table.reach(room.cameras[0], renderer.size, renderer.settings)
        ellipses = table.reach(room.cameras[0], renderer.size, replace(renderer.settings, gradients=True, radius="hessian"))
    assert len(table) > 20 and np.array_equal(reach[:, 0], reach[:, 1])
    assert (reach[:, 0] <= renderer.settings.a * table.radius * (1.0 + 1e-6)).all()
    if renderer.settings.gradients:
        slope = np.maximum(table.slope(), 1e-9)  # a record of black has none
        limit = np.where(table.slope() > 0.0, table.irradiance @ np.array([0.2126, 0.7152, 0.0722]) / slope, np.inf)
        assert np.allclose(reach[:, 0], renderer.settings.a * np.minimum(table.radius, limit), rtol=1e-4)
        assert (ellipses[:, 0] > 1.5 * ellipses[:, 1]).mean() > 0.3
    else:
        assert np.allclose(reach[:, 0], renderer.settings.a * table.radius) and not table.axis.any() and not table.curvature.any()
