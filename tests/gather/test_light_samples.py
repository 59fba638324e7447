"""Next-event estimation: shadow rays sample emitters, with multiple importance weights for random ray hits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import moderngl
import numpy as np
import pytest

from irrsplat.gather.hemisphere import gather_records
from irrsplat.gather.kinds import gather_pass
from irrsplat.gather.reduce import ReducePass
from irrsplat.records.record_cache import RecordCache
from irrsplat.records.weight import own_radii
from irrsplat.scene.model import Image, Material, Mesh, Texture
from irrsplat.settings import Settings
from tests.support.worlds import Gathered, Lit, box, floor, gathered, material, polygon_vector, quad, scene, sites, sphere

UP = np.array((0.0, 1.0, 0.0))
EMITTER = (1.0, 2.0, 3.0)  # W/(m² sr), different in each channel
ROOM = box((-2, 0, -2), (2, 3, 2), material(0.5), outward=False)
PENUMBRA = quad((-0.1, 2.9, -0.2), (0.2, 0, 0), (0, 0, 0.4), material(0.0, 5.0))
BOARD = quad((-2, 1.45, -2), (2, 0, 0), (0, 0, 4))  # its edge at x = 0, halfway up: the penumbra extends from -0.1 to 0.1


def panel(height: float = 1.2) -> Mesh:
    """Return a slanting emissive parallelogram above the origin."""
    return quad((-0.3, height, -0.2), (0.6, 0.1, 0.05), (0.02, -0.08, 0.5), material(0.0, EMITTER))


def look(lit: Lit, where: np.ndarray, normal: np.ndarray, samples: int, kind: str = "trace", side: int = 64) -> Gathered:
    """Gather records there with `samples` shadow rays of next-event estimation."""
    settings = Settings(bounces=1, gather=kind, gather_size=side, light_samples=samples)
    at = sites(where, normal)
    with gather_pass(lit.world, settings, 64) as pass_, ReducePass(lit.ctx, True) as reduce, RecordCache(lit.ctx) as cache:
        gather_records(pass_, reduce, lit.light, cache, cache.append(at) + np.arange(len(at)), 0)
        return gathered(cache)


def relative(found: np.ndarray, truth: np.ndarray) -> float:
    """Return √mean(error²) over the mean of the truth."""
    return float(np.sqrt(np.mean((found - truth) ** 2)) / np.mean(truth))


def hessian(f: Callable[[np.ndarray], float], p: np.ndarray, axes: np.ndarray, step: float = 5e-3) -> np.ndarray:
    """Return central differences (2, 2) of f at p along the axes (2, 3)."""
    a, b = step * axes
    steps = np.array([[(a, a), (a, b)], [(b, a), (b, b)]])
    corners = [[f(p + x + y) - f(p + x - y) - f(p - x + y) + f(p - x - y) for x, y in row] for row in steps]
    return np.array(corners) / (4.0 * step * step)


@pytest.mark.parametrize("kind", ["trace", "embree"])
def test_E_its_vector_gradient_and_curvature_are_those_of_lamberts_formula(ctx: moderngl.Context, kind: str) -> None:
    """Under a slanting panel of 1 to 6 % of the hemisphere, errors are far below those of rays alone, without bias.

    The same holds below a panel entirely above the horizon.
    """
    point_light, rng = panel(), np.random.default_rng(1)
    corners = point_light.positions.astype(float)
    where, normal = rng.uniform((-1, 0, -1), (1, 0.6, 1), (32, 3)), np.array((0.1, 1.0, 0.05))
    normal /= np.linalg.norm(normal)
    axes = np.linalg.svd(normal[None])[2][1:]

    def E(p: np.ndarray) -> float:
        return float(polygon_vector(corners, p) @ normal)

    step = 1e-3 * np.eye(3)
    truth = np.array([E(p) for p in where])
    gradient = np.array([[(E(p + d) - E(p - d)) / 2e-3 for d in step] for p in where])
    values = np.linalg.eigvalsh(np.array([hessian(E, p, axes) for p in where])) / truth[:, None]
    values = np.take_along_axis(values, np.argsort(np.abs(values), axis=1), 1)
    with Lit(ctx, scene(floor(6.0, -0.5, material(0.0)), point_light)) as lit:
        found = look(lit, where, normal, 256, kind)
    for channel, radiance in enumerate(EMITTER):
        assert relative(found.E[:, channel], radiance * truth) < 0.005
        assert relative(found.M[:, channel], radiance * polygon_vector(corners, where)) < 0.05
        off = np.linalg.norm(found.gradient[:, channel] - radiance * gradient, axis=1)
        assert np.median(off / np.linalg.norm(radiance * gradient, axis=1)) < 0.006
    slope = (found.gradient[:, 1] / 2.0 * gradient).sum() / (gradient**2).sum()
    assert slope == pytest.approx(1.0, abs=0.004), "nothing is missing, nor counted twice"
    assert np.median(np.abs(found.bend - values).max(1) / np.abs(values).max(1)) < 0.006


@pytest.mark.parametrize("kind", ["trace", "embree"])
@pytest.mark.parametrize("faces", [[[2, 1, 0], [3, 2, 0]], [[3, 2, 1], [3, 1, 0]]])
def test_both_faces_of_a_panel_are_one_light(ctx: moderngl.Context, kind: str, faces: list[list[int]]) -> None:
    """A CAD model has a face for each side of a panel, with one diagonal or the other. A ray ends at one of both faces, so that
    light is that of a single face."""
    front = panel()
    back = replace(front, normals=-front.normals, faces=np.array(faces, np.int32))
    where = np.random.default_rng(1).uniform((-1, 0, -1), (1, 0, 1), (32, 3))
    truth = polygon_vector(front.positions.astype(float), where) @ UP
    with Lit(ctx, scene(floor(6.0, -0.5, material(0.0)), front, back)) as lit:
        found = look(lit, where, UP, 256, kind)
    assert relative(found.E, truth[:, None] * EMITTER) < 0.005


@pytest.mark.parametrize("samples", [64, 256])
def test_a_small_bulb_lights_all_records_alike(ctx: moderngl.Context, samples: int) -> None:
    """A bulb of 5 cm in a room of 4 m, hit by a few rays of 4096: E = I·cosθ/d² of a sphere, I = π·r²·L."""
    radius, centre = 0.025, np.array((0.3, 2.2, 0.1))
    where = np.random.default_rng(1).uniform((-1.8, 0, -1.8), (1.8, 0, 1.8), (48, 3))
    away = centre - where
    truth = np.pi * radius**2 * 1e3 * away[:, 1] / np.linalg.norm(away, axis=1) ** 3
    with Lit(ctx, scene(ROOM, sphere(centre, radius, material(0.0, 1e3), 12, 24))) as lit:
        alone, found = (look(lit, where, UP, n).E[:, 0] for n in (0, samples))
    assert relative(found, truth) < 0.03 + 5.0 / samples < relative(alone, truth) / 10
    assert found.mean() == pytest.approx(truth.mean(), rel=0.04), "a sphere of 24 by 12 facets is a little smaller"


def half_hidden(p: np.ndarray) -> np.ndarray:
    """Return the panel's light (N,) at points (N, 3) on the floor; the board hides the part below -x."""
    corners = np.broadcast_to(PENUMBRA.positions.astype(float), (len(p), 4, 3)).copy()
    corners[..., 0] = np.maximum(corners[..., 0], -p[:, 0, None])
    return 5.0 * polygon_vector(corners, p)[:, 1]


@pytest.mark.parametrize("kind", ["trace", "embree"])
def test_a_record_in_the_dark_knows_that_light_is_near(ctx: moderngl.Context, kind: str) -> None:
    """A record in full shadow near the penumbra has a radius of about this distance, and does not reach into the light.

    It sees no light itself, but its neighbouring sample points do. Farther inside, its radius is unlimited.
    """
    x = -0.1 - np.array([0.002, 0.006, 0.01, 0.014, 0.018, 0.1])
    settings, at = Settings(bounces=1), sites(np.column_stack([x, np.zeros((6, 2))]), UP)
    with Lit(ctx, scene(ROOM, PENUMBRA, BOARD)) as lit:
        found = look(lit, at.position, UP, 512, kind)
    columns = {"irradiance": found.E, "radius": found.R, "gradient": found.gradient, "axis": found.axis, "curvature": found.bend}
    dark = 0.015 * float(half_hidden(np.array([[0.1, 0.0, 0.0]]))[0])
    radii = own_radii(columns | {"max_radius": 2.0 * found.R}, dark, settings).min(axis=1)
    assert (found.E == 0.0).all() and (radii[:-1] < 0.05).all() and radii[-1] > 1.0, radii


@pytest.mark.parametrize("kind", ["trace", "embree"])
def test_a_gradient_knows_how_a_shadow_moves(ctx: moderngl.Context, kind: str) -> None:
    """Gradients in a penumbra match differences of Lambert's formula for the visible part of a panel."""
    rng = np.random.default_rng(6)
    where = np.column_stack([rng.uniform(-0.06, 0.06, 32), np.zeros(32), rng.uniform(-0.5, 0.5, 32)])
    step = 0.01 * np.eye(3)
    truth = np.array([(half_hidden(where + d) - half_hidden(where - d)) / 0.02 for d in step[[0, 2]]]).T
    with Lit(ctx, scene(ROOM, PENUMBRA, BOARD)) as lit:
        found = look(lit, where, UP, 1024, kind)
    assert relative(found.E[:, 0], half_hidden(where)) < 0.03
    off = np.linalg.norm(found.gradient[:, 0][:, [0, 2]] - truth, axis=1) / np.linalg.norm(truth, axis=1)
    assert np.median(off) < 0.06
    assert (found.gradient[:, 0, 0] * truth[:, 0]).sum() / (truth[:, 0] ** 2).sum() == pytest.approx(1.0, abs=0.03)


def test_a_panel_whose_image_shines_in_one_half_lights_as_that_half(ctx: moderngl.Context) -> None:
    """Next-event estimation samples triangles by mean emission and looks up the image: Lambert's formula of the half."""
    pixels = np.zeros((64, 64, 4), np.uint8)
    pixels[..., 3], pixels[:, 32:, :3] = 255, 255
    plain = quad((-0.4, 2.5, -0.3), (0.8, 0, 0), (0, 0, 0.6))
    paint = Material(albedo=(0.0, 0.0, 0.0), emission=EMITTER, emission_texture=Texture(Image(pixels), wrap=("clamp", "clamp")))
    uvs = np.array([(0, 0, 0, 0), (1, 0, 0, 0), (1, 1, 0, 0), (0, 1, 0, 0)], "f4")
    point_light = replace(plain, material=paint, uvs=uvs)
    half = plain.positions.astype(float) * (0.5, 1, 1) + (0.2, 0, 0)
    where = np.random.default_rng(4).uniform((-1.5, 0, -1.5), (1.5, 0, 1.5), (32, 3))
    with Lit(ctx, scene(ROOM, point_light)) as lit:
        found = look(lit, where, UP, 256)
    for channel, radiance in enumerate(EMITTER):
        assert relative(found.E[:, channel], radiance * polygon_vector(half, where)[:, 1]) < 0.03
