"""View culling of records: contributing records are kept, to the bit, and most others are left out."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat.indirect.splat import SplatPass
from irrsplat.records.culling import reaching
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings, preset
from tests.support.worlds import gbuffer_of, on_plane, sites

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
    splats, drawn = SplatPass(ctx, SIZE), []
    for camera in cameras(40, 2):
        position, depth = on_plane(camera, SIZE, (0, 0, 0), (0, 1, 0))
        seen = (depth > 0.01) & (depth < 30.0)
        normal = np.broadcast_to((0.0, 1.0, 0.0), position.shape)
        gbuffer = gbuffer_of(ctx, np.where(seen[..., None], position, 0.0), normal, np.where(seen, depth, 0.0))
        found = []
        for numbers in (np.arange(COUNT), reaching(cache, 0, camera, SIZE, settings)):
            splats.clear(gbuffer)
            splats(cache.records, numbers, gbuffer, camera, settings)
            found.append((splats.target(1).read(0).copy(), splats.target(1).read(1).copy(), len(numbers)))
        (all_sums, all_weight, _), (sums, weight, count) = found
        assert np.array_equal(sums, all_sums) and np.array_equal(weight, all_weight)
        drawn.append(count)
    assert np.median(drawn) < 0.6 * COUNT and min(drawn) < 0.15 * COUNT, "and they are left out"
    splats.release()
    cache.release()
