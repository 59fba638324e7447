"""View culling of records: contributing records are kept, to the bit, and most others are left out."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.core.vertex_layout import vertex_column
from irrsplat.indirect.splat import SplatPass
from irrsplat.records import culling
from irrsplat.records.culling import reaching
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.flatten import flatten
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings, preset
from tests.renderer.test_renderer import FAST
from tests.support.worlds import box, gbuffer_of, lamp, material, on_plane, scene, sites

SIZE = (45, 30)
COUNT = 3000


def scattered(ctx: moderngl.Context, seed: int) -> RecordCache:
    """Return records all over a floor of 20 m, with radii from tiny to half of its size."""
    rng = np.random.default_rng(seed)
    cache = RecordCache(ctx)
    p = rng.uniform(-10.0, 10.0, (COUNT, 3)) * (1.0, 0.0, 1.0)
    values = np.column_stack([rng.uniform(0.0, 3.0, (COUNT, 3)), 10.0 ** rng.uniform(-2.0, 1.0, COUNT)])
    cache.append(sites(p, (0.0, 1.0, 0.0)), values)
    return cache


def cameras(count: int, seed: int) -> list[Camera]:
    """Return cameras close to the floor with any direction and field of view."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        eye = rng.uniform((-9, 0.05, -9), (9, 3.0, 9))
        target = eye + rng.normal(size=3) * (1.0, 0.7, 1.0)
        made.append(Camera(tuple(eye), tuple(target), (0.1, 1.0, 0.0), float(rng.uniform(5.0, 150.0))))
    return made


SETTINGS = {
    "paper": preset("paper", a=0.4),
    "no least radius": Settings(radius_min=0.0, radius_max=30.0),
    "radii by gradients": Settings(radius_max=0.0, radius_min=1.0),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_what_is_left_out_would_add_nothing(ctx: moderngl.Context, name: str) -> None:
    """Every sum is equal to the bit to that of all records, from cameras inside the set."""
    settings, cache = SETTINGS[name], scattered(ctx, 1)
    splats, drawn = SplatPass(ctx, SIZE, settings.gradients), []
    for camera in cameras(40, 2):
        position, depth = on_plane(camera, SIZE, (0, 0, 0), (0, 1, 0))
        seen = (depth > 0.01) & (depth < 30.0)
        normal = np.broadcast_to((0.0, 1.0, 0.0), position.shape)
        gbuffer = gbuffer_of(ctx, np.where(seen[..., None], position, 0.0), normal, np.where(seen, depth, 0.0))
        found = []
        for numbers in (np.arange(COUNT), reaching(cache, 0, camera, SIZE, settings)):
            splats.clear(gbuffer)
            splats(cache.records, numbers, gbuffer, camera, settings)
            found.append((splats.target.read(0).copy(), splats.target.read(1).copy(), len(numbers)))
        (all_sums, all_weight, _), (sums, weight, count) = found
        assert np.array_equal(sums, all_sums) and np.array_equal(weight, all_weight)
        drawn.append(count)
    assert np.median(drawn) < 0.6 * COUNT and min(drawn) < 0.15 * COUNT, "and they are left out"
    splats.release()
    cache.release()


def cells() -> Scene:
    """Return three by three rooms of 2 m, with a light in the central one."""
    rooms = [box((i, 0, j), (i + 1.95, 1.5, j + 1.95), material(0.6), outward=False) for i in (-3, -1, 1) for j in (-3, -1, 1)]
    return scene(*rooms, lights=(lamp((0, 1, 0)),))


def test_what_is_hidden_would_add_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Records on all walls of many rooms: sums from within the rooms are equal to the bit, and few records are drawn."""
    monkeypatch.setattr(culling, "_MANY", 0)
    size = (120, 80)  # several tiles
    rng, world, settings = np.random.default_rng(7), cells(), Settings()
    vertices, faces, _ = flatten(world)
    face = faces[rng.integers(0, len(faces), COUNT)]
    share = rng.dirichlet((1, 1, 1), COUNT)
    p, n = (np.einsum("nc,ncx->nx", share, vertex_column(vertices, name)[face]) for name in ("position", "normal"))
    drawn = []
    with Renderer(world, size, **FAST) as renderer:
        values = np.column_stack([rng.uniform(0.0, 3.0, (COUNT, 3)), 10.0 ** rng.uniform(-2.0, -0.3, COUNT)])
        renderer.cache.append(sites(p, n), values)
        splats = SplatPass(renderer.ctx, size, settings.gradients)
        for camera in cameras(30, 8):
            eye = rng.uniform((-2.9, 0.05, -2.9), (2.9, 1.45, 2.9))
            camera = replace(camera, eye=tuple(eye), target=tuple(eye + np.subtract(camera.target, camera.eye)))
            gbuffer = renderer.draw_gbuffer(camera)
            found = []
            sight = partial(splats.farthest, gbuffer, camera)
            for numbers in (np.arange(COUNT), reaching(renderer.cache, 0, camera, size, settings, sight)):
                splats.clear(gbuffer)
                splats(renderer.cache.records, numbers, gbuffer, camera, settings)
                found.append((splats.target.read(0).copy(), splats.target.read(1).copy()))
            assert all(np.array_equal(one, other) for one, other in zip(*found, strict=True))
            drawn.append(len(numbers) / max(len(reaching(renderer.cache, 0, camera, size, settings)), 1))
    assert np.mean(drawn) < 0.9 and min(drawn) < 0.3, "of those in the pyramid"
