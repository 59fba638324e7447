"""Virtual point lights: surfaces close to a light are sampled by separate rays, and count once."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest
from scipy.spatial import KDTree

from irrsplat.lighting.light_table import near_plane
from irrsplat.lighting.virtual_lights import VirtualLightPasses, virtual_lights
from irrsplat.scene.change import SceneChange
from irrsplat.scene.model import Light
from tests.gather.test_light_samples import look, relative
from tests.support.worlds import Lit, box, material, point_light, polygon_vector, quad, scene

ALBEDO, POWER = 0.6, 5.0
BELOW = 0.05  # metres from the ceiling to the light
HEIGHT = 3.0  # of the ceiling, metres
SAMPLES, RAYS = 512, 64**2 / np.pi
UP = np.array((0.0, 1.0, 0.0))
LIGHT = point_light((0.2, HEIGHT - BELOW, 0.1), POWER)
DARK = box((-4, 0, -4), (4, HEIGHT, 4), material(0.0), outward=False)
CEILING = quad((-3.99, HEIGHT - 1e-3, -3.99), (7.98, 0, 0), (0, 0, 7.98), material(ALBEDO))


def from_ceiling(where: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return irradiance (N,) in W/m² at points (N, 3) facing `normal`, from the lit ceiling, as a sum over rings around LAMP."""
    x, height = np.asarray(LIGHT.position), HEIGHT - 1e-3
    h = height - x[1]
    # equal shares of the light's power: 1 - h/√(h² + s²) is uniform
    share, angle = (np.arange(1000) + 0.5) / 1000, (np.arange(64) + 0.5) * (2.0 * np.pi / 64)
    s = h * np.sqrt(1.0 / (1.0 - share) ** 2 - 1.0)
    at = np.stack(np.broadcast_arrays(x[0] + s[:, None] * np.cos(angle), height, x[2] + s[:, None] * np.sin(angle)), axis=-1)
    inside = (np.abs(at[..., ::2]) < 3.99).all(-1)
    flux = 2.0 * np.pi * POWER / inside.size * inside  # share of the upward flux
    away = at[None] - np.asarray(where)[:, None, None]
    r2 = (away**2).sum(-1)
    found: np.ndarray = (flux * ALBEDO / np.pi * away[..., 1] * np.maximum(away @ normal, 0.0) / r2**2).sum((1, 2))
    return found


def gradients(where: np.ndarray, normal: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Return its gradients (N, 2) along the `axes` (2, 3), in W/m³."""
    step = 1e-3 * axes
    change = [from_ceiling(where + d, normal) - from_ceiling(where - d, normal) for d in step]
    return np.stack(change, axis=-1) / 2e-3


@pytest.mark.parametrize("kind", ["trace", "embree"])
def test_a_bright_spot_on_the_ceiling_lights_a_wall(ctx: moderngl.Context, kind: str) -> None:
    """The spot's light counts once; records on the wall, at a low angle, are far more exact than with few rays alone.

    Their gradients are too.
    """
    where, normal = np.random.default_rng(1).uniform((-2, 1.5, -1.5), (-1.5, 2.8, 1.5), (24, 3)), np.array((1.0, 0.0, 0.0))
    axes = np.array([(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
    truth, slope = from_ceiling(where, normal), gradients(where, normal, axes)
    with Lit(ctx, scene(DARK, CEILING, lights=(LIGHT,)), 1024) as lit:
        alone, found = (look(lit, where, normal, samples, kind, side=32) for samples in (0, SAMPLES))
    assert relative(found.E[:, 0], truth) < min(0.01, 0.4 * relative(alone.E[:, 0], truth))
    assert found.E[:, 0].mean() == pytest.approx(truth.mean(), rel=0.005), "nothing is missing, nor counted twice"
    off = np.linalg.norm(found.gradient[:, 0] @ axes.T - slope, axis=1) / np.linalg.norm(slope, axis=1)
    assert np.median(off) < 0.05


def test_records_have_sets_of_their_own(ctx: moderngl.Context) -> None:
    """Errors of few virtual lights average out over records at one place, since each record draws a set."""
    where, normal = np.tile((-2.0, 2.0, 0.0), (64, 1)), np.array((1.0, 0.0, 0.0))
    with Lit(ctx, scene(DARK, CEILING, lights=(LIGHT,)), 1024) as lit:
        off = look(lit, where, normal, 8, "trace", side=32).E[:, 0] / from_ceiling(where[:1], normal) - 1.0
    assert abs(off.mean()) < 0.4 * np.sqrt((off**2).mean())  # 0.07 of it; 0.96 by one set for all records


def test_sets_lie_evenly_together(ctx: moderngl.Context) -> None:
    """144 is a Fibonacci number: a golden spiral rotated by 144 steps nearly coincides with itself, so that sets would
    overlap.
    """
    with Lit(ctx, scene(DARK, lights=(LIGHT,)), 64) as lit, VirtualLightPasses(lit.world) as passes:
        uniforms = {**lit.world.trace_uniforms, "rays": 144.0, "further": 0, "near": near_plane(lit.world.scene)}
        rows = np.array([[[*LIGHT.position, 0.0], [0.0, 1.0, 0.0, 2.0], [0.0] * 4]])
        place, *_ = passes.find(rows, 144, 28, uniforms)
    away = place[0, ..., :3].reshape(-1, 3) - LIGHT.position
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    distance, _ = KDTree(away).query(away, 2)
    assert np.quantile(distance[:, 1], 0.1) > 0.4 * np.sqrt(4.0 * np.pi / len(away)), "of the spacing of an even grid"


def test_lights_that_come_back_shine_again(ctx: moderngl.Context) -> None:
    """A further spot needs other programs. Its removal restores virtual lights that were found before it."""
    spot = point_light((1.0, 1.0, 0.1), POWER, spot_target=(1.0, HEIGHT, 0.1), spot_cutoff=30.0, spot_inner=20.0)
    few = scene(DARK, CEILING, lights=(LIGHT,))
    with Lit(ctx, few) as lit:
        found = virtual_lights(lit.world, SAMPLES, RAYS)
        assert found is not None
        found.sample_uniforms(lit.light.shadows)
        for other in (replace(few, lights=(LIGHT, spot)), few):
            lit.world.apply(SceneChange.between(lit.world.scene, other))
            virtual_lights(lit.world, 64, RAYS)
        assert virtual_lights(lit.world, SAMPLES, RAYS) is found, "kept, for its lights are as before"
        assert "virtual_radiance" in found.sample_uniforms(lit.shadow(lit.world, 256))


@pytest.mark.parametrize("half", [5.0, 2.0, 0.5])
def test_a_narrow_beam_onto_the_ceiling_lights_the_floor(ctx: moderngl.Context, half: float) -> None:
    """The beam's spot of down to 17 mm receives Φ = I·2π(1 - cos) and is a small Lambert emitter: E = ρΦ/π·h²/d⁴."""
    beam = point_light((0.2, 1.0, 0.1), POWER, spot_target=(0.2, HEIGHT, 0.1), spot_cutoff=half, spot_inner=half)
    where = np.random.default_rng(2).uniform((-2, 0, -2), (2, 0, 2), (24, 3))
    with Lit(ctx, scene(DARK, CEILING, lights=(beam,)), 1024) as lit:
        found, h = look(lit, where, UP, SAMPLES).E[:, 0], HEIGHT - 1e-3
    power, d2 = POWER * 2.0 * np.pi * (1.0 - np.cos(np.radians(half))), ((where - (0.2, h, 0.1)) ** 2).sum(-1)
    assert found == pytest.approx(ALBEDO * power / np.pi * h**2 / d2**2, rel=0.01)


@pytest.mark.parametrize(("kind", "plain"), [("trace", 0.0), ("embree", 0.0), ("embree", 300.0)])
def test_the_sun_through_an_opening_lights_what_faces_its_patch(ctx: moderngl.Context, kind: str, plain: float) -> None:
    """The patch of 20 cm is a Lambert emitter of ρE_h; the roof, lit from above, does not consume its samples.

    A black ground of `plain` metres outside changes nothing.
    """
    edge, tilt, black = 0.2, 0.25, material(0.0)
    bars = [(-4, -4, 8, 4), (-4, edge, 8, 4 - edge), (-4, 0, 4, edge), (edge, 0, 4 - edge, edge)]
    roof = [quad((x, HEIGHT, z), (width, 0, 0), (0, 0, depth), material(ALBEDO)) for x, z, width, depth in bars]
    walls = [
        quad((x, 0, z), u, (0, HEIGHT, 0), black) for x, z, u in ((-2, -2, (4, 0, 0)), (-2, 2, (0, 0, -4)), (2, -2, (0, 0, 4)))
    ]
    sun = Light((tilt, 1.0, 0.0), (POWER / np.pi,) * 3, directional=True)
    ground = quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), material(ALBEDO))
    patch = np.array([(x - tilt * HEIGHT, 0.0, z) for x, z in ((0, 0), (0, edge), (edge, edge), (edge, 0))])
    where, normal = np.random.default_rng(3).uniform((-1.9, 0.5, -1.5), (-1.5, 2.5, 1.5), (24, 3)), np.array((1.0, 0.0, 0.0))
    truth = ALBEDO * POWER / np.hypot(1.0, tilt) / np.pi * (polygon_vector(patch, where) @ normal)
    outside = [quad((-plain / 2, -1, plain / 2), (plain, 0, 0), (0, 0, -plain), black)] if plain else []
    with Lit(ctx, scene(*roof, *walls, ground, *outside, lights=(sun,)), 4096) as lit:
        found, alone = (look(lit, where, normal, samples, kind, side=32).E[:, 0] for samples in (SAMPLES, 0))
    assert relative(found, truth) < min(0.01, 0.05 * relative(alone, truth))
