"""Progressive refinement: errors fall, the estimate is reliable, and changes restore the view of the settings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.image.view import Progress
from irrsplat.indirect.paper_scan import read_back
from irrsplat.reference import fine_gather
from irrsplat.renderer import Renderer
from irrsplat.settings import SettingValues
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


@pytest.mark.parametrize("gradients", [False, True])
def test_a_refined_view_comes_near_the_truth_and_tells_how_near(renderer: Renderer, gradients: bool) -> None:
    renderer.change(renderer.settings.with_values({"gradients": gradients, "quality": 0.0}))
    first = renderer.render()
    truth = fine_gather.gather(renderer.world, read_back(renderer.draw_gbuffer(renderer.scene.camera())), 256, count=200)
    before = truth.error(first.irradiance)
    renderer.change(renderer.settings.with_values({"quality": 0.4 * 100.0 * (before or 0.0)}))
    refined = renderer.render()
    after, told = truth.error(refined.irradiance), refined.stats["error"]
    assert first.stats["error"] is None and before and after and told
    assert after < 0.5 * before and told <= 0.4 * before
    assert 1 / 1.5 < told / after < 1.5
    assert refined.stats["records"] > first.stats["records"]


def test_small_ticks_refine_as_a_render_does_and_motion_ends_it(renderer: Renderer) -> None:
    """Frames of a millisecond give the same bits as one call; motion discards the refinement."""
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
        assert renderer.frame()[0] is view  # it stays without motion
    assert np.array_equal(pictures[0], pictures[1])
    renderer.frame("corner")
    renderer.forget()
    assert np.array_equal(renderer.render(renderer.scene.camera()).image, plain.image)


def test_a_view_of_nothing_is_refined_at_once(renderer: Renderer) -> None:
    """Its error is 0, as there is no pixel that could be off."""
    renderer.render()  # so that the cache has records
    away = replace(renderer.scene.camera(), target=(0.0, 0.0, 9.0))
    renderer.frame(away)
    _, progress = renderer.refine(away, 0.01, None)
    assert progress.refined and progress.error == 0.0


@pytest.mark.few_sites
def test_the_surface_cache_is_refined_too(tmp_path: Path) -> None:
    """With three bounces, frames reach the target error; the records follow the refined values. One bounce has none."""
    with Renderer(irrsplat.load(write_room(tmp_path)), (32, 24), **(COARSE | {"bounces": 3})) as renderer:
        first = renderer.render().irradiance
        progress = None
        while progress is None or not progress.refined:
            view, progress = renderer.refine(None, 0.05, 0.05)
        surface = renderer.scheduler.gatherer.surface_now
        assert progress.error is not None and progress.error <= 0.05 and surface is not None and surface.refinements
        off = view.read().irradiance - first
        assert 1e-3 * first.mean() < np.abs(off).mean() < 0.2 * first.mean()
        renderer.change(renderer.settings.with_values({"bounces": 1}))
        renderer.render()
        assert (renderer.refine(None, 0.01)[1].error or 1.0) < 0.01


@pytest.mark.few_sites
def test_records_from_a_file_are_refined_alike(tmp_path: Path) -> None:
    """Refinement makes their surface cache first: it equals that of the records that were saved."""
    scene, path = irrsplat.load(write_room(tmp_path)), tmp_path / "a.cache"
    with Renderer(scene, (32, 24), **(COARSE | {"bounces": 3})) as first:
        first.render()
        first.save_cache(path)
    frames = []
    for loaded in (False, True):
        with Renderer(scene, (32, 24), **(COARSE | {"bounces": 3, "quality": 5.0})) as renderer:
            if loaded:
                renderer.load_cache(path)
            frames.append(renderer.render())
    assert np.array_equal(frames[0].irradiance, frames[1].irradiance)
    assert frames[0].stats["error"] == frames[1].stats["error"]


def test_ctrl_c_ends_a_refinement_with_the_picture_that_there_is(renderer: Renderer) -> None:
    """Each step reports its error, which falls to the quality; after Ctrl-C it is that of the last step."""
    renderer.forget()
    renderer.change(renderer.settings.with_values({"quality": 12.0}))
    told: list[float] = []

    def stop(now: Progress) -> None:
        told.append(now.error or 0.0)
        if now.error is not None and len(told) < 99:
            raise KeyboardInterrupt

    frame = renderer.render(progress=stop)
    assert frame.stats["interrupted"] and not frame.stats["converged"] and frame.stats["error"] == told[-1] > 0.0
    told.extend([0.0] * 99)
    whole = renderer.render(progress=stop)
    assert whole.stats["converged"] and whole.stats["error"] == told[-1] <= 0.12
    assert frame.irradiance.mean() == pytest.approx(whole.irradiance.mean(), rel=0.1)
    renderer.change(renderer.settings.with_values({"quality": 0.0}))
