"""The reference's parts without Mitsuba: texture lookup, normal maps, visible surfaces, emitters; compared with numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat.core.color import LUMINANCE, linear_from_srgb
from irrsplat.reference.emitters import Emitters
from irrsplat.reference.surfaces import Surfaces
from irrsplat.reference.textures import NUMPY, TextureTable
from irrsplat.scene.emitters import emitters
from irrsplat.scene.model import Camera, Image, Material, Mesh, Texture
from tests.support.truth import cast
from tests.support.worlds import floor, material, polygon_vector, quad, scene

RAMP = np.arange(1, 7).reshape(2, 3) * 40  # the red of an image of two rows and three columns
ABOVE = Camera((0.0, 4.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 20.0)
BELOW = Camera((0.0, -4.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 45.0)


def image(red: Any, green: int = 90, blue: int = 30, alpha: Any = 255) -> Image:
    """An image of these channels, numbers or (H, W)."""
    channels = np.broadcast_arrays(np.atleast_2d(red), green, blue, alpha)
    return Image(np.stack(channels, axis=-1).astype(np.uint8))


def worn(mesh: Mesh) -> Mesh:
    """A quad with texture coordinates: the image's right runs along its first side, and up along its second."""
    uvs = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "f4")
    return replace(mesh, uvs=np.tile(uvs, 2))


def color(texture: Texture, u: float, v: float, linear: bool = False) -> np.ndarray:
    """(4,) a texture's colour at (u, v) of both sets; the second set is u + 0.25, v."""
    table = TextureTable.of([Texture(image(7)), texture], NUMPY)
    uvs = tuple(np.array([x]) for x in (u, v, u + 0.25, v))
    return np.array([channel[0] for channel in table.color_at(np.array([1]), uvs, linear)])


@pytest.mark.parametrize(
    ("wrap", "order"), [("repeat", [2, 0, 1, 2, 0, 1]), ("mirror", [0, 0, 1, 2, 2, 1]), ("clamp", [0, 0, 1, 2, 2, 2])]
)
@pytest.mark.parametrize("nearest", [False, True])
def test_a_texture_goes_on_as_it_wraps(wrap: Any, order: list[int], nearest: bool) -> None:
    """Texel i of three has its centre at (i + ½)/3: from i = −1 on, along u and then along v."""
    texture = Texture(image(RAMP), wrap=(wrap, "clamp"), nearest=nearest)
    found = [color(texture, (i + 0.5) / 3.0, 0.25)[0] for i in range(-1, 5)]
    assert np.allclose(found, linear_from_srgb(RAMP[0, order] / 255.0), atol=1e-6)
    texture = Texture(image(RAMP.T), wrap=("clamp", wrap), nearest=nearest)
    found = [color(texture, 0.75, (i + 0.5) / 3.0 + (4.0 if wrap != "clamp" else 0.0))[0] for i in range(-1, 5)]
    assert np.allclose(found, linear_from_srgb(RAMP[1, order] / 255.0), atol=1e-6)


def test_between_texels_their_linear_values_are_blended() -> None:
    a, b, c, d = linear_from_srgb(RAMP[:, :2].ravel() / 255.0)
    found = color(Texture(image(RAMP, alpha=[[0, 100, 0], [200, 255, 0]])), (0.5 + 0.25) / 3.0, (0.5 + 0.75) / 2.0)
    assert found[0] == pytest.approx((0.75 * a + 0.25 * b) * 0.25 + (0.75 * c + 0.25 * d) * 0.75, rel=1e-5)
    assert found[1] == pytest.approx(linear_from_srgb(np.array(90 / 255.0)), rel=1e-5)
    assert found[3] == pytest.approx((0.25 * 100 * 0.25 + (0.75 * 200 + 0.25 * 255) * 0.75) / 255.0, rel=1e-5)
    assert color(Texture(image(RAMP)), 0.5 / 3.0, 0.25, linear=True)[0] == pytest.approx(40 / 255.0)
    square = color(Texture(image(RAMP), nearest=True), (0.5 + 0.75) / 3.0, 0.49)[0]
    assert square == pytest.approx(b, rel=1e-5)


@pytest.mark.parametrize(
    ("change", "u", "v", "texel"),
    [
        ({"transform": (0.0, 1.0, 0.0, 1.0, 0.0, 0.0)}, 0.25, 0.5, (0, 1)),  # u and v are exchanged
        ({"transform": (2.0, 0.0, 1 / 3, 0.0, 1.0, 0.5)}, 1 / 12, 0.25, (1, 1)),
        ({"uv_set": 1}, 0.25, 0.25, (0, 1)),
        ({}, float("nan"), 0.25, (0, 0)),
        ({}, 0.1, float("inf"), (0, 0)),
    ],
)
def test_coordinates_are_chosen_and_transformed(change: dict[str, Any], u: float, v: float, texel: tuple[int, int]) -> None:
    texture = replace(Texture(image(RAMP), nearest=True), **change)
    assert color(texture, u, v)[0] == pytest.approx(float(linear_from_srgb(RAMP[texel] / 255.0)), rel=1e-5)


def test_albedo_and_emission_are_factor_times_texture_times_vertex_colour() -> None:
    """Four texels over a square: what a camera sees of its quarters."""
    red = np.array([[50, 100], [150, 200]])
    texture = Texture(image(red), nearest=True)
    paint = Material((0.5, 0.5, 0.5), (2.0, 2.0, 2.0), texture, texture)
    camera = Camera((0, 2, 0), (0, 0, 0), (0, 0, -1))
    for colors in (None, np.full((4, 3), (0.8, 0.4, 0.2), "f4")):
        found = cast(scene(replace(worn(floor(1.0, paint=paint)), colors=colors)), camera, (8, 8))
        factor = 0.5 if colors is None else 0.8
        decoded = linear_from_srgb(red / 255.0)
        assert found.seen.any()
        for row in range(2):
            for column in range(2):
                at = (2 + 3 * row, 2 + 3 * column)
                assert found.albedo[at][0] == pytest.approx(factor * decoded[row, column], rel=1e-5)
                assert found.emission[at][0] == pytest.approx(2.0 * decoded[row, column], rel=1e-5)


TILT = np.array([200, 160, 220]) / 255.0 * 2.0 - 1.0


@pytest.mark.parametrize(
    ("turn", "right", "up"),
    [
        ([[1, 0], [0, 1]], (1, 0, 0), (0, 0, -1)),  # the image's top lies at the far edge, -z, as worn() lays it
        ([[-1, 0], [0, 1]], (-1, 0, 0), (0, 0, -1)),  # mirrored
        ([[0, 1], [-1, 0]], (0, 0, 1), (1, 0, 0)),  # u runs along +z, and v to the left: up is +x
    ],
)
@pytest.mark.parametrize("by", ["coordinates", "transform"])
@pytest.mark.parametrize("scale", [1.0, 0.4])
@pytest.mark.parametrize("eye", [1.0, -1.0])
def test_a_normal_map_bends_along_the_image(turn: Any, right: Any, up: Any, by: str, scale: float, eye: float) -> None:
    """Red is to the right in the image, green upward in it, blue outward: x·T + y·B + z·N, on the other side its opposite."""
    texture = Texture(image(200, 160, 220))
    ground = worn(floor(1.0))
    (a, b), (c, d) = turn
    if by == "transform":
        texture = replace(texture, transform=(a, b, 0.3, c, d, 0.1))
    else:
        assert ground.uvs is not None
        ground = replace(ground, uvs=np.tile(ground.uvs[:, :2] @ np.array(turn, "f4").T, 2).astype("f4"))
    paint = Material(normal_texture=texture, normal_scale=scale)
    found = cast(scene(replace(ground, material=paint)), Camera((0.1, eye, 0.0), (0, 0, 0), (0, 0, -1)), (3, 3))
    normal = scale * TILT[0] * np.array(right) + scale * TILT[1] * np.array(up) + TILT[2] * np.array([0, 1, 0])
    assert np.allclose(found.normal[1, 1], eye * normal / np.linalg.norm(normal), atol=1e-6)
    assert np.allclose(found.smooth[1, 1], (0, eye, 0)) and np.allclose(found.geometric[1, 1], (0, eye, 0))


def test_no_normal_is_bent_below_its_surface() -> None:
    """A map of 80° on a normal that leans 40° ends in the surface; the side on which normals are stored does not count."""
    steep = Texture(image(round(127.5 + 127.5 * np.sin(np.radians(80.0))), 128, round(127.5 + 127.5 * np.cos(np.radians(80.0)))))
    ground = worn(floor(1.0, paint=Material(normal_texture=steep)))
    lean = np.tile([np.sin(np.radians(40.0)), np.cos(np.radians(40.0)), 0.0], (4, 1)).astype("f4")
    for normals in (lean, -lean):
        found = cast(scene(replace(ground, normals=normals)), ABOVE, (3, 3))
        assert np.allclose(found.normal[1, 1], (1.0, 0.0, 0.0), atol=0.01) and np.allclose(found.smooth[1, 1], lean[0], atol=1e-6)


def test_what_is_cut_out_shows_what_is_behind() -> None:
    """The left half of the upper sheet has an alpha of 0.4, the right half of 0.6, and the cutoff is a half."""
    sheet = Texture(image(255, alpha=[[102, 153]]), nearest=True)
    upper = worn(floor(1.0, 1.0, Material((1.0, 1.0, 1.0), albedo_texture=sheet, alpha_mode="mask")))
    found = cast(scene(upper, floor(1.0)), ABOVE, (4, 4))
    assert (found.position[:, :2, 1] == 0.0).all() and (found.position[:, 2:, 1] == 1.0).all()
    assert (found.opacity == 1.0).all() and (found.tint == 1.0).all()


@pytest.mark.parametrize(
    ("paint", "tint"),
    [
        (Material((0.9, 0.5, 0.1), alpha_mode="blend", opacity=0.4), 1.0 - 0.4 * (1.0 - np.array([0.9, 0.5, 0.1]))),
        (Material((0.9, 0.5, 0.1), transmission=0.9), np.array([0.9, 0.5, 0.1])),
        (
            Material((0.9, 0.5, 0.1), transmission=0.3, alpha_mode="blend", opacity=0.7),
            1.0 - 0.7 * (1.0 - np.array([0.9, 0.5, 0.1])),
        ),
        (Material((0.9, 0.5, 0.1), alpha_mode="blend", opacity=0.6), None),
        (Material((0.9, 0.5, 0.1), transmission=0.4), None),
    ],
)
def test_filters_tint_what_is_behind_them(paint: Material, tint: Any) -> None:
    """Two of them twice, wherever a pixel's ray meets them, an edge between triangles too; what holds more than half of the light
    back is a surface, and lets nothing through."""
    paint = replace(paint, emission=(0.0, 0.5, 0.0))
    found = cast(scene(floor(1.0, 1.0, paint), floor(1.0, 1.5, paint), floor(1.0)), ABOVE, (5, 5))
    opacity = paint.opacity if paint.alpha_mode == "blend" else 1.0
    assert np.allclose(found.glow, 0.0 if tint is None else 2.0 * opacity * np.array([0.0, 0.5, 0.0]))
    assert np.allclose(found.opacity, 1.0 if tint is None else opacity)
    assert np.allclose(found.tint, 1.0 if tint is None else tint**2)
    assert np.allclose(found.position[..., 1], 1.5 if tint is None else 0.0)


def test_what_is_single_sided_is_not_seen_from_behind() -> None:
    room = scene(floor(1.0, 1.0, Material(double_sided=False)), floor(1.0))
    assert np.allclose(cast(room, ABOVE, (3, 3)).position[..., 1], 1.0)
    assert np.allclose(cast(room, BELOW, (3, 3)).position[..., 1], 0.0)
    upper = scene(floor(1.0, 1.0, Material(double_sided=False)))
    assert not cast(upper, BELOW, (3, 3)).seen.any() and cast(upper, ABOVE, (3, 3)).seen.all()


@pytest.mark.parametrize("name", ["cornell", "curved"])
def test_rays_see_what_the_g_buffer_sees(name: str) -> None:
    """Edges apart: there a ray may go past what a pixel's sample hits."""
    world = irrsplat.load(name)
    frame = irrsplat.render(world, size=(48, 32), bounces=0)
    found = cast(world, world.cameras[0], (48, 32))
    both = found.seen & np.isfinite(frame.depth)
    assert (both == found.seen).mean() > 0.99 and both.mean() > 0.5
    for mine, theirs in ((found.albedo, frame.albedo), (found.normal, frame.normal), (found.position, frame.position)):
        assert np.quantile(np.abs(mine - theirs)[both], 0.98) < 1e-3


def test_an_unlit_surface_emits_the_colours_of_its_vertices() -> None:
    """Dark on the left, red on the right: in the picture, to the caster, and in what emitters and rays bring to a floor."""
    paint = Material((0.0, 0.0, 0.0), (8.0, 2.0, 2.0), unlit=True)
    panel = quad((-1, 1, -1), (2, 0, 0), (0, 0, 2), paint)
    red = np.where(panel.positions[:, :1] > 0.0, np.array([[1.0, 0.5, 0.0]]), 0.0).astype("f4")
    world = scene(replace(panel, colors=red), floor(5.0, 0.0, material(0.0)), camera=ABOVE)
    frame, seen = irrsplat.render(world, (24, 24), bounces=0), cast(world, ABOVE, (24, 24))
    at = frame.position[..., :1]
    assert np.allclose(frame.emission, (at + 1.0) / 2.0 * (8.0, 1.0, 0.0), atol=1e-4) and not frame.albedo.any()
    assert np.allclose(seen.emission.reshape(24, 24, 3), frame.emission, atol=1e-4)
    assert sum(emitters(world).luminance) == pytest.approx(float(LUMINANCE @ (8.0, 1.0, 0.0)))
    under = Camera((0.0, 0.5, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 5.0)
    E = irrsplat.render(world, (5, 5), under, bounces=1).irradiance[2, 2]
    whole = abs(float(polygon_vector(panel.positions.astype(float), np.zeros(3))[1]))
    assert np.allclose(E, whole * np.array([4.0, 0.5, 0.0]), rtol=0.03)


def test_emitters_are_chosen_by_power() -> None:
    lit = worn(quad((0, 1, 0), (1, 0, 0), (0, 0, 1), Material(emission=(1.0, 2.0, 3.0))))
    map_ = Texture(image([[0, 255]], 0, 0), nearest=True)
    half = replace(lit, material=Material(emission=(4.0, 4.0, 4.0), emission_texture=map_))
    found = Emitters.of(Surfaces.of(scene(floor(9.0), lit, half)))
    assert found is not None and sorted(found.face) == [2, 3, 4, 5]
    assert np.allclose(found.area, 0.5) and found.power.sum() == pytest.approx(1.0)
    # each half of the first emits 6; of the second, a quarter of one triangle with 4, and three quarters of the other
    chosen = (found.share * found.power[found.group])[np.argsort(found.face)]
    assert np.allclose(chosen, np.array([6.0, 6.0, 3.0, 1.0]) / 16.0, atol=0.03)
    there = (found.density * 0.5 * found.power[found.group])[np.argsort(found.face)]
    assert np.allclose(there, np.array([9.0, 7.0, 9.0, 7.0]) / 16.0, atol=0.05), "the triangles of both have the same corners"
    gone = replace(lit, material=replace(lit.material, alpha_mode="blend", opacity=0.2))
    assert Emitters.of(Surfaces.of(scene(floor(9.0), gone))) is None  # light does not see it


def test_no_emitter_is_sampled_if_every_surface_emits() -> None:
    assert Emitters.of(Surfaces.of(irrsplat.load("furnace"))) is None
