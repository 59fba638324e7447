"""The preset that is not on show: it keeps its records, and what changes meanwhile reaches it when it comes back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irrsplat.renderer import Renderer
from irrsplat.scene.model import Light
from tests.support.viewing import Driver


def test_changes_reach_the_parked_one(driver: Driver) -> None:
    """Size, lights, exposure, headlamp and camera; without a change, the picture that comes back is the same."""
    ours, picture, records = driver.session.renderers[0], driver.canvas(), driver.session.renderers[0].cache.count
    driver.actions.swap_preset()
    driver.session.change(0, gather_size=8, shadow_size=64)
    driver.session.options.frozen = True
    driver.frame()
    assert driver.session.parked is ours and driver.session.renderers[0] is not ours
    driver.actions.swap_preset()
    driver.frame()
    assert driver.session.renderers == [ours] and ours.cache.count == records and np.array_equal(driver.canvas(), picture)
    driver.actions.swap_preset()
    lights = [
        replace(driver.session.scene.lights[0], color=(6.0, 2.0, 2.0)),
        Light((0.0, 0.8, 0.8), (1.0, 1.0, 1.0), physical=True),
    ]
    driver.resize((200, 150))
    driver.session.relight(lights)
    driver.session.carry_headlamp(True)
    driver.session.change(0, exposure=0.5)
    driver.session.free_camera.move(0.3, 0.0, 0.2, 0.1)
    driver.frame()
    driver.actions.swap_preset()
    driver.frame(2)
    assert driver.session.renderers == [ours] and ours.size == (200, 150)
    assert list(ours.scene.lights) == lights and ours.headlamp == driver.session.parked.headlamp > 0.0
    assert ours.settings.exposure == 0.5 and driver.session.views[0].camera == driver.session.camera
    values = {name: getattr(ours.settings, name) for name in driver.values}
    with Renderer(driver.session.scene, (200, 150), ctx=driver.session.ctx, **values) as fresh:
        fresh.carry_headlamp(ours.headlamp)
        view, _ = fresh.frame(driver.session.camera, gather=False)
        known = np.frombuffer(view.direct.read(), "f4")
        assert np.array_equal(known, np.frombuffer(driver.session.views[0].direct.read(), "f4"))
