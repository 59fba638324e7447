"""The first minute: menus, palette, the time that is left, a coverage that is true, and what to do outside of the scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from irrsplat.app.viewer.input.commands import COMMANDS, MENUS
from irrsplat.app.viewer.show.remaining_time import RemainingTime, Work, in_words
from irrsplat.app.viewer.ui.statistics_view import coverage_in_words
from irrsplat.image.view import Progress
from irrsplat.scene.model import Camera
from tests.support.viewing import LEFT, RIGHT, Driver, push


def test_keys_and_clicks_before_the_first_picture_end_nothing(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """A scene is open, and has not been drawn yet: each key does what it says, or says why it cannot."""
    monkeypatch.setattr(type(driver.actions), "trace", lambda self: None)  # takes minutes
    driver.actions.open("furnace")
    assert not driver.session.views
    for key in COMMANDS:
        if key.action not in ("quit", "fullscreen", "light_colours"):
            driver.actions.press(key)
    for button in (LEFT, RIGHT):
        driver.button(True, button)
        driver.button(False, button)
    told = [message.text for _, message in driver.actions.messages.log]
    assert not driver.session.views and "there is no picture of this scene yet" in told


def test_menus_open_the_keys_the_log_and_what_this_is(driver: Driver) -> None:
    """Also where the interface is twice as large as the window is made for: no title is cut off at 640 pixels."""
    driver.resize((640, 400), density=0.25)
    driver.frame(2)
    for menu, item, panel in (("Help", "Keys", "help"), ("Help", "About irrsplat", "about"), ("Window", "Messages", "log")):
        driver.choose(menu, item)
        assert getattr(driver.actions.panels, panel), item
        push(driver, "Esc")
        assert not getattr(driver.actions.panels, panel), item
    driver.actions.enlarge(2.0)
    driver.frame(6)
    assert [w.label for w in driver.widgets if w.kind == "begin_menu" and w.box[2] <= 640] == list(MENUS)


def test_every_action_has_a_method_and_a_name_of_its_own(driver: Driver) -> None:
    """The palette finds an action by its name, so that no two may share one; `enabled` is a property of the actions."""
    names = [(one.menu, one.title) for one in COMMANDS if not (one.action == "redo" and one.shift)]
    assert len(set(names)) == len(names)
    for one in COMMANDS:
        assert callable(getattr(driver.actions, one.action)) and one.menu.split("/")[0] in MENUS
        assert driver.actions.can(one) in (True, False) and driver.actions.is_active(one) in (True, False)


@pytest.mark.parametrize(("typed", "found"), [
    ("wireframe", lambda driver: driver.session.options.wire),
    ("preset preview", lambda driver: driver.session.settings(0)[0] == "preview"),
    ("setting radius max", lambda driver: driver.actions.panels.expert and driver.actions.panels.settings),
    ("open furnace", lambda driver: driver.actions.source == "furnace"),
])  # fmt: skip
def test_the_palette_finds_actions_settings_and_scenes(driver: Driver, typed: str, found: Callable[[Driver], bool]) -> None:
    """Words are typed, and Enter runs the first entry. Esc closes the palette."""
    driver.session.options.frozen = True
    driver.resize((640, 400), density=0.25)
    assert not found(driver)
    push(driver, "Ctrl+P")
    driver.frame(3)
    driver.type(typed)
    driver.press("ENTER")
    driver.frame(2)
    assert found(driver) and not driver.actions.panels.palette
    push(driver, "Ctrl+P")
    push(driver, "Esc")
    assert not driver.actions.panels.palette


@pytest.mark.parametrize(("works", "seconds"), [
    ([Work(0.0, 0.0, 300 - 5 * t, 5 * t) for t in range(21)], 4.0),  # 50 records a second, and 200 left
    ([Work(0.0, 0.75 - t / 80, 100, 2 * t) for t in range(21)], 4.0 + 5.0),  # half of the surface cache, then 100 records
    ([Work(2.0 ** (-t / 10), 0.0, 0, 9 * t) for t in range(21)], math.log2(250.0)),  # halved each second, from 1/4 to 1/1000
    ([Work(0.5, 0.0, 0, 0), Work(0.5, 0.0, 0, 0), Work(0.25, 0.0, 0, 9)], None),  # too short a time
    ([Work(1.0, 0.0, 0, t) for t in range(30)], None),  # no progress
    ([*(Work(0.0, 0.0, 100 - t, t) for t in range(30)), Work(0.0, 0.0, 0, 100)], None),  # done
    ([*(Work(0.0, 0.0, 20 - t, t) for t in range(20)), *[Work(0.0, 0.0, 1, 19)] * 60], None),  # the last one takes longer
])  # fmt: skip
def test_the_rest_takes_as_long_as_the_progress_so_far_says(works: list[Work], seconds: float | None) -> None:
    """Ten measurements a second."""
    remaining = RemainingTime()
    for i, work in enumerate(works):
        remaining.add(i / 10, work)
    assert remaining.seconds == (None if seconds is None else pytest.approx(seconds, rel=1e-6))


def test_times_and_coverage_in_words() -> None:
    """Times are rounded to what people say; a coverage is never 0 nor 100 % where it is not."""
    times = {0.2: "about 1 s", 7.6: "about 8 s", 13.0: "about 15 s", 88.0: "about 90 s", 100.0: "about 2 min"}
    assert {seconds: in_words(seconds) for seconds in times} == times
    progress = Progress(0, 20, 3, 0.0)
    assert coverage_in_words(progress, True) == "first estimate" and coverage_in_words(progress, False) == "first round"
    for coverage, words in ((0.99996, "99.9"), (1.0, "100.0"), (0.437, "43.7")):
        assert coverage_in_words(replace(progress, coverage=coverage), True) == f"coverage {words} %"


def test_outside_of_the_scene_home_is_offered(driver: Driver) -> None:
    """The room is open in front. A camera is lost behind it, far away, or turned away; not in front, nor near a wall."""
    for eye, target, lost in (
        ((0.0, 0.0, 4.0), (0.0, 0.0, 9.0), True),
        ((0.0, 0.0, 2000.0), (0.0, 0.0, 0.0), True),
        ((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), False),
        ((0.0, 0.0, -0.9), (0.0, 0.0, -1.0), False),
        ((0.0, 0.0, -4.0), (0.0, 0.0, 0.0), True),
    ):
        driver.session.free_camera.go(Camera(eye, target))
        driver.frame(2)
        assert driver.display.lost is lost, (eye, target)
    told = driver.window().astype(int)
    assert ((told[..., 0] > 200) & (told[..., 2] < 120)).sum() > 50, "in the colour of what stands out"
    push(driver, "Home")
    assert not driver.display.lost
