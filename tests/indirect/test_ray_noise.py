"""Records that serve only what is near do with a quarter of their rays where these tell their light well enough."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

import irrsplat
from irrsplat.core.buffers import HitLight
from irrsplat.core.color import LUMINANCE
from irrsplat.gather.look import gather_records
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.trace import TraceGather
from irrsplat.renderer import Renderer
from irrsplat.settings import SettingValues

SIZE = (96, 72)
RAYS: SettingValues = {"bounces": 1, "gather": "trace", "gather_size": 32, "shadow_size": 256, "viewer_quality": 0.0}


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    with Renderer(irrsplat.load("curved"), SIZE, **RAYS) as made:
        made.render()
        yield made


def few(renderer: Renderer) -> np.ndarray:
    """The numbers of the records that did with 16² rays."""
    return np.flatnonzero(renderer.cache.gather_sizes == 16)


def gather_of(renderer: Renderer, side: int) -> TraceGather:
    """As the renderer's own, along side² rays."""
    return TraceGather(renderer.world, side, light_samples=renderer.settings.light_samples)


def test_the_noise_that_few_rays_tell_is_how_far_off_they_are(renderer: Renderer) -> None:
    cache, ctx = renderer.cache, renderer.ctx
    chosen = np.arange(0, cache.count, max(cache.count // 60, 1))
    light, off = HitLight(renderer.draw_shadows(), None), []
    with ctx, ReducePass(ctx, True) as reduce, gather_of(renderer, 32) as rough, gather_of(renderer, 128) as fine:
        for gather in (rough, fine):
            atlas = gather_records(gather, reduce, light, cache, chosen, 0)
            assert atlas is not None
            cache.mark_refreshed(chosen)  # their values are to be read again
            off.append((cache.values[chosen, :3].astype(float) @ LUMINANCE, reduce.noise(atlas)))
    (E, noise), (truth, _) = off
    error = np.abs(E - truth) / truth
    assert 0.5 * np.median(error) < np.median(noise) < 2.0 * np.median(error)
    order = np.array_split(np.argsort(noise), 3)
    assert np.sqrt(np.mean(error[order[2]] ** 2)) > 2.0 * np.sqrt(np.mean(error[order[0]] ** 2))


def test_only_records_of_the_closest_sites_do_with_few_rays(renderer: Renderer) -> None:
    found = few(renderer)
    assert len(found) > 20
    assert found.min() > 100, "those of the first rounds reach far"


def test_uneven_light_takes_all_rays(renderer: Renderer) -> None:
    """The more noise is let pass, the more records do with few rays; hardly any light is even to a tenth of a percent."""
    counts = []
    for percent in (0.1, 4.0, 100.0):
        with Renderer(renderer.scene, SIZE, **(RAYS | {"ray_noise": percent})) as other:
            other.render()
            counts.append(len(few(other)))
    assert 0 <= counts[0] < 5 < 20 < counts[1] < counts[2]


def test_without_the_setting_all_records_have_all_rays() -> None:
    with Renderer(irrsplat.load("curved"), SIZE, **(RAYS | {"ray_noise": 0.0})) as plain:
        plain.render()
        assert not plain.cache.gather_sizes.any()


def test_a_change_of_light_gathers_them_again_along_as_few_rays(renderer: Renderer) -> None:
    before, lights = few(renderer), renderer.scene.lights
    x, y, z = lights[0].position
    renderer.relight([replace(lights[0], position=(x + 0.05, y, z), color=(3.0, 3.0, 3.0)), *lights[1:]])
    renderer.render()
    after = few(renderer)
    assert len(np.intersect1d(before, after)) > 0.9 * len(before), "other lamps, but about as even"
    renderer.relight(lights)
    renderer.render()


def test_a_view_at_rest_adds_rays_to_those_that_it_shows(renderer: Renderer) -> None:
    camera = renderer.scene.camera()
    with renderer.ctx:  # another test's may be the current one
        served = renderer.scheduler.served(renderer.draw_gbuffer(camera), camera)
    shown = np.intersect1d(few(renderer), np.flatnonzero(served > 0.0))
    assert len(shown)
    renderer.converge()
    for _ in range(400):
        _, progress = renderer.refine(None, 0.001, seconds=10.0)
        if progress.error is not None and not len(np.intersect1d(few(renderer), shown)):
            break
    assert not len(np.intersect1d(few(renderer), shown))
