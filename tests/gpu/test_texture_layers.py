"""The layers of textures that light looks at: means in linear light, coarser levels, and which images share how much memory."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.core.color import linear_from_srgb
from irrsplat.gpu.material_table import MaterialTable
from irrsplat.gpu.texture_layers import LayerKey, plan
from irrsplat.scene.image_means import area_means
from irrsplat.scene.model import Image, Material, Texture
from irrsplat.scene.seen_by_light import CLOSED, CUT_OUT, OPEN, UNSEEN, sort_of
from tests.support.worlds import box, quad, scene


def noise(height: int, width: int, seed: int = 0) -> Image:
    return Image(np.random.default_rng(seed).integers(0, 256, (height, width, 4), dtype=np.uint8))


def exact(image: Image, side: int, weighted: bool) -> np.ndarray:
    """(side, side, 4) the means by cutting each pixel into parts that lie in one texel alone."""
    pixels = image.pixels.repeat(side, 0).repeat(side, 1)
    values = np.concatenate([linear_from_srgb(pixels[..., :3] / 255.0), pixels[..., 3:] / 255.0], -1)
    values[..., :3] *= values[..., 3:] if weighted else 1.0
    height, width = image.pixels.shape[:2]
    means = values.reshape(side, height, side, width, 4).mean((1, 3))
    means[..., :3] /= np.maximum(means[..., 3:], 1e-30) if weighted else 1.0
    return means


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("height, width, side", [(8, 8, 4), (7, 13, 4), (5, 3, 8), (1, 6, 2), (300, 2, 4)])
def test_means_are_those_of_what_a_texel_covers(height: int, width: int, side: int, weighted: bool) -> None:
    image = noise(height, width)
    assert np.allclose(area_means(image.pixels, side, weighted), exact(image, side, weighted), atol=2e-5)


@pytest.mark.parametrize(
    "count, size, most_bytes, side",
    [(1, 100, 64 << 20, 128), (1, 8192, 64 << 20, 1024), (50, 2048, 64 << 20, 256), (3, 5, 64 << 20, 8), (2, 512, 30000, 32)],
)
@pytest.mark.parametrize("cutoff, most", [(0.0, 256), (0.5, 1024)])
def test_layers_are_as_large_as_is_of_use(count: int, size: int, most_bytes: int, side: int, cutoff: float, most: int) -> None:
    keys = [LayerKey(Image(np.zeros((1, size, 4), np.uint8)), cutoff) for _ in range(count)]
    found = plan(keys, most_bytes, 256)
    assert found.side == min(side, most) and len(found.layers) == count
    assert count * found.side**2 * 8 * 4 / 3 <= most_bytes, "four half floats a texel, with mip-maps"


def test_the_images_of_least_area_go_without_layers(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    images = [noise(4, 4, i) for i in range(3)]
    quads = [
        quad((0, 0, 0), (size, 0, 0), (0, 1, 0), Material(albedo_texture=Texture(image)))
        for size, image in zip((1, 3, 2), images, strict=True)
    ]
    info = {**ctx.info, "GL_MAX_ARRAY_TEXTURE_LAYERS": 2}
    monkeypatch.setattr(type(ctx), "info", info)
    with MaterialTable(ctx, scene(*quads)) as table:
        assert [key.image for key in table.plan.layers] == [images[1], images[2]]
        assert [key.image for key in table.plan.means] == [images[0]]
        assert table.notices == ("images that are a mere mean colour to light: 1; beside 2 others this OpenGL takes no more",)


HALF = Texture(Image(np.array([[[9, 9, 9, 255], [9, 9, 9, 0]]], np.uint8)))
FULL = Texture(Image(np.array([[[9, 9, 9, 255], [9, 9, 9, 200]]], np.uint8)))


@pytest.mark.parametrize(
    "paint, sort",
    [
        (Material(), CLOSED),
        (Material(opacity=0.0, albedo_texture=HALF), CLOSED),
        (Material(alpha_mode="mask", albedo_texture=HALF), CUT_OUT),
        (Material(alpha_mode="mask", albedo_texture=FULL), CLOSED),
        (Material(alpha_mode="mask", albedo_texture=FULL, alpha_cutoff=0.9), CUT_OUT),
        (Material(alpha_mode="mask", albedo_texture=HALF, opacity=0.4), UNSEEN),
        (Material(alpha_mode="blend", opacity=0.6), CLOSED),
        (Material(alpha_mode="blend", opacity=0.4), UNSEEN),
        (Material(transmission=0.6), UNSEEN),
        (Material(transmission=0.4), CLOSED),
        (Material(alpha_mode="blend", transmission=0.4, opacity=0.8), UNSEEN),
    ],
)
def test_what_a_closed_mesh_is_to_light(paint: Material, sort: int) -> None:
    assert sort_of(box((0, 0, 0), (1, 1, 1), paint)) == sort
    assert sort_of(quad((0, 0, 0), (1, 0, 0), (0, 1, 0), paint)) == (OPEN if sort == CLOSED else sort)
