"""A lamp's intensity, dragged in the viewer: the picture follows, and is settled at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irrsplat.scene.change import SceneChange
from tests.renderer.test_live import dimmed
from tests.support.viewing import Driver


def test_a_dragged_intensity_leaves_nothing_to_gather(driver: Driver) -> None:
    driver.settle()
    session = driver.session
    scene, (renderer,) = session.scene, session.active
    epoch, refreshed = renderer.cache.invalidation_epoch, renderer.cache.read()["irradiance"]
    for factor in (0.8, 0.6, 0.5):
        lights = [dimmed(lamp, factor) for lamp in scene.lights]
        assert SceneChange.between(session.scene, replace(scene, lights=tuple(lights))).dimming is not None
        session.relight(lights)
        driver.frame()
        assert session.progress[0].stale == 0 and session.progress[0].renewed == 0
    assert renderer.cache.invalidation_epoch == epoch
    now = renderer.cache.read()["irradiance"][: len(refreshed)]
    assert np.allclose(now, 0.5 * refreshed[: len(now)], rtol=1e-4, atol=1e-6)
    driver.settle()
    assert session.at_rest
    session.relight(scene.lights)
    driver.settle()
