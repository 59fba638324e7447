"""Normal maps: the normal that a pixel has, and the light that it brings, against the geometry that the map stands for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.scene.model import Camera, Image, Light, Material, Mesh, Scene, Texture
from tests.image.test_textures import HEAD_ON, image, seen, square
from tests.support.worlds import scene

UPRIGHT = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "f4")  # (0, 0) is up left


def stored(normal: tuple[float, float, float]) -> Image:
    """A map that has this normal everywhere: right, up in the image, and outward."""
    unit = np.asarray(normal) / np.linalg.norm(normal)
    return image(np.broadcast_to(np.round(255.0 * (0.5 * unit + 0.5)), (2, 2, 3)))


def bumpy(normal: tuple[float, float, float], **rest: Any) -> Material:
    """A white material with that map."""
    return Material(albedo=(1.0, 1.0, 1.0), normal_texture=Texture(stored(normal)), **rest)


def tilted(degrees: float) -> tuple[float, float, float]:
    """The normal of a surface that is turned so far to the right."""
    return float(np.sin(np.radians(degrees))), 0.0, float(np.cos(np.radians(degrees)))


def mapped(ctx: moderngl.Context, mesh: Mesh, camera: Camera = HEAD_ON) -> np.ndarray:
    """(3,) the one normal that all pixels have."""
    normals = seen(ctx, scene(mesh, camera=camera), (8, 8))["mapped"][..., :3].reshape(-1, 3)
    assert np.abs(normals - normals[0]).max() < 1e-3
    one: np.ndarray = normals[0]
    return one


# how the image lies on the square: the corners' coordinates, and where its right and its up point then
LAID = {
    "upright": (UPRIGHT, (1, 0, 0), (0, 1, 0)),
    "mirrored": (np.array([[1, 1], [0, 1], [0, 0], [1, 0]], "f4"), (-1, 0, 0), (0, 1, 0)),
    # u = (x + 1)/2 + (y + 1)/4 and v = (1 - y)/2: gradients (2, 1)/4 and, upward, (0, 2)/4, of which the longer one is made unit
    "sheared": (np.array([[0, 1], [1, 1], [1.5, 0], [0.5, 0]], "f4"), (2 / 5**0.5, 1 / 5**0.5, 0), (0, 2 / 5**0.5, 0)),
}


@pytest.mark.parametrize("name", LAID)
def test_a_map_is_turned_as_its_image_lies_on_the_surface(ctx: moderngl.Context, name: str) -> None:
    """n = x·right + y·up + z·out, right and up being the gradients of the image's coordinates."""
    uvs, right, up = LAID[name]
    x, y, z = normal = np.array((0.4, 0.3, 0.866)) / np.linalg.norm((0.4, 0.3, 0.866))
    found = mapped(ctx, square(bumpy(tuple(normal)), uvs))
    requested = x * np.asarray(right) + y * np.asarray(up) + z * np.array((0, 0, 1))
    assert np.abs(found - requested / np.linalg.norm(requested)).max() < 0.012  # steps of 1/127


def test_from_behind_a_bump_is_a_dent(ctx: moderngl.Context) -> None:
    """A slope that rises to the right in front falls to the right behind: the opposite normal."""
    behind = replace(HEAD_ON, eye=(0.0, 0.0, -2.0))
    normal = tilted(30.0)
    assert np.abs(mapped(ctx, square(bumpy(normal), UPRIGHT), behind) + np.asarray(normal)).max() < 0.012


def test_the_scale_is_a_factor_on_what_is_not_outward(ctx: moderngl.Context) -> None:
    requested = np.array((0.5 * np.tan(np.radians(30.0)), 0.0, 1.0))
    found = mapped(ctx, square(bumpy(tilted(30.0), normal_scale=0.5), UPRIGHT))
    assert np.abs(found - requested / np.linalg.norm(requested)).max() < 0.012


@pytest.mark.parametrize(
    "uvs", [np.zeros((4, 2), "f4"), UPRIGHT * [1, 0], np.full((4, 2), 1e30, "f4")], ids=["a point", "a line", "far"]
)
def test_coordinates_without_extent_leave_a_normal(ctx: moderngl.Context, uvs: np.ndarray) -> None:
    """Finite, unit, and on the side that is seen."""
    found = seen(ctx, scene(square(bumpy((0.6, 0.0, 0.8)), uvs.astype("f4")), camera=HEAD_ON), (8, 8))["mapped"][..., :3]
    assert np.isfinite(found).all() and np.allclose(np.linalg.norm(found, axis=-1), 1.0, atol=1e-4) and (found[..., 2] > 0).all()


def test_normals_below_the_surface_are_bent_up_to_it(ctx: moderngl.Context) -> None:
    """A smooth normal that leans by 60° to the right, and a map that tilts it by another 60°: along the surface, not below it."""
    leaning = np.tile(np.array(tilted(60.0), "f4"), (4, 1))
    found = mapped(ctx, replace(square(bumpy(tilted(60.0)), UPRIGHT), normals=leaning))
    assert np.abs(found - (1.0, 0.0, 0.0)).max() < 0.02


def gathered(world: Scene) -> irrsplat.Frame:
    """A picture with one bounce, of 8×8 pixels."""
    return irrsplat.render(world, (8, 8), bounces=1, gather="trace", gather_size=32)


def _truth(normal: np.ndarray, sky: float, gradient: float) -> float:
    """∫ (sky + gradient·ω·x)·(n·ω) over the directions above the surface z = 0 and above the bent one, by quadrature."""
    cosine, angle = np.meshgrid((np.arange(400) + 0.5) / 400, (np.arange(800) + 0.5) / 800 * 2 * np.pi, indexing="ij")
    sine = np.sqrt(1 - cosine**2)
    ways = np.stack([sine * np.cos(angle), sine * np.sin(angle), cosine], -1)
    radiance = sky + gradient * ways[..., 0]
    return float((radiance * np.maximum(ways @ normal, 0.0)).mean() * 2 * np.pi)


@pytest.mark.parametrize(("sky", "gradient", "degrees"), [(1.0, 0.0, 45.0), (1.0, 1.0, 15.0), (2.0, -1.0, -45.0)])
def test_irradiance_is_that_of_the_bent_normal(sky: float, gradient: float, degrees: float) -> None:
    """Under a sky that is brighter to the right, what the surface itself hides left out: within 2 %."""
    world = replace(scene(square(bumpy(tilted(degrees)), UPRIGHT), sky=sky, camera=HEAD_ON), up=(1.0, 0.0, 0.0))
    world = replace(world, sky_gradient=(gradient,) * 3)
    frame = gathered(world)
    found, requested = frame.irradiance.mean((0, 1)), _truth(np.asarray(tilted(degrees)), sky, gradient)
    assert np.abs(found / requested - 1.0).max() < 0.02
    assert np.allclose(frame.smooth_normal, (0, 0, 1), atol=1e-6) and np.allclose(frame.records_normal, (0, 0, 1), atol=1e-6)
    assert np.allclose(frame.normal, tilted(degrees), atol=0.012)


def test_lights_use_the_bent_normal() -> None:
    """ρ/π·E_direct with E = π·n·l, and nothing from below the surface itself."""
    normal, light = np.asarray(tilted(40.0)), np.asarray(tilted(60.0))
    sun = Light(tuple(light), (1.0, 1.0, 1.0), directional=True)
    low = Light(tilted(100.0), (1.0, 1.0, 1.0), directional=True)
    for lights, requested in (((sun,), normal @ light), ((low,), 0.0)):
        world = scene(square(bumpy(tilted(40.0)), UPRIGHT), lights=lights, camera=HEAD_ON)
        frame = irrsplat.render(world, (8, 8), bounces=0)
        assert np.abs(frame.direct - requested).max() < 0.012
