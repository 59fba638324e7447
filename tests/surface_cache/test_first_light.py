"""Where the first surface cache takes long, records of one bounce come before it is there, and all are gathered again after."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.gpu.time_budget import Budget
from irrsplat.image.view import Progress
from irrsplat.indirect.gathering import record_gatherer
from irrsplat.renderer import rounds
from irrsplat.surface_cache import site_layout, site_rays
from tests.renderer.test_renderer import FAST, SIZE, room
from tests.support.worlds import lamp

ALL = {**FAST, "bounces": "all", "gather": "trace", "light_samples": 0}
TICK = 2e-3


@pytest.fixture(autouse=True)
def slow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ticks have waited long enough from the first one on, for a surface cache of few points and rays."""
    monkeypatch.setattr(record_gatherer, "_PATIENCE", -1.0)
    monkeypatch.setattr(site_layout, "POINTS", (300, 300))
    monkeypatch.setattr(site_rays, "SIDES", (8, 8))


def ticks(renderer: Renderer, until: Callable[[Progress], bool]) -> Progress:
    """Ticks of little time until one is as wanted; its progress."""
    for _ in range(5000):
        progress = renderer.frame(seconds=TICK)[1]
        if until(progress):
            return progress
    raise AssertionError(progress)


def same_light(renderer: Renderer) -> bool:
    """Whether its picture at rest is that of a renderer that has made none before, as far as other records go."""
    ours = renderer.render()
    with Renderer(renderer.scene, renderer.size, ctx=renderer.ctx, **asdict(renderer.settings)) as fresh:
        theirs = fresh.render()
    off = np.sqrt(np.mean((ours.irradiance - theirs.irradiance) ** 2)) / theirs.irradiance.mean()
    assert ours.stats["bounces"] == theirs.stats["bounces"] and ours.stats["bounces_converged"]
    return bool(off < 0.05 and abs(ours.irradiance.mean() / theirs.irradiance.mean() - 1.0) < 0.01)


def test_one_bounce_is_shown_before_all_are_known(ctx: moderngl.Context, tmp_path: Path) -> None:
    with Renderer(room(), SIZE, ctx=ctx, **ALL) as renderer:
        early = ticks(renderer, lambda now: now.records > 20)
        assert early.surface < 1.0 and not early.still and not early.done
        stats = renderer.stats(renderer.frame(gather=False)[0])
        assert (stats["bounces"], stats["bounces_converged"]) == (1, False)
        where, values = renderer.cache.sites(slice(0, early.records)), renderer.cache.read()["irradiance"][: early.records]
        renderer.save_cache(tmp_path / "early")
        complete = ticks(renderer, lambda now: now.surface == 1.0)
        assert complete.renewed + complete.stale >= complete.records - complete.new and not complete.still
        ticks(renderer, lambda now: now.still)
        assert (renderer.cache.read()["irradiance"][: early.records] > values).mean() > 0.9
        assert same_light(renderer)
    with Renderer(room(), SIZE, ctx=ctx, **{**ALL, "bounces": 1}) as one:
        one.frame(gather=False)
        assert one.shadows is not None
        one.scheduler.gatherer.gather(one.shadows, where, Budget(None))
        assert np.array_equal(one.cache.read()["irradiance"], values), "they hold one bounce"
    with Renderer(room(), SIZE, ctx=ctx, **ALL) as fresh:
        fresh.load_cache(tmp_path / "early")
        assert len(fresh.cache.stale) == fresh.cache.count, "the file does not pass them as finished"
        assert same_light(fresh)


def test_what_will_be_gathered_again_takes_few_rays(ctx: moderngl.Context) -> None:
    settings = {**ALL, "gather_size": 32, "ray_noise": 4.0}
    with Renderer(room(), SIZE, ctx=ctx, **settings) as renderer:
        early = ticks(renderer, lambda now: now.records > 20)
        assert early.surface < 1.0
        where, values = renderer.cache.sites(slice(0, early.records)), renderer.cache.read()["irradiance"][: early.records]
    with Renderer(room(), SIZE, ctx=ctx, **{**settings, "bounces": 1}) as one:
        one.frame(gather=False)
        assert one.shadows is not None
        one.scheduler.gatherer.gather(one.shadows, where, Budget(None), size=16)
        assert np.array_equal(one.cache.read()["irradiance"], values)


def test_a_rough_picture_of_one_bounce_is_enough(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """From some coverage on, ticks work at the surface cache alone until it is there."""
    monkeypatch.setattr(rounds, "_ROUGHLY", 0.0)
    with Renderer(room(), SIZE, ctx=ctx, **ALL) as renderer:
        early = ticks(renderer, lambda now: now.coverage > 0.0)
        assert early.surface < 1.0 and early.coverage < 1.0
        made: list[int] = []

        def there(now: Progress) -> bool:
            made.append(now.new)
            return now.surface == 1.0

        ticks(renderer, there)
        assert len(made) > 1 and not any(made[:-1])
        assert ticks(renderer, lambda now: now.still).coverage == 1.0


def relit(renderer: Renderer) -> None:
    renderer.relight([lamp((0.3, 0.5, 0.4), 5.0)])


def resized(renderer: Renderer) -> None:
    renderer.resize((SIZE[0] // 2, SIZE[1] // 2))


def other_seed(renderer: Renderer) -> None:
    renderer.change(renderer.settings.with_values({"seed": 3}))


@pytest.mark.parametrize("change", [relit, resized, other_seed])
def test_changes_before_it_is_complete(ctx: moderngl.Context, change: Callable[[Renderer], None]) -> None:
    with Renderer(replace(room(), lights=(lamp((-0.5, 0.2, 0.5), 5.0),)), SIZE, ctx=ctx, **ALL) as renderer:
        assert ticks(renderer, lambda now: now.records > 5).surface < 1.0
        change(renderer)
        ticks(renderer, lambda now: now.still)
        assert same_light(renderer)
