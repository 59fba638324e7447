"""Every other pixel first: what upsampling makes of the rest, and when a view goes on to all pixels."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.core.buffers import NOTHING_SEEN, SplatBuffer
from irrsplat.gpu.target import pixels, table_texture
from irrsplat.indirect.upsample import UpsamplePass
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera
from tests.support.worlds import gbuffer_of, on_plane

SIZE = (37, 29)
CAMERA = Camera((0.3, 0.2, 3.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 50.0)


def light(position: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """E, linear on each of two surfaces and far apart between them."""
    bright = position @ np.array([[0.1, 0.2, -0.1], [0.05, 0.1, 0.2], [0.3, 0.0, 0.1]]) + 5.0
    return np.where(floor[..., None], bright, 0.1 * bright)


def test_between_four_of_one_surface_light_is_linear_and_none_crosses_an_edge(ctx: moderngl.Context) -> None:
    wall, far = on_plane(CAMERA, SIZE, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    ground, near = on_plane(CAMERA, SIZE, (0.0, -0.6, 0.0), (0.0, 1.0, 0.0))
    floor = (near > 0.0) & (near < far)
    position = np.where(floor[..., None], ground, wall)
    normal = np.where(floor[..., None], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    depth = np.where(floor, near, far)
    depth[:4] = 0.0  # nothing is seen there
    gbuffer = gbuffer_of(ctx, position, normal, depth)
    E = light(position, floor)
    # textures begin with the bottom row: every other pixel counts from there
    half = (slice(None, None, -2), slice(None, None, 2))
    k = 2.0 + np.arange(E[half].shape[1])[None, :, None] * np.ones(E[half].shape[:2])[..., None]
    sums = np.concatenate([k * E[half], k], axis=-1)
    sums[depth[half] == 0.0] = 0.0
    weight = np.zeros((*sums.shape[:2], 4))
    upsample = UpsamplePass(ctx, SIZE)
    made = upsample(SplatBuffer(table_texture(ctx, sums), table_texture(ctx, weight)), gbuffer, CAMERA)
    got, seen = pixels(made.sums), depth > 0.0
    assert floor[seen].mean() > 0.1 and (~floor[seen]).mean() > 0.1
    assert np.abs(got[..., 3][seen] - 1.0).max() < 1e-5
    relative = np.abs(got[..., :3] / E - 1.0).max(-1)
    inner = seen.copy()
    inner[:8] = False
    for axis in (0, 1):
        for step in (-1, 1, -2, 2):
            inner &= np.roll(floor, step, axis) == floor
    assert relative[inner].max() < 0.02  # linear on the surface is nearly so in perspective
    assert relative[seen].max() < 0.4  # whereas light from the other side of the edge is off by 0.9 or 9
    assert (pixels(made.weight)[..., 0][~seen] == np.float32(NOTHING_SEEN)).all()


def test_a_moving_view_is_like_the_one_at_rest_which_is_exact() -> None:
    scene = irrsplat.load("cornell")
    with Renderer(scene, size=(400, 400), preset="preview", bounces=1) as renderer:
        renderer.render()
        camera = scene.camera()
        moved = replace(camera, eye=(camera.eye[0] + 0.1, *camera.eye[1:]))
        renderer.render(moved)
        renderer.render(camera)
        view, progress = renderer.frame(moved)
        assert renderer.splats.pixel_stride == 2 and progress.new == 0 and not progress.done  # it goes on to all pixels
        coarse = _irradiance(view.sums)
        view, progress = renderer.frame(moved)
        assert renderer.splats.pixel_stride == 1 and progress.done and progress.new == 0
        fine = _irradiance(view.sums)
        error = np.sqrt(((coarse - fine) ** 2).mean()) / fine.mean()
        assert 0.0 < error < 0.025
        # no matter by which way: the same as one splat of all records
        renderer.forget(records=False)
        again = renderer.render(moved)
        assert np.array_equal(again.irradiance, fine)


def _irradiance(sums: moderngl.Texture) -> np.ndarray:
    total = pixels(sums)
    return total[..., :3] / np.where(total[..., 3:] > 0.0, total[..., 3:], np.float32(1.0))


@pytest.mark.parametrize(("size", "coarse", "every"), [((64, 64), True, 1), ((400, 400), True, 2), ((400, 400), False, 1)])
def test_small_views_and_those_without_coarse_splat_every_pixel_at_once(size: tuple[int, int], coarse: bool, every: int) -> None:
    with Renderer(irrsplat.load("cornell"), size=size, preset="preview", bounces=1, coarse=coarse) as renderer:
        _, progress = renderer.frame()
        assert progress.new > 0 and renderer.splats.pixel_stride == every


def test_an_object_between_four_pixels_of_a_wall_takes_no_light_from_it(ctx: moderngl.Context) -> None:
    """A board before a wall ends in a tongue one pixel wide, between coarse pixels: its light is the board's, 9 times as much."""
    wall, far = on_plane(CAMERA, SIZE, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    board, near = on_plane(CAMERA, SIZE, (0.0, 0.0, 0.5), (0.0, 0.0, 1.0))
    nearer = np.zeros(far.shape, bool)
    nearer[12:19, 4:11] = nearer[15, 11:14] = True  # coarse pixels are those of even row and column
    gbuffer = gbuffer_of(
        ctx, np.where(nearer[..., None], board, wall), np.array([0.0, 0.0, 1.0]) + 0 * wall, np.where(nearer, near, far)
    )
    E = np.where(nearer, 9.0, 1.0)[::-2, ::2]
    sums = np.stack([E, E, E, np.ones_like(E)], axis=-1)
    made = UpsamplePass(ctx, SIZE)(SplatBuffer(table_texture(ctx, sums), table_texture(ctx, np.ones_like(sums))), gbuffer, CAMERA)
    assert np.allclose(pixels(made.sums)[15, 11:14, :3], 9.0, rtol=0.1)
