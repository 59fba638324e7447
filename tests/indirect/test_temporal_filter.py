"""Temporal accumulation with reprojection: convergence to the records' light, after that of holes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest

from irrsplat.core.buffers import SplatBuffer
from irrsplat.gpu.target import pixels, table_texture
from irrsplat.indirect.temporal_filter import CHANGING, PICTURES, SHARE, TemporalFilter
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera
from tests.renderer.test_renderer import FAST, FRONT, room
from tests.support.worlds import gbuffer_of, on_plane

SIZE = (37, 29)
TICK = 1e-4  # seconds: the smallest frame budget
LIGHT: dict[str, Any] = {**FAST, "bounces": 2, "a": 0.8}


@pytest.mark.parametrize("stride", [1, 2])
def test_light_stays_at_its_place_and_converges_to_the_records(ctx: moderngl.Context, stride: int) -> None:
    """With a camera along a wall, a share of the new light shows at once, all of it PICTURES later.

    Pixels without history, or with the history of another surface, have the new light at once.
    """
    first, second = (Camera((x, 0.2, 3.0), (x, 0.0, 0.0), fov=50.0) for x in (0.0, 0.35))
    filter, every = TemporalFilter(ctx, SIZE), (slice(None, None, -stride), slice(None, None, stride))

    def shown(
        camera: Camera, subject: str, brightness: float, edge: float, scene: object = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the filter's output for linear light on a wall, with a step by a metre to the right of `edge`, and its
        positions.
        """
        position, depth = on_plane(camera, SIZE, (0, 0, 0), (0, 0, 1))
        near, near_depth = on_plane(camera, SIZE, (0, 0, 1), (0, 0, 1))
        nearer = position[..., 0] > edge
        position, depth = np.where(nearer[..., None], near, position), np.where(nearer, near_depth, depth)
        gbuffer = gbuffer_of(ctx, position, np.broadcast_to((0.0, 0.0, 1.0), position.shape), depth)
        place, k = position[every], 3.0
        sums = np.concatenate([k * brightness * (place[..., :1] + 4.0) * np.ones(3), np.full((*place.shape[:2], 1), k)], axis=-1)
        texture = table_texture(ctx, sums)
        made = pixels(filter(SplatBuffer(texture, texture, pixel_stride=stride), gbuffer, camera, subject, (scene,)).sums)[::-1]
        return made[..., 0] / made[..., 3] / (place[..., 0] + 4.0), place

    before, old = shown(first, "one", 1.0, 9.0)
    assert np.allclose(before, 1.0, atol=1e-5) and filter.left("one") == 0
    found, place = shown(second, "two", 2.0, 1.0)
    inside = (place[..., 0] < old[..., 0].max()) & (place[..., 2] < 0.5)
    assert np.allclose(found[inside], 1.0 + SHARE, atol=0.02) and inside.mean() > 0.5
    assert np.allclose(found[place[..., 2] > 0.5], 2.0, atol=1e-5), "another surface stood there"
    assert np.allclose(found[place[..., 0] > old[..., 0].max() + 0.2], 2.0, atol=1e-5), "it was not seen"
    for left in range(PICTURES - 1, -1, -1):
        assert filter.left("two") == left
        found, _ = shown(second, "two", 2.0, 1.0)
    assert np.allclose(found, 2.0, atol=1e-5)
    found, _ = shown(second, "three", 3.0, 1.0, scene="moved")
    assert np.allclose(found, 2.0 + CHANGING, atol=0.02), "what is no longer true goes sooner"


@pytest.mark.few_sites
def test_holes_show_probes_and_at_rest_the_picture_is_that_of_the_records() -> None:
    """Before the first record, few rays at each pixel and the filter give the converged irradiance, but for their noise."""
    moved = replace(FRONT, eye=(FRONT.eye[0] + 0.1, *FRONT.eye[1:]))
    with Renderer(room(), (48, 32), **LIGHT) as renderer:
        converged = renderer.render(FRONT).irradiance
        renderer.forget(lights=False)
        view, _ = renderer.frame(FRONT, TICK)
        assert not pixels(view.splats.weight).any(), "there was no record yet"
        sums = pixels(view.splats.sums)
        found = sums[..., :3] / sums[..., 3:]
        assert np.sqrt(((found - converged) ** 2).mean()) < 0.15 * converged.mean()
        renderer.converge(moved)
        view, progress = renderer.frame(FRONT, TICK)
        while not progress.still:
            view, progress = renderer.frame(moved, TICK)
            assert progress.accumulating == view.accumulating and not (progress.still and progress.accumulating)
        stride, drawn = view.splats.pixel_stride, renderer._frames.stages.splats(renderer._frames.state).sums
        assert stride == 1 and drawn is not None and view.splats.sums is drawn.sums
