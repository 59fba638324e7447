"""The composite against numpy: blend, the exposure meter, and what a screen is given."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.gpu.target import Target, table_texture
from irrsplat.image import tonemap
from irrsplat.image.backdrop import Backdrop
from irrsplat.image.composite import CompositePass
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings
from tests.support.worlds import assert_pictures, gbuffer_of, on_plane

SIZE = (61, 90)
CAMERA = Camera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), fov=40.0)
SKY = (0.2, 0.4, 0.8)


def texture(ctx: moderngl.Context, rgb: np.ndarray, w: np.ndarray | float = 1.0) -> moderngl.Texture:
    whole = np.empty((*rgb.shape[:2], 4))
    whole[..., :3], whole[..., 3] = rgb, w
    return table_texture(ctx, whole[::-1])


def pixels(texture: moderngl.Texture) -> np.ndarray:
    return np.frombuffer(texture.read(), "f4").reshape(texture.height, texture.width, 4)[::-1]


@pytest.mark.parametrize(("blend", "weights"), [(0.0, (1, 0)), (0.25, (1, 0.5)), (0.5, (1, 1)), (0.75, (0.5, 1))])
def test_blend(ctx: moderngl.Context, blend: float, weights: tuple[float, float]) -> None:
    """min(1, 2(1-b))·direct + min(1, 2b)·ρ/π·E + emission where a surface is, else the sky; E = Σ k·E / Σ k, 0 of no record."""
    rng = np.random.default_rng(1)
    position, depth = on_plane(CAMERA, SIZE, (0, 0, 0), (0, 0, 1))
    depth[rng.random(depth.shape) < 0.1] = 0.0
    direct, E, albedo, emission = rng.uniform(0, 5, (4, *depth.shape, 3))
    k, seen = rng.uniform(0, 3, depth.shape), depth > 0.0
    k[~seen] = 0.0
    k[50:60] = 0.0  # no record covers these
    normal = np.broadcast_to((0.0, 0.0, 1.0), position.shape)
    gbuffer = gbuffer_of(ctx, position, normal, depth, albedo=albedo, emission=emission)
    sums, lit, behind = texture(ctx, k[..., None] * E, k), texture(ctx, direct, seen), Backdrop("sky", Scene((), (), (), SKY))
    made, _ = CompositePass(ctx, SIZE)(sums, lit, gbuffer, behind, CAMERA, Settings(blend=blend))
    image, total = pixels(made)[..., :3], pixels(sums)
    irradiance = total[..., :3] / np.where(total[..., 3:] > 0.0, total[..., 3:], 1.0)
    E[k == 0.0] = 0.0
    truth = weights[0] * direct + weights[1] * albedo / np.pi * E + emission
    assert_pictures("blend", image, np.where(seen[..., None], truth, SKY), 1e-5 * 20)
    assert_pictures("blend_irradiance", irradiance, E, 1e-5 * 10)


@pytest.mark.parametrize("size", [(3, 200), (97, 61), (260, 130)])
def test_the_meter_is_numpys(ctx: moderngl.Context, size: tuple[int, int]) -> None:
    """-mean log₂(Y/ρ) over the lit pixels, ρ at least 0.02: all in one light have the stops of one of them. Sky and what emits
    count as mid grey. None is lit: 0."""
    rng, shape = np.random.default_rng(size[0]), (size[1], size[0])
    image, albedo = 10.0 ** rng.uniform(-4, 3, (*shape, 3)), rng.uniform(0, 0.9, (*shape, 3)) ** 4
    image[rng.random(shape) < 0.2] = 0.0
    seen, glows = rng.random((2, *shape)) < 0.7
    normal, emission = np.ones_like(image), np.repeat(glows[..., None], 3, -1).astype(float)
    gbuffer = gbuffer_of(ctx, image, normal, seen.astype(float), albedo=albedo, emission=emission)
    luminance, rho = ((values @ (0.2126, 0.7152, 0.0722)).astype("f4") for values in (image, albedo))
    light = luminance / np.where(seen & ~glows, np.maximum(rho, 0.02), 0.18)
    meter = CompositePass(ctx, size)
    assert meter.exposure(texture(ctx, image), gbuffer) == pytest.approx(-np.log2(light[light > 0.0]).mean(), abs=1e-3)
    assert tonemap.exposure_of(albedo, rho) == pytest.approx(-np.log2(rho / np.maximum(rho, 0.02)).mean(), abs=1e-4)
    assert meter.exposure(texture(ctx, 0.0 * image), gbuffer) == 0.0


def test_the_exposure_leaves_a_dark_room_dark() -> None:
    """From 3 % of the unshadowed light on, the exposure is that of the light. At 0.1 % it is a stop less.

    Below, it falls to the exposure of unshadowed light.
    """
    lights = np.array([100.0, 10.0, 1.0, 0.3, 1e-2, 1e-3, 1e-5, 1e-9])
    stops = np.array([tonemap.automatic_exposure(7.0 * np.log2(light), 7.0, 10.0) for light in lights])
    alone = np.array([tonemap.automatic_exposure(7.0 * np.log2(light), 7.0) for light in lights])
    assert np.allclose(stops[:4], alone[:4], atol=0.002) and stops[4] == pytest.approx(alone[4] - 1.0, abs=1e-3)
    assert (np.diff(stops[4:]) <= 0.0).all() and stops[-1] == pytest.approx(-np.log2(10.0), abs=1e-3)


@pytest.mark.parametrize("exposure", [-3.0, 0.0, 2.5])
def test_the_screen_shows_what_the_file_holds(ctx: moderngl.Context, exposure: float) -> None:
    """CompositePass.show against display.tonemap: at a pixel within the dither's half step of 8 bits, in the mean far less."""
    image = np.concatenate([np.zeros((1, 64, 3)), 10.0 ** np.random.default_rng(0).uniform(-5, 4, (63, 64, 3))])
    target = Target(ctx, (64, 64), (4,))
    CompositePass(ctx, (64, 64)).show(texture(ctx, image), exposure, target)
    assert_pictures("display", target.read()[..., :3], tonemap.tonemap(image, exposure), 0.51 / 255.0)
    CompositePass(ctx, (64, 64)).show(texture(ctx, np.full((64, 64, 3), 0.2)), exposure, target)
    assert np.round(255.0 * target.read()[..., :3]).mean() == pytest.approx(
        255.0 * tonemap.tonemap(np.full(3, 0.2), exposure).mean(), abs=0.05
    )
