"""Textures in the picture: what the g-buffer holds at stated pixels, against the numbers that the images are made of."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest

from irrsplat.core.color import linear_from_srgb
from irrsplat.gpu.target import pixels
from irrsplat.gpu.world import World
from irrsplat.image.gbuffer import GBufferPass
from irrsplat.image.texture_maps import TextureMaps
from irrsplat.scene.appearance import runs
from irrsplat.scene.model import Camera, Image, Material, Mesh, Scene, Texture
from tests.support.worlds import material, quad, scene

SIZE = (64, 64)
HEAD_ON = Camera((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), fov=2.0 * np.degrees(np.arctan(0.5)))  # sees exactly the square
RNG = np.random.default_rng(5)
COLOURS = RNG.integers(0, 256, (4, 4, 4), dtype="u1")
COLOURS[..., 3] = 255


def square(paint: Material, uvs: np.ndarray | None = None, z: float = 0.0, half: float = 1.0) -> Mesh:
    """A square about the z axis (default: from (-1, -1) to (1, 1)), facing +z, whose image is upright: (0, 0) is up left."""
    mesh = quad((-half, -half, z), (2 * half, 0, 0), (0, 2 * half, 0), paint)
    one = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "f4") if uvs is None else uvs
    return replace(mesh, uvs=np.tile(one, 2) if one.shape[1] == 2 else one)


def image(texels: np.ndarray) -> Image:
    """An image of (H, W, 3 or 4) bytes or (H, W) grey ones."""
    texels = np.asarray(texels)
    texels = np.repeat(texels[..., None], 3, -1) if texels.ndim == 2 else texels
    if texels.shape[-1] == 3:
        texels = np.concatenate([texels, np.full((*texels.shape[:2], 1), 255)], -1)
    return Image(texels.astype("u1"))


def worn(texture: Texture, **rest: Any) -> Material:
    """A white material with this texture."""
    return Material(albedo=(1.0, 1.0, 1.0), albedo_texture=texture, **rest)


def seen(ctx: moderngl.Context, world: Scene, size: tuple[int, int] = SIZE, maps: TextureMaps | None = None) -> dict[str, Any]:
    """Return the g-buffer of the scene's camera, top row first."""
    with World(ctx, world) as placed, GBufferPass(ctx, size, maps) as draw:
        found = draw(placed, world.camera())
        read = {name: pixels(getattr(found, name)) for name in ("position", "normal", "albedo", "emission")}
        return read | {"mapped": pixels(found.lit_normal)}


def albedo(ctx: moderngl.Context, *meshes: Mesh, camera: Camera = HEAD_ON, size: tuple[int, int] = SIZE) -> np.ndarray:
    """(H, W, 3) the albedo that is seen."""
    found: np.ndarray = seen(ctx, scene(*meshes, camera=camera), size)["albedo"][..., :3]
    return found


def linear(texels: np.ndarray) -> np.ndarray:
    """(…, 3) linear colours of bytes."""
    return linear_from_srgb(texels[..., :3] / 255.0)


def enlarged(texels: np.ndarray, size: int) -> np.ndarray:
    """Each texel as a square of pixels, `size` pixels for all of them."""
    return np.repeat(np.repeat(texels, size // texels.shape[0], 0), size // texels.shape[1], 1)


@pytest.mark.parametrize("name", ["albedo", "emission"])
def test_texels_are_where_the_image_has_them(ctx: moderngl.Context, name: str) -> None:
    """With 4×4 texels on 64×64 pixels, texel centres are at pixels 8, 24, 40, 56; values between are interpolated."""
    texture = Texture(image(COLOURS))
    paint = worn(texture) if name == "albedo" else Material(emission=(1.0, 1.0, 1.0), emission_texture=texture)
    found = seen(ctx, scene(square(paint), camera=HEAD_ON), (4, 4))[name][..., :3]
    assert np.abs(found - linear(COLOURS)).max() < 0.01
    fine = seen(ctx, scene(square(paint), camera=HEAD_ON))[name][..., :3]
    assert np.abs(fine[7:57:16, 7:57:16] - linear(COLOURS)).max() < 0.06


def _place(x: np.ndarray, wrap: str) -> np.ndarray:
    """The texel 0..3 of four at coordinate x."""
    at = np.floor(4.0 * x).astype(int)
    if wrap == "repeat":
        return at % 4
    return np.clip(at, 0, 3) if wrap == "clamp" else np.where(at % 8 < 4, at % 4, 3 - at % 4)


@pytest.mark.parametrize(("across", "down"), [("repeat", "mirror"), ("mirror", "clamp"), ("clamp", "repeat")])
def test_beyond_its_edges_an_image_goes_on_as_it_says(ctx: moderngl.Context, across: Any, down: Any) -> None:
    """Coordinates from -1 to 3 over 64 pixels, nearest: the texel's number follows from its coordinate alone."""
    uvs = np.array([[-1, 3], [3, 3], [3, -1], [-1, -1]], "f4")
    texture = Texture(image(COLOURS), wrap=(across, down), nearest=True)
    found = albedo(ctx, square(worn(texture), uvs))
    x = -1.0 + 4.0 * (np.arange(64) + 0.5) / 64.0
    assert np.abs(found - linear(COLOURS)[_place(x, down)][:, _place(x, across)]).max() < 0.005


def test_coordinates_are_transformed_and_taken_from_the_set_that_is_named(ctx: moderngl.Context) -> None:
    """The second set is turned by a quarter; the transform scales by 2 along x, and shifts by a quarter along y."""
    first = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "f4")
    second = np.array([[1, 1], [1, 0], [0, 0], [0, 1]], "f4")  # u runs downward, v to the left
    uvs = np.hstack([first, second])
    turned = albedo(ctx, square(worn(Texture(image(COLOURS), 1, nearest=True)), uvs))
    at = (np.arange(64) + 0.5) / 64.0
    texels = linear(COLOURS)[_place(1.0 - at, "repeat")][:, _place(at, "repeat")].transpose(1, 0, 2)
    assert np.abs(turned - texels).max() < 0.005
    moved = Texture(image(COLOURS), 0, (2.0, 0.0, 0.0, 0.0, 1.0, 0.25), nearest=True)
    found = albedo(ctx, square(worn(moved), uvs))
    assert np.abs(found - linear(COLOURS)[_place(at + 0.25, "repeat")][:, _place(2.0 * at, "repeat")]).max() < 0.005


@pytest.mark.parametrize("name", ["albedo", "normal"])
def test_far_away_a_fine_pattern_has_its_mean(ctx: moderngl.Context, name: str) -> None:
    """A checker of black and white texels, 64 per pixel, has half the light of white, byte 188; other maps have the mean of their
    bytes."""
    checker = image(255 * (np.indices((64, 64)).sum(0) % 2))
    if name == "albedo":
        found = seen(ctx, scene(square(worn(Texture(checker))), camera=HEAD_ON), (8, 8))["albedo"][..., :3]
        assert np.abs(found - 0.5).max() < 0.01
    else:
        paint = Material(normal_texture=Texture(Image(checker.pixels | np.array([0, 0, 255, 0], "u1"))))
        found = seen(ctx, scene(square(paint), camera=HEAD_ON), (8, 8))["mapped"][..., :3]
        assert np.abs(found - (0, 0, 1)).max() < 0.01


# ---- cut-outs and sides -----------------------------------------------------------------------------------------------


def _alpha(values: np.ndarray) -> Image:
    """A white image of these opacities."""
    return Image(np.dstack([np.full((*values.shape, 3), 255), values]).astype("u1"))


def test_what_is_masked_shows_what_is_behind(ctx: moderngl.Context) -> None:
    """There where factor × alpha reaches the cutoff, not there elsewhere; opaque materials do not ask."""
    alphas = np.array([[255, 160], [120, 0]])
    leaf = worn(Texture(_alpha(alphas), nearest=True), opacity=0.8, alpha_mode="mask", alpha_cutoff=0.45)
    wall = square(material(0.25), z=-0.5, half=2.0)
    found = albedo(ctx, square(leaf), wall, size=(16, 16))[..., 0]
    requested = np.where(0.8 * alphas / 255.0 >= 0.45, 1.0, 0.25)
    assert np.allclose(found, enlarged(requested, 16), atol=0.01)
    assert (albedo(ctx, square(replace(leaf, alpha_mode="opaque")), wall, size=(16, 16)) > 0.99).all()
    thin = replace(square(replace(leaf, opacity=1.0)), opacities=np.full(4, 0.1, "f4"))
    assert np.allclose(albedo(ctx, thin, wall, size=(16, 16)), 0.25, atol=0.01)


@pytest.mark.parametrize("side", [16, 32])
def test_foliage_far_away_keeps_its_cover(ctx: moderngl.Context, side: int) -> None:
    """200 leaves of 6 to 10 texels, of which a pixel sees 8² or 16², cover what they cover in the image, 14 %; by the means of
    the alphas it would be 10 % and 2 %."""
    down, right = np.indices((256, 256))
    leaves = np.random.default_rng(1).uniform((0, 0, 3), (256, 256, 5), (200, 3))
    alphas = np.any([(right - x) ** 2 + (down - y) ** 2 < r * r for x, y, r in leaves], axis=0)
    leaf = worn(Texture(_alpha(255 * alphas)), alpha_mode="mask")
    covered = seen(ctx, scene(square(leaf), camera=HEAD_ON), (side, side))["position"][..., 3] > 0.0
    assert abs(covered.mean() - alphas.mean()) < 0.01


def test_a_single_side_is_seen_from_the_front_alone(ctx: moderngl.Context) -> None:
    """The front is where triangles run counter-clockwise; behind it stands a wall."""
    paint = Material(albedo=(1.0, 1.0, 1.0), double_sided=False)
    wall = square(material(0.25), z=-0.5, half=2.0)
    back = replace(square(paint), faces=square(paint).faces[:, ::-1].copy())
    assert (albedo(ctx, square(paint), wall) == 1.0).all() and (albedo(ctx, back, wall) == 0.25).all()
    assert (albedo(ctx, replace(back, material=replace(paint, double_sided=True)), wall) == 1.0).all()


# ---- the order of triangles, and memory -------------------------------------------------------------------------------


def test_images_beyond_the_memory_are_scaled_down_with_a_notice(ctx: moderngl.Context) -> None:
    """1024² takes 5.3 MiB; of 2 MiB, 512² is left. It is uploaded once, however often it is worn."""
    colours = Image(enlarged(COLOURS, 1024), "wall.png")
    world = scene(square(worn(Texture(colours))), square(worn(Texture(colours, wrap=("clamp", "clamp"))), z=-1.0), camera=HEAD_ON)
    with TextureMaps(ctx, 2) as maps:
        found = seen(ctx, world, SIZE, maps)["albedo"][..., :3]
        textures = [one for one in maps.owned() if isinstance(one, moderngl.Texture)]
        assert [one.size for one in textures] == [(512, 512)]
        assert np.abs(found[7:57:16, 7:57:16] - linear(COLOURS)).max() < 0.01
        (notice,) = maps.notices(runs(world))
        assert "wall.png" in notice and "1024x1024" in notice and "512x512" in notice
    with TextureMaps(ctx, 8) as maps:
        assert maps.notices(runs(world)) == ()
