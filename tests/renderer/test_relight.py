"""Other lights: which records are gathered again first, and that in the end they are those of a fresh render."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat import Renderer
from irrsplat.core.buffers import NOTHING_SEEN
from irrsplat.gpu.target import pixels
from irrsplat.gpu.time_budget import Budget
from irrsplat.indirect import paper_scan
from irrsplat.indirect.view_state import ViewState
from irrsplat.reference import fine_gather
from irrsplat.scene.model import Camera, Light, Scene
from tests.renderer.test_live import TICK, dimmed, ticks
from tests.renderer.test_renderer import FAST, FRONT, SIZE, room
from tests.support.skies import mapped
from tests.support.worlds import box, floor, lamp, scene

MOVED = (lamp((-0.5, 0.2, 0.5), 5.0),)
COLOURED = (replace(room().lights[0], color=(3.0, 1.2, 0.3)),)
AWAY = Camera((0.0, 0.0, 0.95), (0.9, -0.1, 0.4), fov=60.0)


@pytest.fixture
def renderer() -> Iterator[Renderer]:
    """A renderer of `room` that has served two views, FRONT last."""
    with Renderer(room(), SIZE, **FAST, radius_max=25.0) as made:
        made.render(AWAY)
        made.render(FRONT)
        yield made


def served(renderer: Renderer) -> np.ndarray:
    """(N,) the pixels that each record adds to, by splatting it alone."""
    counts = []
    gbuffer, records, splat = renderer.draw_gbuffer(FRONT), renderer.cache.records, renderer.splats.splat_pass
    for i in range(records.count):
        splat.clear(gbuffer)
        splat(records, np.array([i]), gbuffer, FRONT, renderer.settings)
        found = splat.target.read(1)[..., 0]
        counts.append(np.count_nonzero((found > 0.0) & (found < NOTHING_SEEN)))
    renderer.forget(records=False, lights=False)
    return np.array(counts)


def test_records_are_ranked_by_the_pixels_that_they_serve(renderer: Renderer) -> None:
    true = served(renderer)
    rank = renderer.scheduler.renewal.coverage_pass(
        renderer.cache.records, renderer.draw_gbuffer(FRONT), FRONT, renderer.settings
    )
    assert len(rank) == len(true) and (true == 0).mean() > 0.1 and true.max() > 100
    assert np.corrcoef(true, rank)[0, 1] > 0.95 and rank.sum() == pytest.approx(true.sum(), rel=0.2)
    assert rank[true == 0].max() < 0.05 * true.max(), "hidden, or off the screen"
    assert rank[true > 0.3 * true.max()].min() > 0.1 * true.max()


def test_what_is_seen_most_and_longest_comes_first(renderer: Renderer) -> None:
    """Pixels times how often they have become stale; what is not seen at all, last, the stalest of it first."""
    cache, renewal = renderer.cache, renderer.scheduler.renewal
    gbuffer = renderer.draw_gbuffer(FRONT)
    rank = renewal.coverage_pass(cache.records, gbuffer, FRONT, renderer.settings)
    assert not len(renewal.order(cache, gbuffer, FRONT, renderer.settings))
    cache.invalidate()
    first = renewal.order(cache, gbuffer, FRONT, renderer.settings)
    assert sorted(first) == list(range(cache.count)) and (np.diff(rank[first]) <= 0.0).all()
    half = len(first) // 2
    cache.mark_refreshed(first[:half])
    assert np.array_equal(renewal.order(cache, gbuffer, FRONT, renderer.settings), first[half:])
    cache.invalidate()
    second = renewal.order(cache, gbuffer, FRONT, renderer.settings)
    waited = np.where(np.isin(second, first[:half]), 1, 2)
    assert np.array_equal(cache.age(second), waited) and (np.diff(rank[second] * waited) <= 0.0).all()
    unseen = waited[rank[second] == 0.0]
    assert len(unseen) and (np.diff(unseen) <= 0).all()
    elsewhere = renewal.order(cache, renderer.draw_gbuffer(AWAY), AWAY, renderer.settings)
    assert sorted(elsewhere) == sorted(second) and not np.array_equal(elsewhere, second), "another view, another order"


def test_none_asks_for_more_while_others_are_stale(renderer: Renderer) -> None:
    """Light that is switched off in half of the records contradicts the other half's, but that goes by itself."""
    count = renderer.cache.count
    renderer.relight([dimmed(room().lights[0], 0.02)])
    told = ticks(renderer, TICK)
    assert all(p.new == 0 or p.stale == 0 for p in told) and told[-1].done
    assert told[-1].records <= 1.1 * count


@pytest.mark.parametrize("bounces", [1, "all"])
@pytest.mark.parametrize("lights", [MOVED, (*MOVED, *COLOURED)], ids=["moved", "another"])
def test_renewed_in_place_is_gathered_from_scratch(lights: tuple[Light, ...], bounces: Any) -> None:
    """The same sites under the new light, in small ticks and at once in a fresh cache: the same bits, and the picture."""
    settings = {**FAST, "bounces": bounces, "gather": "trace"}
    with Renderer(room(), SIZE, **settings) as old, Renderer(replace(room(), lights=lights), SIZE, **settings) as fresh:
        old.render()
        old.relight(lights)
        count = old.cache.count
        for _ in range(2000):
            progress = old.frame(seconds=0.01)[1]
            if progress.done:
                break
        assert progress.done
        fresh.frame(gather=False)
        fresh.cache.append(old.cache.sites(slice(0, old.cache.count)))
        fresh.cache.invalidate()
        assert fresh.shadows is not None and fresh.scheduler.prepare(fresh.shadows, Budget(None))
        fresh.scheduler.renew(fresh.shadows, fresh.gbuffer, FRONT, Budget(None))
        fresh.cache.luminance_floor = old.cache.luminance_floor  # it stays while it is about what these records would give
        fresh.scheduler.limit_radii(ViewState(), last=True)  # with each other, as at a view's end
        theirs, found = pixels(fresh.frame(gather=False)[0].image), fresh.cache.read()
        mine = pixels(old.frame(gather=False)[0].image)
        assert old.cache.count >= count and all(np.array_equal(values, found[name]) for name, values in old.cache.read().items())
    assert np.array_equal(mine, theirs)


def truth(renderer: Renderer, count: int = 250) -> fine_gather.Truth:
    """The renderer's own fine gather of one bounce at some of its pixels."""
    seen = paper_scan.read_back(renderer.frame(gather=False)[0].gbuffer)
    size = renderer.settings.shadow_size
    return fine_gather.gather(renderer.world, seen, size, count, seconds=1e6)


def errors(before: Scene, change: Any, after: Scene, seeds: int = 2, **settings: Any) -> tuple[float, float]:
    """√mean of the squared errors, of so many seeds, against the truth after a change: of fresh renders, and after `change` of a
    renderer that has served the scene before."""
    fresh, changed, reference = [], [], None
    for seed in range(seeds):
        with Renderer(after, (80, 80), **settings, seed=seed) as new, Renderer(before, (80, 80), **settings, seed=seed) as old:
            reference = reference or truth(new)
            fresh.append(reference.error(new.render().irradiance))
            old.render()
            change(old)
            changed.append(reference.error(old.render().irradiance))
    return float(np.sqrt(np.mean(np.square(fresh)))), float(np.sqrt(np.mean(np.square(changed))))


def test_after_other_lights_errors_are_those_of_a_fresh_render() -> None:
    """Over five seeds, for a single pixel at the foot of a box may double either one's."""
    before = irrsplat.load("cornell")
    (old,) = before.lights
    x, y, z = old.position
    new = replace(old, position=(x - 1.0, y, z), color=(34.0, 9.6, 0.8))
    after = replace(before, lights=(new,))
    settings: Any = {"bounces": 1, "gather_size": 32, "shadow_size": 512}
    fresh, relit = errors(before, lambda r: r.relight(after.lights), after, seeds=5, **settings)
    assert 0.001 < fresh < 0.1 and relit < 1.4 * fresh


@pytest.mark.parametrize("bounces", [1, "all"])
def test_another_sky_lights_in_proportion_and_a_map_of_one_radiance_as_that(bounces: int | str) -> None:
    """A box on a floor, and no light but the sky: three times its radiance is three times the irradiance everywhere, and so is a
    map that is the same all around; the records stay, and at rest nothing is left of the old sky."""
    plain = scene(floor(), box((-0.5, 0.0, -0.5), (0.5, 0.7, 0.5)), sky=1.0)
    tripled = replace(plain, sky=(3.0, 3.0, 3.0))
    around = replace(mapped(plain, np.full((32, 64, 3), 3.0)), sky=(0.0, 0.0, 0.0))
    with Renderer(plain, SIZE, **{**FAST, "gather": "trace", "bounces": bounces}, radius_max=25.0) as renderer:
        before = renderer.render().irradiance
        count = renderer.cache.count
        for other, times in ((tripled, 3.0), (around, 3.0), (plain, 1.0)):
            renderer.pose(other)
            after = renderer.render().irradiance
            assert after.mean() == pytest.approx(times * before.mean(), rel=0.01) and before.mean() > 0.5
            assert np.quantile(np.abs(after - times * before), 0.95) < 0.03 * times * before.mean()
            assert renderer.cache.count <= 1.1 * count
