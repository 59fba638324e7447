"""The layers of textures that light looks at: means in linear light, coarser levels, and which images share how much memory."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.core.color import linear_from_srgb
from irrsplat.gpu.material_table import MaterialTable
from irrsplat.gpu.texture_layers import LayerKey, TextureLayers, dithered, layer_texels, plan
from irrsplat.scene.image_means import area_means, coverage
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


def test_coverage_is_the_share_that_passes() -> None:
    image = noise(12, 10)
    passing = np.where(image.pixels[..., 3:] >= 0.3 * 255, 255, 0).astype(np.uint8)
    truth = exact(Image(np.repeat(passing, 4, -1)), 4, False)[..., 3]
    assert np.allclose(coverage(image.pixels[..., 3], 4, 0.3), truth, atol=1e-5)


def test_coarser_levels_are_means_of_premultiplied_colours(ctx: moderngl.Context) -> None:
    """Each of the two layers by itself: its last level is its own mean, colours weighted by alpha where that is looked at."""
    keys = LayerKey(noise(16, 16, 1), 0.5), LayerKey(noise(16, 16, 2), 0.0)
    with TextureLayers(ctx, plan(keys, 1e6, 16)) as layers:
        assert layers.texture.size == (16, 16, 2)
        levels = [np.frombuffer(read(ctx, layers.texture, level), "f4").reshape(2, 16 >> level, -1, 4) for level in range(5)]
    for i, (key, weighted) in enumerate(zip(keys, (True, False), strict=True)):
        mean = exact(key.image, 1, weighted)[0, 0]
        truth = np.append(mean[:3] * mean[3], mean[3]) if weighted else np.append(mean[:3], 1.0)
        for level in levels:
            assert np.allclose(level[i].mean((0, 1)), truth, atol=2e-3)


def read(ctx: moderngl.Context, texture: moderngl.TextureArray, level: int) -> bytes:
    """A level of all layers, as float32: drawn, as moderngl reads only the first one."""
    side = texture.width >> level
    program = ctx.program(
        vertex_shader="#version 330\nvoid main() {"
        " gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0, 1); }",
        fragment_shader="#version 330\nuniform sampler2DArray layers; uniform int level; out vec4 color;\nvoid main() {"
        " ivec2 at = ivec2(gl_FragCoord.xy); int side = textureSize(layers, level).x;"
        " color = texelFetch(layers, ivec3(at.x, at.y % side, at.y / side), level); }",
    )
    target = ctx.simple_framebuffer((side, side * texture.layers), 4, dtype="f4")
    target.use()
    ctx.enable_only(moderngl.NOTHING)
    texture.use(0)
    program["level"].value = level  # type: ignore[union-attr]
    ctx.vertex_array(program, []).render(vertices=3)
    return target.read(components=4, dtype="f4")


@pytest.mark.parametrize(
    "count, size, most_bytes, side",
    [(1, 100, 64 << 20, 128), (1, 8192, 64 << 20, 1024), (50, 2048, 64 << 20, 256), (3, 5, 64 << 20, 8), (2, 512, 30000, 32)],
)
def test_layers_are_as_large_as_is_of_use_and_fits(count: int, size: int, most_bytes: int, side: int) -> None:
    keys = [LayerKey(Image(np.zeros((1, size, 4), np.uint8)), 0.0) for _ in range(count)]
    found = plan(keys, most_bytes, 256)
    assert found.side == side and len(found.layers) == count and found.size <= most_bytes


def test_images_beyond_the_last_layer_are_their_means() -> None:
    keys = [LayerKey(noise(4, 4, i), 0.0) for i in range(5)]
    found = plan([*keys, keys[0]], 64 << 20, 3)
    assert list(found.layers) == keys[:3] and list(found.means) == keys[3:]
    for key in keys[3:]:
        assert np.allclose(found.means[key][:3], exact(key.image, 1, False)[0, 0, :3], atol=1e-5)


def test_only_holes_that_are_finer_than_a_layer_are_dithered() -> None:
    key = LayerKey(noise(16, 32), 0.5)
    assert dithered(key, 16) and not dithered(key, 32) and not dithered(LayerKey(key.image, 0.0), 16)
    alpha = layer_texels(key, 16)[..., 3]
    assert np.allclose(alpha, coverage(key.image.pixels[..., 3], 16, 0.5))


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


def test_layers_take_a_sixteenth_of_the_memory_for_images_and_no_more_than_64_mib(ctx: moderngl.Context) -> None:
    papers = [Material(albedo_texture=Texture(noise(512, 512, i))) for i in range(3)]
    world = scene(*(quad((0, 0, 0), (1, 0, 0), (0, 1, 0), paper) for paper in papers))
    for memory, side in ((65536, 512), (64, 256), (16, 128), (1, 32)):
        with MaterialTable(ctx, world, memory) as table:
            assert table.plan.side == side and table.plan.size <= min(memory / 16, 64) * 2**20


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
