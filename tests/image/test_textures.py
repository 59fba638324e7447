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
from irrsplat.scene.model import Camera, Image, Material, Mesh, Scene, Texture
from tests.support.worlds import quad, scene

SIZE = (64, 64)
HEAD_ON = Camera((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), fov=2.0 * np.degrees(np.arctan(0.5)))  # sees exactly the square
RNG = np.random.default_rng(5)
COLOURS = RNG.integers(0, 256, (4, 4, 4), dtype="u1")
COLOURS[..., 3] = 255


def square(paint: Material, uvs: np.ndarray | None = None, z: float = 0.0) -> Mesh:
    """The square from (-1, -1) to (1, 1), facing +z, whose image is upright: (0, 0) is up left."""
    mesh = quad((-1, -1, z), (2, 0, 0), (0, 2, 0), paint)
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
    """What the scene's camera sees, top row first."""
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
    """Of 4×4 texels on 64×64 pixels a texel's centre is at pixels 8, 24, 40, 56; between them it is blended."""
    texture = Texture(image(COLOURS))
    paint = worn(texture) if name == "albedo" else Material(emission=(1.0, 1.0, 1.0), emission_texture=texture)
    found = seen(ctx, scene(square(paint), camera=HEAD_ON), (4, 4))[name][..., :3]
    assert np.abs(found - linear(COLOURS)).max() < 0.01
    fine = seen(ctx, scene(square(paint), camera=HEAD_ON))[name][..., :3]
    assert np.abs(fine[7:57:16, 7:57:16] - linear(COLOURS)).max() < 0.06


def test_nearest_texels_are_squares(ctx: moderngl.Context) -> None:
    found = albedo(ctx, square(worn(Texture(image(COLOURS), nearest=True))))
    assert np.abs(found - enlarged(linear(COLOURS), 64)).max() < 0.005


def test_factor_texture_and_vertex_colour_are_multiplied(ctx: moderngl.Context) -> None:
    grey = Texture(image(np.full((2, 2), 188)))
    paint = Material(albedo=(0.8, 0.5, 0.2), albedo_texture=grey, emission=(3.0, 2.0, 1.0), emission_texture=grey)
    found = seen(ctx, scene(square(paint), camera=HEAD_ON))
    texel = linear_from_srgb(np.array(188 / 255.0))
    assert np.allclose(found["albedo"][..., :3], texel * np.array((0.8, 0.5, 0.2)), atol=0.003)
    assert np.allclose(found["emission"][..., :3], texel * np.array((3.0, 2.0, 1.0)), rtol=0.01)
    coloured = replace(square(paint), colors=np.full((4, 3), (0.1, 0.2, 0.3), "f4"))
    assert np.allclose(albedo(ctx, coloured), texel * np.array((0.1, 0.2, 0.3)), atol=0.002)


def _place(x: np.ndarray, wrap: str) -> np.ndarray:
    """The texel 0..3 of four at coordinate x."""
    at = np.floor(4.0 * x).astype(int)
    if wrap == "repeat":
        return at % 4
    return np.clip(at, 0, 3) if wrap == "clamp" else np.where(at % 8 < 4, at % 4, 3 - at % 4)


@pytest.mark.parametrize("across", ["repeat", "mirror", "clamp"])
@pytest.mark.parametrize("down", ["repeat", "mirror", "clamp"])
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
