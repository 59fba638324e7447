"""The preset that is not on show: it keeps its records, and what changes meanwhile reaches it when it comes back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from irrsplat.app.viewer import session as sessions
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Light
from tests.support.viewing import Driver


def to_paper_and_back(driver: Driver) -> Renderer:
    """Our renderer, parked behind the paper's, which is quick and at rest."""
    ours = driver.session.renderers[0]
    driver.actions.swap_preset()
    driver.session.change(0, warmup=20, a=0.8, gather_size=8, shadow_size=64, viewer_samples=0, viewer_quality=0.0)
    driver.settle()
    assert driver.session.parked is ours and driver.session.renderers[0] is not ours
    return ours


def test_both_presets_keep_their_records_and_settings(driver: Driver) -> None:
    ours = to_paper_and_back(driver)
    paper = driver.session.renderers[0]
    count, settings, picture = paper.cache.count, paper.settings, driver.canvas()
    for _ in range(2):
        driver.actions.swap_preset()
        driver.frame()
        assert driver.session.renderers == [ours] and driver.session.parked is paper
        driver.actions.swap_preset()
        driver.frame()
        assert driver.session.renderers == [paper] and (paper.cache.count, paper.settings) == (count, settings)
        assert np.array_equal(driver.canvas(), picture)


def test_changes_reach_the_parked_one(driver: Driver) -> None:
    """Size, lamps, exposure, headlamp and camera: the picture that comes back is that of a session that was never elsewhere."""
    ours = to_paper_and_back(driver)
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
    driver.settle()
    assert driver.session.renderers == [ours] and ours.size == (200, 150)
    assert list(ours.scene.lights) == lights and ours.headlamp == driver.session.parked.headlamp > 0.0  # type: ignore[union-attr]
    assert ours.settings.exposure == 0.5 and driver.session.views[0].camera == driver.session.camera
    values = {name: getattr(ours.settings, name) for name in driver.values}
    with Renderer(driver.session.scene, (200, 150), ctx=driver.session.ctx, **values) as fresh:
        fresh.carry_headlamp(ours.headlamp)
        view, _ = fresh.converge(driver.session.camera)
        known = np.frombuffer(view.direct.read(), "f4")
        assert np.array_equal(known, np.frombuffer(driver.session.views[0].direct.read(), "f4"))


def test_another_scene_drops_it(driver: Driver) -> None:
    to_paper_and_back(driver)
    driver.actions.open("furnace")
    assert driver.session.parked is None
    driver.actions.open(driver.source)


@pytest.mark.parametrize("refused", ["scene", "memory"])
def test_without_room_for_two_the_preset_is_changed_in_place(
    driver: Driver, refused: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise MemoryError

    if refused == "scene":
        monkeypatch.setattr(sessions, "_MOST_PARKED", 1)
    else:
        monkeypatch.setattr(sessions, "Renderer", fail)
    ours = driver.session.renderers[0]
    driver.session.options.frozen = True
    driver.actions.swap_preset()
    driver.frame()
    assert driver.session.renderers == [ours] and driver.session.parked is None and ours.preset == "paper"


def test_a_preset_of_the_menu_begins_with_its_own_settings(driver: Driver) -> None:
    """But with the records that were kept for it, where they hold."""
    ours = to_paper_and_back(driver)
    driver.session.options.frozen = True
    driver.session.use_preset(0, "default")
    assert driver.session.renderers == [ours] and sessions.overrides("default", ours.settings).keys() <= {"exposure", "budget"}
