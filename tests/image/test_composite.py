"""The composite against numpy: blend, smoothing, the exposure meter, and what a screen is given."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.core.buffers import GBuffer
from irrsplat.gpu.target import Target, table_texture
from irrsplat.image import tonemap
from irrsplat.image.backdrop import Backdrop
from irrsplat.image.composite import CompositePass
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings
from tests.support.worlds import assert_pictures, gbuffer_of, on_plane

SIZE = (61, 200)  # high enough that the smoothing reaches two pixels
CAMERA = Camera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), fov=40.0)
SKY = (0.2, 0.4, 0.8)


def texture(ctx: moderngl.Context, rgb: np.ndarray, w: np.ndarray | float = 1.0) -> moderngl.Texture:
    whole = np.empty((*rgb.shape[:2], 4))
    whole[..., :3], whole[..., 3] = rgb, w
    return table_texture(ctx, whole[::-1])


def pixels(texture: moderngl.Texture) -> np.ndarray:
    return np.frombuffer(texture.read(), "f4").reshape(texture.height, texture.width, 4)[::-1]


def wall(ctx: moderngl.Context, seed: int = 0) -> tuple[GBuffer, dict[str, np.ndarray]]:
    """A wall across the view, its right half a metre nearer and its lower half with another normal; holes of sky."""
    rng = np.random.default_rng(seed)
    position, depth = on_plane(CAMERA, SIZE, (0, 0, 0), (0, 0, 1))
    near, near_depth = on_plane(CAMERA, SIZE, (0, 0, 1), (0, 0, 1))
    position[:, 30:], depth[:, 30:] = near[:, 30:], near_depth[:, 30:]
    normal = np.zeros_like(position)
    normal[:100], normal[100:] = (0, 0, 1), (0.6, 0, 0.8)
    depth[rng.random(depth.shape) < 0.1] = 0.0
    data = {n: rng.uniform(0, 1, position.shape) for n in ("albedo", "emission")}
    return gbuffer_of(ctx, position, normal, depth, **data), data | {"depth": depth, "position": position, "normal": normal}


def composed(
    ctx: moderngl.Context, gbuffer: GBuffer, sums: moderngl.Texture, direct: moderngl.Texture, settings: Settings
) -> tuple[np.ndarray, np.ndarray]:
    """The image, and E as the quotient of the sums that come with it."""
    behind = Backdrop("sky", Scene((), (), (), SKY))
    image, _, sums = CompositePass(ctx, SIZE)(sums, direct, gbuffer, behind, CAMERA, settings)
    total = pixels(sums)
    return pixels(image)[..., :3], total[..., :3] / np.where(total[..., 3:] > 0.0, total[..., 3:], 1.0)


@pytest.mark.parametrize(("blend", "weights"), [(0.0, (1, 0)), (0.25, (1, 0.5)), (0.5, (1, 1)), (0.75, (0.5, 1)), (1.0, (0, 1))])
def test_blend(ctx: moderngl.Context, blend: float, weights: tuple[float, float]) -> None:
    """min(1, 2(1-b))·direct + min(1, 2b)·ρ/π·E + emission where a surface is, else the sky; E = Σ k·E / Σ k, 0 of no record."""
    gbuffer, data = wall(ctx)
    rng = np.random.default_rng(1)
    direct, E = rng.uniform(0, 5, (2, *data["depth"].shape, 3))
    k = rng.uniform(0, 3, data["depth"].shape)
    seen = data["depth"] > 0.0
    k[~seen] = 0.0
    k[50:60] = 0.0  # no record speaks for these
    lit = texture(ctx, direct, seen)
    image, irradiance = composed(ctx, gbuffer, texture(ctx, k[..., None] * E, k), lit, Settings(blend=blend))
    E[k == 0.0] = 0.0
    truth = weights[0] * direct + weights[1] * data["albedo"] / np.pi * E + data["emission"]
    assert_pictures("blend", image, np.where(seen[..., None], truth, SKY), 1e-5 * 20)
    assert_pictures("blend_irradiance", irradiance, E, 1e-5 * 10)


def test_before_the_first_record_light_is_guessed(ctx: moderngl.Context, software: bool) -> None:
    """Half of the sky, by its irradiance, and π times the view's mean direct light; a record's light counts far more."""
    gbuffer, data = wall(ctx)
    seen, height = data["depth"] > 0.0, data["normal"][..., 1:2]
    scene = Scene((), (), (), SKY, sky_gradient=(0.1, 0.2, 0.3), up=(0.0, 1.0, 0.0))
    k, direct = np.zeros(seen.shape), np.full((*seen.shape, 3), 0.7)

    def irradiance() -> np.ndarray:
        sums, behind = texture(ctx, 9.0 * k[..., None] * np.ones(3), k), Backdrop("grey", scene)
        total = pixels(CompositePass(ctx, SIZE).filled(sums, texture(ctx, direct), gbuffer, behind))
        return (total[..., :3] / np.where(total[..., 3:] > 0.0, total[..., 3:], 1.0))[seen]

    truth = np.pi * (0.5 * (np.array(SKY) + 2.0 / 3.0 * np.array((0.1, 0.2, 0.3)) * height) + 0.7)
    assert np.allclose(irradiance(), truth[seen], rtol=1e-3)
    k[90:110, 20:40] = np.where(seen[90:110, 20:40], 1.0, 0.0)
    # a picture's mean is its last mipmap, and how sides that are no powers of two are halved is the driver's choice
    assert np.allclose(irradiance(), 9.0, rtol=1e-3 if software else 1e-2)


def smoothed(ctx: moderngl.Context, E: np.ndarray, k: np.ndarray | float = 1.0) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    gbuffer, data = wall(ctx)
    k = np.where(data["depth"] > 0.0, k, 0.0)
    black = texture(ctx, np.zeros_like(E), data["depth"] > 0.0)
    return composed(ctx, gbuffer, texture(ctx, k[..., None] * E, k), black, Settings(smooth=True))[1], data


def test_smoothing_keeps_what_is_constant(ctx: moderngl.Context) -> None:
    E = np.broadcast_to((1.0, 2.0, 3.0), (SIZE[1], SIZE[0], 3))
    found, data = smoothed(ctx, E, np.random.default_rng(2).uniform(0.1, 9.0, E.shape[:2]))
    assert_pictures("smooth_constant", found, np.where(data["depth"][..., None] > 0.0, E, 0.0), 1e-4)


def test_smoothing_lessens_noise_and_keeps_its_mean(ctx: moderngl.Context) -> None:
    """White noise of variance 1 filtered by weights v has variance Σv²/(Σv)²: of σ = 1 pixel, about 1/(4π)."""
    E = 10.0 + np.random.default_rng(3).normal(size=(SIZE[1], SIZE[0], 3))
    found, data = smoothed(ctx, E)
    part = np.zeros(E.shape[:2], bool)
    part[5:90, 5:25] = True
    part &= data["depth"] > 0.0
    assert found[part].mean() == pytest.approx(10.0, abs=0.03)
    assert 0.02 < found[part].var() < 0.2


def test_smoothing_stops_at_edges(ctx: moderngl.Context) -> None:
    """Neither across the step of a metre in depth, nor where normals differ by 37°."""
    E = np.ones((SIZE[1], SIZE[0], 3))
    E[:, 30:] = 5.0
    found, data = smoothed(ctx, E)
    seen = data["depth"] > 0.0
    assert_pictures("smooth_depth", found, E, 1e-3, seen)
    E[:] = 1.0
    E[100:] = 5.0
    found, _ = smoothed(ctx, E)
    assert_pictures("smooth_normal", found, E, 0.02, seen)


def test_pixels_without_records_do_not_darken_their_neighbours(ctx: moderngl.Context) -> None:
    E = np.full((SIZE[1], SIZE[0], 3), 4.0)
    k = np.random.default_rng(5).integers(0, 2, E.shape[:2]).astype(float)
    found, data = smoothed(ctx, E, k)
    assert_pictures("smooth_holes", found, E, 1e-3, (data["depth"] > 0.0) & (k > 0.0))


@pytest.mark.parametrize("size", [(1, 1), (3, 200), (97, 61), (260, 130)])
def test_the_meter_is_numpys(ctx: moderngl.Context, size: tuple[int, int]) -> None:
    """Of pictures of much contrast and of little."""
    rng = np.random.default_rng(size[0])
    image = 10.0 ** rng.uniform(-4, 3, (size[1], size[0], 3)) if size[0] < 200 else rng.uniform(1, 4, (size[1], size[0], 3))
    image[rng.random(image.shape[:2]) < 0.2] = 0.0
    image[0, 0] = 0.5
    found = CompositePass(ctx, size).exposure(texture(ctx, image))
    assert found == pytest.approx(tonemap.exposure_of(image.astype("f4")), abs=1e-3)
    assert CompositePass(ctx, size).exposure(texture(ctx, 0.0 * image)) == 0.0


@pytest.mark.parametrize("exposure", [-3.0, 0.0, 2.5])
def test_the_screen_shows_what_the_file_holds(ctx: moderngl.Context, exposure: float) -> None:
    """CompositePass.show against display.tonemap, to one step of 8 bits."""
    image = np.concatenate([np.zeros((1, 64, 3)), 10.0 ** np.random.default_rng(0).uniform(-5, 4, (63, 64, 3))])
    target = Target(ctx, (64, 64), (4,))
    CompositePass(ctx, (64, 64)).show(texture(ctx, image), exposure, target)
    assert_pictures("display", target.read()[..., :3], tonemap.tonemap(image, exposure), 1.0 / 255.0 / 2.0)
