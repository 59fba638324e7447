"""Culling of a g-buffer's triangles: parts outside of the view, and inner sides of closed meshes around which the eye is not."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

from irrsplat.gpu.target import pixels
from irrsplat.gpu.world import World
from irrsplat.image.gbuffer import GBufferPass
from irrsplat.scene.model import Camera, Scene
from irrsplat.scene.spatial import visible_parts
from tests.support.worlds import box, floor, scene

SIZE = (120, 90)
WORLD = scene(floor(), box((-1, 1, -1), (1, 3, 1)), box((3, 0, -1), (5, 2, 1)), box((39, 1, -1), (41, 3, 1)))
VIEWS = {
    "outside": Camera((0.0, 4.0, 8.0), (1.0, 1.0, 0.0)),
    "in a box": Camera((0.3, 2.2, 0.1), (4.0, 1.0, 0.5)),
    "away": Camera((0.0, 4.0, 8.0), (0.0, 5.0, 20.0)),
}


@pytest.mark.parametrize("view", VIEWS)
def test_the_g_buffer_lacks_nothing(ctx: moderngl.Context, view: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is the same as of open meshes, each of one part, of which all is drawn; here of many parts."""
    monkeypatch.setattr(visible_parts, "_MOST", 5)

    def drawn(world: Scene) -> list[np.ndarray]:
        with World(ctx, world) as placed, GBufferPass(ctx, SIZE) as gbuffer_pass:
            seen = gbuffer_pass(placed, VIEWS[view])
            textures = (seen.position, seen.normal, seen.albedo)
            return [np.where(pixels(seen.position)[..., 3:] > 0.0, pixels(texture), 0.0) for texture in textures]

    whole = replace(WORLD, meshes=tuple(replace(mesh, closed=False) for mesh in WORLD.meshes))
    assert all(np.array_equal(*pair) for pair in zip(drawn(WORLD), drawn(whole), strict=True))


def test_thin_walls_hide_the_ground_behind_them(ctx: moderngl.Context) -> None:
    """An eye in a closed box without thickness, which stands in the ground, sees no ground outside of it.

    The rounding of corners, some 1/256 of a pixel, may show a pixel of each edge by less than a tenth of its size.
    """
    world = scene(floor(5.0), box((-1, -0.3, -1), (1, 1.7, 1)))
    camera = Camera((0.9, 1.2, 0.9), (-0.6, 0.3, -0.6))
    with World(ctx, world) as placed, GBufferPass(ctx, SIZE) as gbuffer_pass:
        seen = pixels(gbuffer_pass(placed, camera).position)
    beyond = np.abs(seen[..., [0, 2]]).max(-1)[seen[..., 3] > 0.0] - 1.0
    assert len(beyond) == SIZE[0] * SIZE[1] and beyond.max() < 0.1 * camera.pixel(SIZE) * 3.0
