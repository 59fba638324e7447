"""Half-resolution first: a moving view is close to the converged view, which has all pixels."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np

import irrsplat
from irrsplat.gpu.target import pixels
from irrsplat.renderer import Renderer

SIZE = (37, 29)


def test_a_moving_view_is_like_the_one_at_rest_which_is_exact() -> None:
    scene = irrsplat.load("cornell")
    with Renderer(scene, size=(170, 400), preset="preview", bounces=1) as renderer:
        renderer.render()
        camera = scene.camera()
        moved = replace(camera, eye=(camera.eye[0] + 0.1, *camera.eye[1:]))
        renderer.render(moved)
        renderer.render(camera)
        view, progress = renderer.frame(moved)
        assert renderer.splats.sums and renderer.splats.sums.pixel_stride == 2
        assert progress.new == 0 and not progress.done  # it continues to all pixels
        coarse = _irradiance(view.splats.sums)
        view, progress = renderer.frame(moved)
        assert renderer.splats.sums and renderer.splats.sums.pixel_stride == 1 and progress.done and progress.new == 0
        fine = _irradiance(view.splats.sums)
        error = np.sqrt(((coarse - fine) ** 2).mean()) / fine.mean()
        assert 0.0 < error < 0.025
        # independent of the way: equal to one splat of all records
        renderer.forget(records=False)
        again = renderer.render(moved)
        assert np.array_equal(again.irradiance, fine)


def _irradiance(sums: moderngl.Texture) -> np.ndarray:
    total = pixels(sums)
    return total[..., :3] / np.where(total[..., 3:] > 0.0, total[..., 3:], np.float32(1.0))
