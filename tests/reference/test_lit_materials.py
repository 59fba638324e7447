"""The path tracer on textures, masks, glass, normal maps, skies and emitting surfaces, where Mitsuba is: against formulas."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from irrsplat.core.color import LUMINOUS_EFFICACY
from irrsplat.scene.model import Camera, Image, Light, Material, Mesh, Scene, Texture
from irrsplat.sky.cie import CieSky
from irrsplat.sky.sphere import texel_directions
from tests.support.skies import cie, irradiance, mapped
from tests.support.truth import cast
from tests.support.worlds import box, floor, material, point_light, polygon_vector, quad, scene

UP = np.array([[0.0, 1.0, 0.0]], "f4")
CAMERA = Camera((0.0, 2.0, 0.1), (0.0, 0.0, 0.0))


def worn(mesh: Mesh, repeats: float = 1.0) -> Mesh:
    """A quad with texture coordinates: the image's right runs along its first side, and up along its second."""
    uvs = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "f4") * np.float32(repeats)
    return replace(mesh, uvs=np.tile(uvs, 2))


def image(red: Any, green: Any = 0, blue: Any = 0, alpha: Any = 255) -> Image:
    """An image of these channels, numbers or (H, W)."""
    return Image(np.stack(np.broadcast_arrays(np.atleast_2d(red), green, blue, alpha), axis=-1).astype(np.uint8))


CHECKER = 255 * (np.indices((2, 2)).sum(0) % 2)


def squares(height: float, side: int, half: float) -> np.ndarray:
    """(side², 4, 3) the corners of the squares of a checkered floor, row by row from -z on."""
    s = np.linspace(-half, half, side + 1)
    return np.array(
        [[[s[i], height, s[j]], [s[i + 1], height, s[j]], [s[i + 1], height, s[j + 1]], [s[i], height, s[j + 1]]]
         for j in range(side) for i in range(side)]
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["albedo", "emission", "mask"])
def test_a_checkered_floor_seen_by_a_point(mitsuba: Any, kind: str) -> None:
    """From 0.7 above 8×8 squares, looking down, each by Lambert's formula. Under a sky of 1, reflecting squares add π·ρ·F,
    emitting squares L·F, and missing squares show a sky of 1."""
    texture = Texture(image(CHECKER, CHECKER, CHECKER, CHECKER if kind == "mask" else 255), nearest=True)
    paint = {
        "albedo": Material((0.8, 0.4, 0.2), albedo_texture=texture),
        "emission": Material((0.0, 0.0, 0.0), (3.0, 2.0, 1.0), emission_texture=texture),
        "mask": Material((0.0, 0.0, 0.0), albedo_texture=texture, alpha_mode="mask"),
    }[kind]
    world = scene(worn(floor(1.0, 0.0, paint), 4.0), sky=0.0 if kind == "emission" else 1.0)
    p = np.array([0.13, 0.7, -0.22])
    share = -polygon_vector(squares(0.0, 8, 1.0), p)[:, 1]
    lit = (np.indices((8, 8)).sum(0) % 2).ravel() == 1
    beside = np.pi - share.sum()
    expected = {
        "albedo": beside + share[lit].sum() * np.array([0.8, 0.4, 0.2]),
        "emission": share[lit].sum() * np.array([3.0, 2.0, 1.0]),
        "mask": beside + share[~lit].sum() * np.ones(3),
    }[kind]
    E = mitsuba.Tracer(world).irradiance(p[None].astype("f4"), -UP, -UP, 300, 1, 2)
    assert 0.1 < share[lit].sum() < np.pi / 2
    assert np.allclose(E[0], expected, rtol=0.004)


@pytest.mark.parametrize("power", [False, True])
def test_a_panel_over_a_plane(mitsuba: Any, power: bool) -> None:
    """By Lambert's formula, with two panels sampled as lights and without. Half of one panel is dark by its texture.

    A scene that mostly emits has no next-event estimation of emitters.
    """
    panel = quad((0.2, 0.5, 0.1), (0.3, 0, 0), (0, 0, 0.2), Material((0, 0, 0), (2.0, 4.0, 6.0)))
    half = Texture(image([[255, 0]], [[255, 0]], [[255, 0]]), nearest=True)
    other = worn(quad((-0.9, 0.2, 0.1), (0.4, 0.1, 0), (0, 0, 0.3), Material((0, 0, 0), (1.0, 1.0, 1.0), emission_texture=half)))
    tracer = mitsuba.Tracer(scene(*[floor(3.0)] * power, panel, other))
    p = np.stack([np.linspace(-0.5, 0.5, 9), np.zeros(9), np.full(9, 0.2)], axis=1)
    bright = other.positions.copy()
    bright[1:3] = (other.positions[[0, 3]] + other.positions[[1, 2]]) / 2
    expected = polygon_vector(panel.positions, p)[:, 1:2] * [2.0, 4.0, 6.0] + polygon_vector(bright, p)[:, 1:2]
    E = tracer.irradiance(p.astype("f4"), *[np.tile(UP, (9, 1))] * 2, 128, 3)
    assert (tracer.emitters is not None) == power
    assert np.allclose(E, expected, rtol=0.02 if power else 0.1)


def test_a_furnace_with_masks_and_glass(mitsuba: Any) -> None:
    """Whatever a ray passes or hits emits like the walls: E_N = π·L·(1 + ρ + …). Panes may emit or not, and a mask has holes."""
    glow = Material((0.5, 0.5, 0.5), (1.0, 1.0, 1.0))
    holes = Texture(image(255, 255, 255, CHECKER))
    leaf = replace(glow, albedo_texture=holes, alpha_mode="mask")
    pane = Material((0.1, 0.2, 0.3), (9.0, 9.0, 9.0), transmission=0.9)
    faint = Material((0.1, 0.2, 0.3), alpha_mode="blend", opacity=0.3)
    sheets = ((0.2, leaf), (0.0, pane), (-0.3, faint), (0.4, leaf))
    middle = [worn(quad((-0.8, y, 0.8), (1.6, 0, 0), (0, 0, -1.6), paint), 3.0) for y, paint in sheets]
    world = scene(box((-1, -1, -1), (1, 1, 1), glow), *middle)
    p = np.array([[0.3, -1.0, 0.2], [-0.6, -1.0, 0.6]], "f4")
    up = np.tile(UP, (2, 1))
    for bounces in (1, 3):
        E = mitsuba.Tracer(world).irradiance(p, up, up, 32, 1, bounces)
        assert np.allclose(E, np.pi * sum(0.5**k for k in range(bounces)), rtol=1e-3)


def test_shadows_fall_through_the_holes_of_a_mask(mitsuba: Any) -> None:
    """A light and the sun pass every other stripe of a sheet, and a second sheet with missing corners."""
    stripes = Texture(image(255, 255, 255, [[0, 255]]), wrap=("repeat", "clamp"), nearest=True)
    paint = Material(albedo_texture=stripes, alpha_mode="mask")
    sheets = [worn(floor(1.0, height, paint), 2.0) for height in (1.0, 1.001)]
    sun = Light((0.0, 2.0, 0.0), (1.0, 1.0, 1.0), directional=True, physical=True)
    world = scene(floor(3.0), *sheets, lights=(point_light((0.0, 4.0, 0.0)), sun))
    tracer = mitsuba.Tracer(world)
    x = np.linspace(-0.99, 0.98, 40)
    p, up = np.stack([x, 0 * x, 0.1 + 0 * x], axis=1), np.tile(UP, (40, 1))
    hit = mitsuba.Hit(
        mitsuba.mi.Bool(np.ones(40, bool)), *(mitsuba.mi.Vector3f(a.T) for a in (p, up, up, up, up)), mitsuba.mi.UInt32(0), False
    )
    for light, at in zip(world.lights, (0.75 * x, x), strict=True):
        E = np.array(tracer.lit(light, hit)[0])[0]
        open_ = np.floor((at + 1.0) * 2.0) % 2 == 0
        assert np.array_equal(E > 0.0, open_) and 10 < open_.sum() < 30
    assert E.max() == pytest.approx(1.0), "the colour of a physical sun is its irradiance"


@pytest.mark.parametrize("gradient", [0.0, 0.8])
def test_a_tilted_normal_map_under_a_sky_that_is_brighter_above(mitsuba: Any, gradient: float) -> None:
    """E about the mapped normal, directions below the floor left out, summed over a fine grid; a whole view of it."""
    from irrsplat.reference import trace_view

    texels = np.array([190, 150, 225])
    texture = Texture(image(*texels))
    ground = worn(floor(2.0, paint=Material((0.6, 0.6, 0.6), normal_texture=texture)))
    n = texels / 255.0 * 2.0 - 1.0
    n = n[[0, 2, 1]] * [1, 1, -1] / np.linalg.norm(n)
    cosine, phi = np.meshgrid((np.arange(400) + 0.5) / 400, 2 * np.pi * (np.arange(400) + 0.5) / 400)
    sine = np.sqrt(1.0 - cosine**2)
    d = np.stack([sine * np.cos(phi), cosine, sine * np.sin(phi)], -1).reshape(-1, 3)
    world = Scene((ground,), (), (CAMERA,), sky=(1.0, 1.0, 1.0), sky_gradient=(gradient, 0.0, -gradient))
    expected = (world.sky_radiance(d) * np.maximum(d @ n, 0.0)[:, None]).mean(0) * 2.0 * np.pi
    truth = trace_view.trace(world, CAMERA, (8, 6), 32, 1, lambda share: None)
    assert truth["valid"].any() and np.allclose(truth["normal"][truth["valid"]], n, atol=1e-6)
    assert np.allclose(truth["halves"].mean(0)[truth["valid"]], expected, rtol=0.01)
    if not gradient:
        assert np.allclose(expected, np.pi * (1.0 + n[1]) / 2.0, rtol=1e-3)


def test_a_view_of_the_tracer_is_that_of_the_caster(mitsuba: Any) -> None:
    """Two finders of hits, with a mask, a filter and a map in the view; textures finer than pixels become their mean."""
    from irrsplat.reference import trace_view

    noise = np.random.default_rng(1).integers(0, 256, (3, 64, 64))
    maps = Texture(image(noise[0], noise[1], noise[2], noise[0]))
    meshes = [
        worn(floor(2.0, 0.0, Material((0.9, 0.7, 0.5), albedo_texture=maps)), 0.2),
        worn(floor(0.5, 0.6, Material(albedo_texture=maps, alpha_mode="mask")), 0.2),
        worn(floor(0.8, 1.0, Material((0.2, 0.4, 0.6), alpha_mode="blend", opacity=0.4))),
    ]
    world = scene(*meshes, sky=1.0, camera=CAMERA)
    found = mitsuba.view(mitsuba.Tracer(world), CAMERA, (40, 30)).image((40, 30))
    expected = cast(world, CAMERA, (40, 30))
    for name in ("seen", "position", "albedo", "tint", "opacity"):
        off = np.abs(getattr(found, name).astype(float) - getattr(expected, name))
        assert np.quantile(off, 0.98) < 1e-4, name
    assert len(np.unique(expected.tint)) > 2 and np.ptp(expected.position[..., 1]) > 0.5
    fine = scene(worn(floor(2.0, 0.0, Material(albedo_texture=maps)), 64.0), camera=CAMERA)
    truth = trace_view.trace(fine, CAMERA, (40, 30), 1, 1, lambda share: None)
    spread = [np.std(a[truth["valid"]] if a.ndim == 3 else a) for a in (truth["albedo"], cast(fine, CAMERA, (40, 30)).albedo)]
    assert spread[0] == pytest.approx(spread[1] / 4.0, rel=0.15)  # 16 more texels a pixel


def test_a_map_and_an_overcast_sky(mitsuba: Any) -> None:
    """A map's light on six planes, turned by 40°, against its own sum, and Moon and Spencer's 7/9·π·L_z: within 1 %."""
    from irrsplat.reference.path_tracer import Tracer

    sky = CieSky("overcast", 30.0, ground=0.0)
    away = floor(0.1, -50.0, material(0.0))
    found = Tracer(cie(scene(away), sky)).irradiance(np.zeros((1, 3)), UP, UP, 64, 1)
    assert found == pytest.approx(np.full((1, 3), 7.0 / 9.0 * np.pi * sky.zenith_luminance / LUMINOUS_EFFICACY), rel=0.01)
    radiance = (2.0 + texel_directions(32, 64) + np.random.default_rng(0).random((32, 64, 3))).astype("f4")
    world = mapped(scene(away), radiance, 40.0)
    assert world.environment is not None
    normals = np.concatenate([np.eye(3), -np.eye(3)])
    found = Tracer(world).irradiance(np.zeros((6, 3)), normals, normals, 64, 1)
    assert np.allclose(found, irradiance(radiance, normals @ world.environment.frame.T), rtol=0.01)
