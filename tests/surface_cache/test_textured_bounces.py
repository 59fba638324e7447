"""Further bounces off textured walls, behind panes and through holes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest

from irrsplat.core.color import srgb
from irrsplat.scene.model import Image, Material, Mesh, Scene, Texture
from tests.support.worlds import box, material, point_light, quad, scene, sites
from tests.surface_cache.test_bounces import advance, few, gathered, made, values

__all__ = ["few"]

PLACES = np.array([[0.0, -0.99, 0.0], [0.5, -0.99, 0.6], [-0.5, 0.2, -0.99], [0.99, 0.3, 0.2]])
WHOLE = np.array([[0, 0, 0, 0], [1, 0, 0, 0], [1, 1, 0, 0], [0, 1, 0, 0]], "f4")  # the image, from corner to corner of a quad
NORMALS = np.array([[0, 1, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0]])


def pattern(colours: Any) -> Texture:
    """Return a texture of linear colours (H, W) or (H, W, 3)."""
    colours = np.asarray(colours, float)
    rgb = np.repeat(colours[..., None], 3, -1) if colours.ndim == 2 else colours
    pixels = np.concatenate([np.round(255 * srgb(rgb)), np.full((*rgb.shape[:2], 1), 255.0)], -1)
    return Texture(Image(pixels.astype(np.uint8)))


def mapped(mesh: Mesh, paint: Material) -> Mesh:
    """Return a quad with the whole image: u along its first edge, v along its second."""
    return replace(mesh, material=paint, uvs=WHOLE)


def room(wall: Material, *more: Mesh) -> Scene:
    """Return a lit room with grey walls and `wall` on the left wall and the floor."""
    left = mapped(quad((-1, -1, -1), (0, 0, 2), (0, 2, 0)), wall)
    bottom = mapped(quad((-1, -1, -1), (2, 0, 0), (0, 0, 2)), wall)
    paint = material(0.7)
    others = (
        quad((-1, 1, -1), (2, 0, 0), (0, 0, 2), paint),
        quad((1, -1, -1), (0, 2, 0), (0, 0, 2), paint),
        quad((-1, -1, -1), (2, 0, 0), (0, 2, 0), paint),
        quad((-1, -1, 1), (2, 0, 0), (0, 2, 0), paint),
    )
    return scene(left, bottom, *others, *more, lights=(point_light((0.1, 0.5, 0.2), 3.0),))


def lit(ctx: moderngl.Context, world: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return E at PLACES, and the mean of the surface cache."""
    with made(ctx, world, gather="trace") as renderer:
        return gathered(renderer, sites(PLACES, NORMALS)), values(renderer)[2:].mean(0)


def grey(ctx: moderngl.Context) -> tuple[np.ndarray, np.ndarray]:
    """Return the values for a wall and a floor of reflectance 0.5."""
    return lit(ctx, room(material(0.5)))


@pytest.mark.long
def test_a_fine_checker_lights_a_room_as_its_mean_does(ctx: moderngl.Context) -> None:
    """Walls of 0 and 1 in squares of 1.5 cm match walls of 0.5: records within 1.5 %, the cache's mean within 0.5 %."""
    fine = Material((1.0, 1.0, 1.0), albedo_texture=pattern(np.indices((128, 128)).sum(0) % 2))
    (found, mean), (truth, level) = lit(ctx, room(fine)), grey(ctx)
    assert np.allclose(found, truth, rtol=0.015)
    assert np.allclose(mean, level, rtol=0.005)


@pytest.mark.long
def test_each_half_of_a_wall_bleeds_where_it_is(ctx: moderngl.Context) -> None:
    """A wall and a floor, red where z < 0 and green beyond, colour the light of further bounces nearby.

    A wall of a red and a green quad gives equal values.
    """
    red, green = (0.8, 0.02, 0.02), (0.02, 0.8, 0.02)
    halves = np.array([[red] * 32 + [green] * 32] * 64)
    one = Material((1.0, 1.0, 1.0), albedo_texture=pattern(halves))
    other = Material((1.0, 1.0, 1.0), albedo_texture=pattern(halves.swapaxes(0, 1)))
    world = room(one)
    world = replace(world, meshes=(world.meshes[0], replace(world.meshes[1], material=other), *world.meshes[2:]))
    parts = [
        quad(corner, u, v, material(colour))
        for z, colour in ((-1, red), (0, green))
        for corner, u, v in (((-1, -1, z), (0, 0, 1), (0, 2, 0)), ((-1, -1, z), (2, 0, 0), (0, 0, 1)))
    ]
    truth, level = lit(ctx, replace(world, meshes=(*parts, *world.meshes[2:])))
    found, mean = lit(ctx, world)
    assert np.allclose(found, truth, rtol=0.04)
    assert np.allclose(mean, level, rtol=0.03)  # the sites differ
    assert found[2, 0] > 1.1 * found[2, 1] and found[1, 1] > found[1, 0]


@pytest.mark.usefixtures("few")
def test_panes_take_no_part_in_bounces(ctx: moderngl.Context) -> None:
    """Panes change no bit, for rasters and rays, and neither does a moving pane."""
    glass = quad((-0.9, 0.0, -0.9), (1.8, 0, 0), (0, 0, 1.8), Material((1.0, 1.0, 1.0), alpha_mode="blend", opacity=0.2))
    truth, level = grey(ctx)
    with made(ctx, room(material(0.5), replace(glass, name="pane")), gather="trace") as renderer:
        assert np.array_equal(gathered(renderer, sites(PLACES, NORMALS)), truth)
        assert np.array_equal(values(renderer)[2:].mean(0), level)
        renderer.move("pane", np.diag([0.5, 1.0, 0.5, 1.0]))
        advance(renderer)
        assert np.allclose(gathered(renderer, sites(PLACES, NORMALS)), truth, rtol=0.01)  # from other sites


@pytest.mark.usefixtures("few")
def test_light_bounces_through_holes(ctx: moderngl.Context) -> None:
    """A box around the light with fully transparent walls has no effect; one with half-cut sides keeps some light inside."""
    paint = Material((0.0, 0.0, 0.0), alpha_mode="mask")
    case = replace(box((-0.2, 0.2, -0.1), (0.4, 0.8, 0.5), paint), uvs=np.tile(WHOLE, (6, 1)))
    found, (truth, _) = [], grey(ctx)
    for alpha in (0, 255):
        pixels = np.array([[[0, 0, 0, alpha], [0, 0, 0, 0]]], np.uint8)
        wearing = replace(paint, albedo_texture=Texture(Image(pixels)))
        found.append(lit(ctx, room(material(0.5), replace(case, material=wearing)))[0] / truth)
    assert np.allclose(found[0], 1.0, rtol=1e-6)
    assert ((found[1] > 0.2) & (found[1] < 0.8)).all()
