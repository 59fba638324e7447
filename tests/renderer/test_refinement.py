"""Refinement of a view at rest: errors fall, the estimate is honest, and the view goes back to what its settings make of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.core.buffers import HitLight
from irrsplat.gather.look import gather_records
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu.target import pixels
from irrsplat.gpu.time_budget import Budget
from irrsplat.indirect.paper_scan import read_back
from irrsplat.records.record_cache import RecordCache
from irrsplat.reference import fine_gather
from irrsplat.renderer import Renderer
from irrsplat.settings import SettingValues
from irrsplat.surface_cache import lookup_table, site_layout
from irrsplat.surface_cache.site_layout import FIRST_SITE
from irrsplat.surface_cache.site_places import PLACES
from tests.support.viewing import write_room

SIZE = (64, 48)
COARSE: SettingValues = {
    "bounces": 1,
    "gather": "trace",
    "gather_size": 16,
    "shadow_size": 256,
    "radius_max": 20.0,
    "spread": 0.3,
}


@pytest.fixture(scope="module")
def renderer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Renderer]:
    scene = irrsplat.load(write_room(tmp_path_factory.mktemp("room")))
    with Renderer(scene, SIZE, **COARSE) as made:
        yield made


def test_a_refined_view_comes_near_the_truth_and_tells_how_near(renderer: Renderer) -> None:
    first = renderer.render()
    truth = fine_gather.gather(renderer.world, read_back(renderer.draw_gbuffer(renderer.scene.camera())), 256, count=80)
    before = truth.error(first.irradiance)
    renderer.change(renderer.settings.with_values({"quality": 0.4 * 100.0 * (before or 0.0)}))
    refined = renderer.render()
    after, told = truth.error(refined.irradiance), refined.stats["error"]
    assert first.stats["error"] is None and before and after and told
    assert after < 0.5 * before and told <= 0.4 * before
    assert 1 / 1.5 < told / after < 1.5
    assert refined.stats["records"] > first.stats["records"]


def test_a_view_that_is_not_complete_is_completed_first(renderer: Renderer) -> None:
    """Asked for too early, refinement is the next frame; it does not keep the view from being filled."""
    renderer.forget()
    _, progress = renderer.frame(seconds=1e-4)
    assert not progress.done
    renderer.refine(None, 0.05, 1e-4)
    for _ in range(500):
        _, progress = renderer.frame(seconds=0.02)
        if progress.done:
            break
    assert progress.done and progress.coverage == 1.0


def test_small_ticks_refine_as_a_render_does_and_motion_ends_it(renderer: Renderer) -> None:
    """Ticks of a millisecond come to the same bits as one call. A view of another side and back has the records that it had
    before, gathered more finely where they were."""
    renderer.forget()
    renderer.change(renderer.settings.with_values({"quality": 0.0}))
    plain = renderer.render()
    target, pictures = 0.02, []
    for seconds in (0.001, None):
        renderer.forget()
        renderer.render()
        progress = None
        while progress is None or not progress.refined:
            view, progress = renderer.refine(None, target, seconds)
        pictures.append(np.frombuffer(view.image.read(), "f4").copy())
        assert renderer.frame()[0] is view  # it stays while nothing moves
    assert np.array_equal(pictures[0], pictures[1])
    camera = renderer.scene.camera()
    renderer.frame("corner")
    count = renderer.render(camera).stats["records"]
    renderer.forget()
    renderer.render(camera)
    renderer.frame("corner")
    assert count == renderer.render(camera).stats["records"]
    renderer.forget()
    assert np.array_equal(renderer.render(camera).image, plain.image)


def test_the_surface_cache_is_refined_in_ticks_until_the_scene_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With two bounces it holds E_1, which four times as many rays bring nearer to that of sixteen times as many."""
    monkeypatch.setattr(site_layout, "POINTS", (100, 100))
    scene = irrsplat.load(write_room(tmp_path))
    with Renderer(scene, SIZE, **(COARSE | {"bounces": 2})) as renderer:
        renderer.frame()
        gatherer, shadows = renderer.scheduler.gatherer, renderer.draw_shadows()
        surface = gatherer.surface_now
        assert surface is not None and surface.result is not None
        laid_out, fine = surface._laid_out, TraceGather(renderer.world, 64, places=PLACES)
        assert laid_out is not None and laid_out.places is not None
        numbers, places = np.arange(FIRST_SITE, laid_out.records.count), laid_out.places.of
        with fine, ReducePass(renderer.ctx, gradients=False, places=PLACES) as reduce, RecordCache(renderer.ctx) as cache:
            cache.append(laid_out.layout.sites)
            gather_records(fine, reduce, HitLight(shadows), cache, numbers, seed=0, where=places)
            true = cache.read()["irradiance"][FIRST_SITE:]

        def off() -> float:
            assert surface.result is not None
            return float(np.sqrt(np.mean((surface.result.irradiance[FIRST_SITE:] - true) ** 2)))

        before, first, calls = off(), surface.result, 1
        while not gatherer.refine_surface(shadows, Budget(1e-4)):
            calls += 1
        assert calls > 2 and off() < 0.6 * before
        refined = surface.result
        assert surface.refined and refined is not first
        renderer.relight([replace(light, position=(0.1, 0.2, 0.3)) for light in scene.lights])
        assert not gatherer.refine_surface(shadows, Budget(None))  # it is made anew first


def test_a_surface_cache_of_as_many_sites_as_may_be_gets_more_at_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Large scenes have that many from the start: cells are cut all the same where light changes, and no value is lost."""
    for module in (site_layout, lookup_table):
        monkeypatch.setattr(module, "MAX_SITES", 100)
    with Renderer(irrsplat.load(write_room(tmp_path)), SIZE, **(COARSE | {"bounces": 2})) as renderer:
        view, _ = renderer.frame()
        gatherer, shadows = renderer.scheduler.gatherer, renderer.draw_shadows()
        surface = gatherer.surface_now
        assert surface is not None and 40 < len(surface.sites) <= 100 and surface.may_split
        before, sites = pixels(surface.view(view.gbuffer))[..., :3].mean(), surface.sites
        for _ in range(3):
            assert gatherer.refine_surface(shadows, Budget(None))
        assert len(surface.sites) > 120 and np.array_equal(surface.sites.position[: len(sites)], sites.position)
        after = pixels(surface.view(view.gbuffer))[..., :3]
        assert after.mean() == pytest.approx(before, rel=0.2) and (after.max(-1) > 0.0).mean() > 0.99
        assert surface.result is not None and np.isfinite(surface.result.irradiance).all()


def test_a_later_view_knows_what_the_surface_cache_lacks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It begins with what the view before has found out, and refines no sites that are fine enough."""
    monkeypatch.setattr(site_layout, "POINTS", (100, 100))
    scene = irrsplat.load(write_room(tmp_path))
    camera = scene.camera()
    other = replace(camera, fov=0.9 * camera.fov)
    with Renderer(scene, SIZE, **(COARSE | {"bounces": 2})) as renderer:
        for seen in (camera, other):
            renderer.converge(seen)
            while not (progress := renderer.refine(seen, 0.03, seconds=0.2)[1]).refined:
                pass
            refinement, surface = renderer._frames.resting._refinement, renderer.scheduler.gatherer.surface_now
            assert refinement is not None and surface is not None and progress.error is not None
            rays, between = refinement.lacking
            if seen is camera:
                known, count = (rays, between), surface.refinements
                assert count >= 2 and rays > 0.0 and between is not None
        assert surface is not None and rays == known[0] and (surface.refinements > count or between == known[1])
        renderer.converge(camera)
        renderer.refine(camera, 0.03, seconds=1e-4)
        refinement = renderer._frames.resting._refinement
        assert refinement is not None and refinement.lit and refinement.lacking == (rays, between)


def test_records_are_corrected_by_what_a_refined_surface_cache_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They come to what gathering them again by the refined cache says, but for a tenth of the change; and that is told."""
    monkeypatch.setattr(site_layout, "POINTS", (100, 100))
    settings: SettingValues = COARSE | {"bounces": 3, "gather_size": 32, "ray_noise": 0.0}
    with Renderer(irrsplat.load(write_room(tmp_path)), SIZE, **settings) as renderer:
        renderer.render()
        gatherer, cache, shadows = renderer.scheduler.gatherer, renderer.scheduler.cache, renderer.draw_shadows()
        before, numbers = cache.values[: cache.count, :3].astype(float), np.arange(cache.count)
        for _ in range(2):
            assert gatherer.refine_surface(shadows, Budget(None))
            last = cache.values[: cache.count, :3].astype(float)
            changes = gatherer.follow_refinement(shadows, numbers, Budget(None))
            assert np.allclose(cache.values[: cache.count, :3], last + changes, atol=1e-6)
        corrected = cache.values[: cache.count, :3].astype(float)
        gatherer.regather(shadows, numbers, Budget(None), 32)
        again = cache.values[: cache.count, :3].astype(float)
        assert np.abs(again - before).mean() > 1e-3 * before.mean()
        assert np.sqrt(np.mean((corrected - again) ** 2)) < 0.1 * np.sqrt(np.mean((again - before) ** 2))
