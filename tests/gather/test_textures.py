"""Textures and cut-outs in gathers by rays and planes, against means and form factors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest

from irrsplat.core.color import linear_from_srgb
from irrsplat.gather.plane import FIELD
from irrsplat.scene.model import Image, Material, Mesh, Texture
from tests.gather.test_hemisphere import share_of_plane
from tests.support.worlds import Lit, box, floor, gather, material, point_light, polygon_vector, quad, scene, sites

UP = (0.0, 1.0, 0.0)
SEEN = {"trace": 1.0, "plane": share_of_plane(FIELD)}  # share of the cosine-weighted hemisphere


def image(values: Any, alpha: Any = 255) -> Image:
    """Return an Image of grey or coloured values 0..255, (H, W) or (H, W, 3), and alpha."""
    values = np.asarray(values)
    rgb = np.repeat(values[..., None], 3, -1) if values.ndim == 2 else values
    pixels = np.concatenate([rgb, np.broadcast_to(alpha, rgb.shape[:2])[..., None]], -1)
    return Image(pixels.astype(np.uint8))


def checker(count: int, texels: int = 1) -> np.ndarray:
    """Return 0 and 1 (S, S) in squares of `texels` texels, `count` per side, the first of them 0."""
    i, j = np.indices((count, count))
    return np.kron((i + j) % 2, np.ones((texels, texels), int))


def ceiling(paint: Material, half: float = 1.0, height: float = 1.0, uv: float = 1.0) -> Mesh:
    """Return a horizontal square that faces down, with u along x and v along z from 0 to `uv`."""
    x, z = half * np.array([-1, 1, -1, 1]), half * np.array([-1, -1, 1, 1])
    positions = np.stack([x, np.full(4, height), z], -1).astype("f4")
    coordinates = uv * np.stack([x + half, z + half], -1) / (2 * half)
    faces = np.array([[0, 1, 3], [0, 3, 2]], "i4")
    uvs = np.concatenate([coordinates, np.zeros_like(coordinates)], -1).astype("f4")
    return Mesh(positions, np.tile(np.array([0.0, -1.0, 0.0], "f4"), (len(positions), 1)), faces, paint, uvs=uvs)


def glowing(texture: Texture, power: float = 1.0) -> Material:
    """Return a black material with an emission scaled by the texture."""
    return Material((0.0, 0.0, 0.0), (power,) * 3, emission_texture=texture)


def form(corners: Any, p: Any = (0.0, 0.0, 0.0)) -> float:
    """Return π times the form factor from an upward point to a polygon (C, 3)."""
    return float(polygon_vector(np.asarray(corners, float), np.asarray(p, float))[1])


def rectangle(x0: float, x1: float, z0: float, z1: float, y: float = 1.0) -> np.ndarray:
    """Return the corners (4, 3) of a horizontal rectangle."""
    return np.array([[x0, y, z0], [x1, y, z0], [x1, y, z1], [x0, y, z1]])


@pytest.mark.parametrize("kind", SEEN)
def test_E_below_a_quartered_emitter_is_the_sum_of_its_quarters(ctx: moderngl.Context, kind: str) -> None:
    """Four squares of radiance 1, 0.5 (sRGB 188), 0 and coloured: the sum of π·F, also below one quarter's centre."""
    colours = np.array([[[255, 255, 255], [188, 188, 188]], [[0, 0, 0], [255, 0, 188]]])
    texture = Texture(image(np.kron(colours, np.ones((32, 32, 1), int))))
    world = scene(ceiling(glowing(texture)))
    places = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, -0.5], [-0.6, 0.0, 0.5]])
    found = gather(ctx, world, sites(places, UP), 64, kind).E
    half = linear_from_srgb(np.array(188 / 255.0))
    truth = []
    for p in places:
        a, b, _, d = (form(rectangle(*r), p) for r in ((-1, 0, -1, 0), (0, 1, -1, 0), (-1, 0, 0, 1), (0, 1, 0, 1)))
        truth.append([a + half * b + d, a + half * b, a + half * b + half * d])
    assert np.allclose(found, truth, rtol=0.02, atol=0.02)


def test_the_second_set_of_coordinates_turned_by_a_transform(ctx: moderngl.Context) -> None:
    """Only the half with z > 0 emits: the image's u is v of the second set, a copy of the first, mirrored in x."""
    texture = Texture(image([[0] * 64 + [255] * 64] * 128), uv_set=1, transform=(0, 1, 0, 1, 0, 0))
    mesh = ceiling(glowing(texture))
    assert mesh.uvs is not None
    mesh = replace(mesh, uvs=np.column_stack([np.zeros((4, 2)), 1 - mesh.uvs[:, 0], mesh.uvs[:, 1]]).astype("f4"))
    found = gather(ctx, scene(mesh), sites((0, 0, -0.5), UP), 64).E[0, 0]
    assert found == pytest.approx(form(rectangle(-1, 1, 0, 1), (0, 0, -0.5)), rel=0.02)


@pytest.mark.parametrize("kind, count", [("trace", 64), ("plane", 512)])
def test_what_is_finer_than_a_ray_sees_is_seen_as_its_mean(ctx: moderngl.Context, kind: str, count: int) -> None:
    """A checker of 0 and 1, much finer than 16² rays: E is within 1 % of a uniform half everywhere."""
    texture = Texture(image(255 * checker(count)))
    places = np.random.default_rng(1).uniform(-0.5, 0.5, (16, 3)) * (1, 0, 1)
    fine = gather(ctx, scene(ceiling(glowing(texture), uv=4.0)), sites(places, UP), 16, kind).E
    plain = gather(ctx, scene(ceiling(material(0.0, 0.5))), sites(places, UP), 16, kind).E
    assert np.allclose(fine, plain, rtol=0.01)


def test_reflectance_is_that_of_the_vertices_times_the_texture_s(ctx: moderngl.Context) -> None:
    """A large lit plane of albedo (0.8, 0.4, 0.8) times (1, 1, 0.5) reflects ρ/π·E_light at each point."""
    texture = Texture(image(np.tile([255, 255, 188], (4, 4, 1))))
    lights = (point_light((0, 0.5, 0), 3.0),)
    paint = Material((0.5, 0.5, 0.5), albedo_texture=texture)
    mesh = ceiling(paint, 3.0)
    mesh = replace(mesh, colors=np.tile(np.array([0.8, 0.4, 0.8], "f4"), (4, 1)))
    found = gather(ctx, scene(mesh, lights=lights), sites((0, 0, 0), UP), 32).E[0]
    plain = gather(ctx, scene(ceiling(material(1.0), 3.0), lights=lights), sites((0, 0, 0), UP), 32).E[0]
    half = linear_from_srgb(np.array(188 / 255.0))
    assert np.allclose(found, plain * (0.8, 0.4, 0.8 * half), rtol=2e-3)


def fence(bars: int, alpha_mode: Any = "mask", opacity: float = 1.0) -> Material:
    """Return black bars, as wide as their gaps."""
    columns = np.repeat(np.arange(2 * bars) % 2, 4)
    return Material(
        (0.0, 0.0, 0.0),
        albedo_texture=Texture(image(np.full((8, 8 * bars), 128), 255 * columns)),
        alpha_mode=alpha_mode,
        opacity=opacity,
    )


@pytest.mark.parametrize("kind", SEEN)
def test_a_fence_below_the_sky_holds_back_its_share(ctx: moderngl.Context, kind: str) -> None:
    """E under a sky of radiance 1 is π minus the form factors of the bars, for one bar and for 16."""
    one, many = ceiling(fence(1)), ceiling(fence(16))
    aside = replace(many, positions=many.positions + np.array([10, 0, 0], "f4"))
    found = gather(ctx, scene(one, aside, sky=1.0), sites([(0.4, 0, 0), (10.4, 0, 0)], UP), 96, kind).E[:, 0]
    for bars, seen in zip((1, 16), found, strict=True):
        edges = np.linspace(-1, 1, 2 * bars + 1)
        each = (form(rectangle(a, b, -1, 1), (0.4, 0, 0)) for a, b in zip(edges[1::2], edges[2::2], strict=True))
        truth = np.pi * SEEN[kind] - sum(each)
        assert seen == pytest.approx(truth, rel=0.01)


def test_a_fine_fence_in_a_large_image_does_not_vanish(ctx: moderngl.Context) -> None:
    """Wires of one texel in eight in an image of 4096 texels, finer than any layer, block an eighth."""
    alpha = np.zeros((8, 4096))
    alpha[:, ::8] = 255
    paint = Material((0.0,) * 3, albedo_texture=Texture(image(alpha * 0, alpha)), alpha_mode="mask")
    found = gather(ctx, scene(ceiling(paint), sky=1.0), sites((0, 0, 0), UP), 96).E[0, 0]
    assert found == pytest.approx(np.pi - form(rectangle(-1, 1, -1, 1)) / 8, rel=0.03)


PASSED = {
    "thin glass": Material((1.0, 1.0, 1.0), alpha_mode="blend", opacity=0.3),
    "what transmits": Material((1.0, 1.0, 1.0), transmission=0.9),
    "what is masked all over": Material(opacity=0.2, alpha_mode="mask"),
    "a shining filter": Material(emission=(9.0, 9.0, 9.0), alpha_mode="blend", opacity=0.1),
}


@pytest.mark.parametrize("kind", SEEN)
def test_panes_change_no_light(ctx: moderngl.Context, kind: str) -> None:
    """Panes of any kind change no bit of records below them and of surfaces behind them."""
    room = quad((-2, -0.5, -2), (4, 0, 0), (0, 0, 4)), box((0.3, -0.5, 0.3), (0.6, 0.6, 0.6), material(0.7))
    lit: dict[str, Any] = {"lights": (point_light((-0.4, 3.0, 0.2), 5.0),), "sky": 0.3}
    where = sites([(0, 0, 0), (0.5, 0.2, 0.0)], [UP, (0, 0, 1)])
    far = ceiling(material(), 3.0, 4.0)  # keeps the scene's size
    panes = [ceiling(pane, 1.0 + i / 8, 0.9 + i / 8) for i, pane in enumerate(PASSED.values())]
    without = gather(ctx, scene(*room, far, **lit), where, 16, kind)
    assert np.array_equal(gather(ctx, scene(*room, *panes, far, **lit), where, 16, kind).E, without.E)


def test_opacities_of_vertices_decide_too(ctx: moderngl.Context) -> None:
    """Vertex opacity falls from 1 to 0 along x on a blended mesh: light is blocked where it is above one half."""
    mesh = ceiling(Material((0.0, 0.0, 0.0), alpha_mode="blend"))
    mesh = replace(mesh, opacities=(0.5 - 0.5 * mesh.positions[:, 0]).astype("f4"))
    found = gather(ctx, scene(mesh, sky=1.0), sites((0.2, 0, 0), UP), 64).E[0, 0]
    assert found == pytest.approx(np.pi - form(rectangle(-1, 0, -1, 1), (0.2, 0, 0)), rel=0.01)


@pytest.mark.parametrize("place", [(0.3, 1.6, 0.1)])
def test_the_shadow_of_a_cut_out_square_has_the_hole_where_it_should_be(ctx: moderngl.Context, place: Any) -> None:
    """Points of a floor are lit where their line to the light passes the hole or the square's outside.

    Records 5 mm above these points gather the floor's light, from within 5 cm of each.
    """
    alpha = np.full((64, 64), 255)
    alpha[16:32, 24:48] = 0
    paint = Material((0.0,) * 3, albedo_texture=Texture(image(alpha * 0, alpha)), alpha_mode="mask")
    card = ceiling(paint, 0.5, 1.0)
    x, z = (0.05 * (a.ravel() - 16.3) for a in np.meshgrid(np.arange(33), np.arange(33)))
    eye = np.stack([x, np.full_like(x, 0.005), z], -1)
    with Lit(ctx, scene(floor(2.0, paint=material(1.0)), card, lights=(point_light(place),)), 512) as lit:
        E = lit.gather(sites(eye, (0, -1, 0)), 4, capacity=len(eye)).E[:, 0]  # of a disc of 5 cm below
    t = (1.0 - 0.0) / (place[1] - 0.0)
    u, v = (0.5 + p + (q - p) * t for p, q in ((x, place[0]), (z, place[2])))
    inside = (np.abs(u - 0.5) <= 0.5) & (np.abs(v - 0.5) <= 0.5)
    hole = (u > 24 / 64) & (u < 48 / 64) & (v > 16 / 64) & (v < 32 / 64)
    edge = np.minimum.reduce([abs(u - e) for e in (0, 24 / 64, 48 / 64, 1)] + [abs(v - e) for e in (0, 16 / 64, 32 / 64, 1)])
    clear = edge > 0.08
    assert (hole & clear).sum() > 20 and (inside & ~hole & clear).sum() > 100
    assert (E[(hole | ~inside) & clear] > 1e-2).all()
    assert (E[inside & ~hole & clear] == 0.0).all()
