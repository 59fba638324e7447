"""Limit of the cache: number of records, choice of evicted records, and unchanged views."""

from __future__ import annotations

import moderngl
import numpy as np

import irrsplat
from irrsplat import Renderer
from irrsplat.core.buffers import CHANNELS
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera
from tests.records.test_cache import made_up
from tests.renderer.test_persistence import turned
from tests.renderer.test_renderer import FAST, FRONT, room, unserved
from tests.support.worlds import sites, write_columns

SIZE = (40, 40)


def test_every_column_moves_with_its_record_when_others_go(ctx: moderngl.Context) -> None:
    """Every column moves with its record, on the CPU and on the GPU; names stay, indices do not."""
    cache = RecordCache(ctx)
    p, n, values = made_up(3000)
    cache.append(sites(p, n), values)
    cache.invalidate()
    cache.mark_refreshed(np.arange(0, 3000, 3))
    limits = np.linspace(0.1, 1.0, 3000, dtype="f4")
    write_columns(cache.records, 0, limit=limits, curvature=values[:, 2:] + 4.0, axis=values[:, :3])
    numbers = np.flatnonzero(np.random.default_rng(0).random(3000) < 0.5)
    edits = cache.revision
    cache.keep_only(numbers)
    records, count = cache.records, len(numbers)
    assert cache.count == records.count == count and cache.revision > edits and cache.evicted == 3000 - count
    assert np.array_equal(cache.read()["irradiance"], values[numbers, :3])
    expected = {"position": p.astype("f4"), "limit": limits, "curvature": values[:, 2:] + 4.0, "axis": values[:, :3]}
    for name, column in records.read(*expected).items():
        assert np.array_equal(column, expected[name][numbers]), name
    assert np.array_equal(cache.positions, p[numbers].astype("f4"))
    assert np.array_equal(numbers[cache.stale], numbers[numbers % 3 > 0])
    assert np.array_equal(cache.column("id"), numbers)
    assert cache.append(sites(p[:1], n[:1])) == count and cache.column("id")[count] == 3000
    cache.release()


def flight() -> list[Camera]:
    return [turned(FRONT, angle) for angle in range(0, 360, 60)]


def test_a_full_turn_with_fewer_records_than_it_takes() -> None:
    """The limit always holds; every view is complete, and equals the picture of its own records."""
    with Renderer(room(), SIZE, **FAST) as free:
        counts = [free.render(camera).stats["records"] for camera in flight()]
    least = max(counts[0], 100)
    most = (3 * least + counts[-1]) // 4
    assert counts[-1] > 1.3 * most, "else there is nothing to be tried here"
    with Renderer(room(), SIZE, **FAST, max_records=most) as bounded:
        seen: list[int] = []
        for camera in flight():
            frame = bounded.render(camera, progress=lambda now: seen.append(now.records))
            assert frame.stats["converged"] and not frame.stats["full"] and unserved(frame) == 0
            assert len(np.unique(frame.records_position, axis=0)) == len(frame.records_position)
        assert max(seen) <= most and bounded.cache.evicted > 0.2 * most
        bounded.forget(records=False)
        again = bounded.render(camera)
        assert again.stats["rounds"] == 1
        assert all(np.array_equal(getattr(frame, name), getattr(again, name)) for name in CHANNELS)


def test_a_view_that_needs_more_stops_and_says_so() -> None:
    frame = irrsplat.render(room(), SIZE, **FAST, a=0.1, max_records=150)
    assert frame.stats["full"] and not frame.stats["converged"] and frame.stats["rounds"] < 8
    assert frame.stats["records"] == 150 and unserved(frame) > 0
    with Renderer(room(), SIZE, **FAST, a=0.1, max_records=150) as bounded:
        bounded.render()
        assert bounded.render().stats["full"], "when asked again, too"
        bounded.change(bounded.settings.with_values({"max_records": 4000}))
        more = bounded.render()
    assert more.stats["converged"] and not more.stats["full"] and unserved(more) == 0
