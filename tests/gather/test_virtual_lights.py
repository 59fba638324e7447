"""Virtual lights: what a lamp lights close by is found by its own rays, and counts once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.core.glsl import VIRTUAL_SETS
from irrsplat.gpu.target import pixels
from irrsplat.lighting.virtual_lights import VirtualLights, virtual_lights
from irrsplat.scene.model import Camera, Light
from tests.gather.test_light_samples import look, relative
from tests.support.worlds import Lit, box, lamp, material, quad, scene

ALBEDO, POWER = 0.6, 5.0
BELOW = 0.05  # metres from the ceiling to the lamp
HEIGHT = 3.0  # of the ceiling, metres
SAMPLES, RAYS = 512, 64**2 / np.pi
UP = np.array((0.0, 1.0, 0.0))
LAMP = lamp((0.2, HEIGHT - BELOW, 0.1), POWER)
DARK = box((-4, 0, -4), (4, HEIGHT, 4), material(0.0), outward=False)
CEILING = quad((-3.99, HEIGHT - 1e-3, -3.99), (7.98, 0, 0), (0, 0, 7.98), material(ALBEDO))


def from_ceiling(where: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(N,) W/m² at points (N, 3) that face `normal`, from the ceiling that LAMP lights: rings about it, ever wider."""
    x, height = np.asarray(LAMP.position), HEIGHT - 1e-3
    h = height - x[1]
    # equal shares of the lamp's light: 1 - h/√(h² + s²) is even
    share, angle = (np.arange(1000) + 0.5) / 1000, (np.arange(64) + 0.5) * (2.0 * np.pi / 64)
    s = h * np.sqrt(1.0 / (1.0 - share) ** 2 - 1.0)
    at = np.stack(np.broadcast_arrays(x[0] + s[:, None] * np.cos(angle), height, x[2] + s[:, None] * np.sin(angle)), axis=-1)
    inside = (np.abs(at[..., ::2]) < 3.99).all(-1)
    flux = 2.0 * np.pi * POWER / inside.size * inside  # of all that goes up
    away = at[None] - np.asarray(where)[:, None, None]
    r2 = (away**2).sum(-1)
    found: np.ndarray = (flux * ALBEDO / np.pi * away[..., 1] * np.maximum(away @ normal, 0.0) / r2**2).sum((1, 2))
    return found


def gradients(where: np.ndarray, normal: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(N, 2) of that along the `axes` (2, 3), W/m³."""
    step = 1e-3 * axes
    change = [from_ceiling(where + d, normal) - from_ceiling(where - d, normal) for d in step]
    return np.stack(change, axis=-1) / 2e-3


@pytest.mark.parametrize("kind", ["trace", "embree", "raster"])
def test_a_bright_spot_on_the_ceiling_lights_a_wall(ctx: moderngl.Context, kind: str) -> None:
    """Its light counts once, whichever way it comes; records at the wall, which see it at a low angle, know it far better than by
    few rays alone, and how it changes."""
    where, normal = np.random.default_rng(1).uniform((-2, 1.5, -1.5), (-1.5, 2.8, 1.5), (24, 3)), np.array((1.0, 0.0, 0.0))
    axes = np.array([(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
    truth, slope = from_ceiling(where, normal), gradients(where, normal, axes)
    with Lit(ctx, scene(DARK, CEILING, lights=(LAMP,)), 1024) as lit:
        alone, found = (look(lit, where, normal, samples, kind, side=32) for samples in (0, SAMPLES))
    assert relative(found.E[:, 0], truth) < min(0.01, 0.4 * relative(alone.E[:, 0], truth))
    assert found.E[:, 0].mean() == pytest.approx(truth.mean(), rel=0.005), "nothing is missing, nor counted twice"
    off = np.linalg.norm(found.gradient[:, 0] @ axes.T - slope, axis=1) / np.linalg.norm(slope, axis=1)
    assert np.median(off) < 0.05


@pytest.mark.parametrize("kind", ["trace", "raster"])
def test_the_floor_below_it_is_lit_as_exactly(ctx: moderngl.Context, kind: str) -> None:
    """Where rays alone see a spot well: all that its points add is told well, too, and records differ in their errors."""
    where = np.random.default_rng(1).uniform((-2, 0, -2), (2, 0, 2), (64, 3))
    truth = from_ceiling(where, UP)
    with Lit(ctx, scene(DARK, CEILING, lights=(LAMP,)), 1024) as lit:
        found = look(lit, where, UP, SAMPLES, kind).E[:, 0]
    assert relative(found, truth) < 0.003
    assert found.mean() == pytest.approx(truth.mean(), rel=0.002)


def test_near_the_spot_rays_have_their_say(ctx: moderngl.Context) -> None:
    """Points of a spot seen from close by would be a few bright dots: rays count there, by the balance heuristic."""
    where = np.column_stack([np.linspace(-0.3, 0.5, 9), np.full(9, HEIGHT - 0.3), np.full(9, 0.1)])
    with Lit(ctx, scene(DARK, CEILING, lights=(LAMP,)), 1024) as lit:
        found = look(lit, where, UP, SAMPLES).E[:, 0]
    assert relative(found, from_ceiling(where, UP)) < 0.03


def test_what_stands_in_the_way_hides_them(ctx: moderngl.Context) -> None:
    """Under a board that hides the spot there is nothing but what comes past it."""
    board = quad((-1.0, 1.5, -1.0), (2.4, 0, 0), (0, 0, 2.2), material(0.0))
    where = np.array([(0.2, 0.0, 0.1), (0.3, 0.0, 0.0)])
    with Lit(ctx, scene(DARK, CEILING, board, lights=(LAMP,)), 1024) as lit:
        assert (look(lit, where, UP, SAMPLES).E[:, 0] < 0.05 * from_ceiling(where, UP)).all()


def of(lit: Lit, *lights: Light) -> VirtualLights | None:
    """Those of these lamps in the room."""
    change = replace(lit.world.scene, lights=lights)
    lit.world._scene = change
    return virtual_lights(lit.world, SAMPLES, RAYS)


def test_lamps_have_them_where_they_light_spots(ctx: moderngl.Context) -> None:
    middle, cone = lamp((0.0, 1.5, 0.0), POWER), replace(LAMP, spot_target=(0.2, 0.0, 0.1), spot_cutoff=60.0, spot_inner=60.0)
    sun = Light(position=(0.0, 1.0, 0.2), color=(1.0, 1.0, 1.0), directional=True)
    with Lit(ctx, scene(DARK, CEILING, lights=(LAMP,)), 64) as lit:
        assert of(lit, sun) is None and of(lit) is None
        assert of(lit, cone) is None, "it shines away from the ceiling"
        alone = of(lit, LAMP)
        assert alone is not None and 0.3 * SAMPLES < alone.count < 0.5 * SAMPLES, "those of its rays that go up"
        assert of(lit, replace(LAMP, color=(0.0, 9.0, 1.0))) is alone, "they are there however bright it is"
        both = of(lit, LAMP, sun, middle)
        assert both is not None and (both.reach[:, 0] > 0.0).tolist() == [True, False, bool(both.reach[2, 0])]
        moved = of(lit, replace(LAMP, position=(1.0, HEIGHT - BELOW, 0.1)))
        assert moved is not None and moved is not alone
        uniforms = moved.sample_uniforms(lit.light.shadows)
        places = pixels(uniforms["virtual_places"])[::-1]
        assert places.shape == (3 * VIRTUAL_SETS, moved.count, 4)
        near = places[::3][places[1::3, :, 1] < 0.0]  # the ceiling's normals; at the end of a set some have none
        assert np.allclose(near[:, 1], HEIGHT - 1e-3, atol=1e-3)
        assert np.allclose(near.mean(0)[[0, 2]], (1.0, 0.1), atol=0.05)


def test_pictures_follow_a_lamp_along_the_ceiling(ctx: moderngl.Context) -> None:
    """After it has moved, in ticks, there is the light of the new place, as a renderer has it that knows no other."""
    settings: Any = {"gather_size": 16, "bounces": 1, "shadow_size": 256, "max_rounds": 6}
    room = scene(box((-2, 0, -2), (2, HEIGHT, 2), material(0.5), outward=False), lights=(LAMP,))
    where = Camera(eye=(0.0, 1.2, 1.9), target=(0.0, 1.2, 0.0), up=(0.0, 1.0, 0.0))
    with Renderer(room, (32, 24), ctx=ctx, **settings) as renderer:
        renderer.render(where)
        for x in (0.0, -0.4, -0.8):
            moved = replace(room, lights=(replace(LAMP, position=(x, HEIGHT - BELOW, 0.1)),))
            renderer.relight(moved.lights)
            renderer.frame(where, seconds=0.02)
        ours = renderer.render(where)
        with Renderer(moved, (32, 24), ctx=ctx, **settings) as fresh:
            theirs = fresh.render(where)
    off = np.sqrt(np.mean((ours.irradiance - theirs.irradiance) ** 2)) / theirs.irradiance.mean()
    assert off < 0.05
