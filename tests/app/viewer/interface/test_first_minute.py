"""The first minute: hints that go, the time that is left, a coverage that is true, and what to do outside of the scene."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from irrsplat.app.common.version import version
from irrsplat.app.viewer.input.hints import HINTS, Hints
from irrsplat.app.viewer.input.keys import KEYS
from irrsplat.app.viewer.preferences import Preferences
from irrsplat.app.viewer.show.remaining_time import RemainingTime, Work, in_words
from irrsplat.app.viewer.show.whereabouts import outside
from irrsplat.app.viewer.ui.statistics_view import coverage_in_words
from irrsplat.app.viewer.ui.windows.about import PAGES
from irrsplat.core import paths
from irrsplat.image.view import Progress
from irrsplat.scene.model import Camera
from tests.support.viewing import LEFT, RIGHT, Driver, push


def test_keys_and_clicks_before_the_first_picture_end_nothing(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """A scene is open, and has not been drawn yet: each key does what it says, or says why it cannot."""
    monkeypatch.setattr(type(driver.actions), "trace", lambda self: None)  # takes minutes
    driver.actions.open("furnace")
    assert not driver.session.views
    for key in KEYS:
        if key.action not in ("quit", "fullscreen"):
            driver.actions.press(key)
    for button in (LEFT, RIGHT):
        driver.button(True, button)
        driver.button(False, button)
    told = [message.text for _, message in driver.actions.messages.log]
    assert not driver.session.views and "there is no picture of this scene yet" in told
    driver.frame(3)
    assert driver.session.views


# ---- hints -------------------------------------------------------------------------------------------------------------


def test_each_hint_goes_once_it_is_followed(driver: Driver) -> None:
    """By the mouse and the keys that it names, not by others; then nothing is left of the line in the window."""
    hints = driver.actions.hints = Hints()
    push(driver, "B")
    driver.click(200, 120)
    push(driver, "Esc")  # and let go of what was picked, whose handles would take the drag
    assert hints.line.count("·") == 2
    driver.frame(3)
    canvas, before = driver.canvas(), driver.window()
    driver.move(200, 120)
    driver.button(True, RIGHT)
    driver.down("W")
    driver.frame(2)
    driver.up("W")
    driver.button(False, RIGHT)
    assert hints.followed == {"fly"} and HINTS["fly"] not in hints.line
    driver.drag((200, 120), (220, 120))
    assert hints.followed == {"fly", "orbit"}
    push(driver, "F1")
    push(driver, "F1")
    assert hints.followed == set(HINTS) and hints.line == ""
    driver.actions.home()
    driver.settle()
    driver.actions.messages.lines.clear()
    driver.frame(3)
    covered = [(picture != one).any(-1)[130:].sum() for picture, one in ((before, canvas), (driver.window(), driver.canvas()))]
    assert covered[0] > covered[1] + 3000, "a line of text less"


@pytest.mark.parametrize("kept", [None, "fly", 7, {"fly": 1}, [["fly"], {}, None], ["walk"]])
def test_what_is_no_hint_is_left_out(kept: object) -> None:
    assert Hints(kept).followed == set()
    assert Hints(["fly", *(kept if isinstance(kept, list) else [])]).followed == {"fly"}


def test_hints_are_remembered(driver: Driver) -> None:
    driver.actions.hints = Hints(["orbit"])
    assert driver.actions.save_preferences(None, False) is None
    assert Hints(driver.actions.preferences.ui["hints"]).followed == {"orbit"}
    assert Hints(Preferences().ui.get("hints")).line.startswith(HINTS["fly"])


# ---- help ----------------------------------------------------------------------------------------------------------------


def test_the_help_menu_has_the_keys_the_pages_and_what_this_is(driver: Driver) -> None:
    driver.resize((640, 400), density=0.25)
    driver.frame(2)
    driver.choose("Help", "all keys")
    assert driver.actions.panels.help
    push(driver, "Esc")
    driver.choose("Help", "reference.md")
    assert driver.viewer.desktop.text == "docs/reference.md"
    driver.choose("Help", "about irrsplat")
    driver.frame(3)
    assert driver.actions.panels.about and version()
    push(driver, "Esc")
    assert not driver.actions.panels.about


def test_the_pages_are_those_of_the_documentation() -> None:
    docs = paths.folder("scenes").parent / "docs"
    assert {page.name for page in docs.glob("*.md")} <= set(PAGES)
    assert all((docs / page).is_file() for page in PAGES)


# ---- the time that is left -----------------------------------------------------------------------------------------------


def estimate(works: list[tuple[float, Work]]) -> float | None:
    remaining = RemainingTime()
    for now, work in works:
        remaining.add(now, work)
    return remaining.seconds


def test_records_that_wait_take_as_long_as_those_before() -> None:
    """Fifty a second and 200 left: 4 s."""
    works = [(t / 10, Work(0.0, 0.0, 300 - 5 * t, 5 * t)) for t in range(21)]
    assert estimate(works) == pytest.approx(4.0, rel=1e-6)


def test_the_surface_cache_and_what_waits_for_it_come_one_after_the_other() -> None:
    """An eighth of the surface cache a second, half of it left, 4 s; then 100 records at 20 a second, 5 s."""
    works = [(t / 10, Work(0.0, 0.75 - t / 80, 100, 2 * t)) for t in range(21)]
    assert estimate(works) == pytest.approx(9.0, rel=1e-6)


def test_the_share_that_asks_falls_as_an_exponential() -> None:
    """It halves each second from 1/4; to a thousandth it takes log₂ 250 = 7.97 s."""
    works = [(t / 10, Work(2.0 ** (-t / 10), 0.0, 0, 9 * t)) for t in range(21)]
    assert estimate(works) == pytest.approx(math.log2(250.0), rel=1e-6)


def test_nothing_is_told_too_early_or_without_progress_or_in_the_end() -> None:
    assert estimate([(0.0, Work(0.5, 0.0, 0, 0)), (0.4, Work(0.25, 0.0, 0, 9))]) is None, "too short a time"
    assert estimate([(t / 10, Work(1.0, 0.0, 0, t)) for t in range(30)]) is None, "nothing is served yet"
    works = [(t / 10, Work(0.0, 0.0, 100 - t, t)) for t in range(30)]
    assert estimate(works) is not None
    assert estimate([*works, (3.0, Work(0.0, 0.0, 0, 100))]) is None, "done"
    assert estimate([*works, (3.0, Work(0.9, 0.0, 0, 100))]) is None, "all anew"


def test_a_share_that_rises_from_nothing_is_no_error() -> None:
    works = [(t / 10, Work(0.0 if t < 10 else 0.01 * t / 10, 0.0, 5, t)) for t in range(30)]
    assert estimate(works) is not None


def test_one_slow_tick_does_not_turn_the_estimate_over() -> None:
    works = [(t / 10, Work(0.0, 0.0, 1000 - 5 * t, 5 * t)) for t in range(41)]
    before = estimate(works)
    after = estimate([*works, (6.0, Work(0.0, 0.0, 799, 201))])
    assert before == pytest.approx(16.0) and after is not None and 10.0 < after < 24.0


@pytest.mark.parametrize(("seconds", "words"), [
    (0.2, "about 1 s"), (7.6, "about 8 s"), (13.0, "about 15 s"), (88.0, "about 90 s"), (100.0, "about 2 min"),
])  # fmt: skip
def test_times_are_told_roughly(seconds: float, words: str) -> None:
    assert in_words(seconds) == words


def test_while_a_view_fills_the_time_left_falls_to_none(driver: Driver) -> None:
    driver.session.change(0, radius_min=0.5, radius_max=4.0, budget=10.0)
    driver.session.clear()
    told = []
    for _ in range(1000):
        driver.frame(dt=0.05)
        told.append(driver.session.remaining.seconds)
        if driver.session.at_rest:
            break
    known = [one for one in told if one is not None]
    assert len(known) > 5 and min(known) < 0.5 * max(known) and told[-1] is None


# ---- coverage ------------------------------------------------------------------------------------------------------------


def test_coverage_is_never_0_nor_100_where_it_is_not() -> None:
    progress = Progress(0, 20, 3, 0.0)
    assert coverage_in_words(progress, True) == "a first guess" and coverage_in_words(progress, False) == "a first round"
    assert coverage_in_words(replace(progress, coverage=0.99996), True) == "coverage 99.9 %"
    assert coverage_in_words(replace(progress, coverage=1.0), True) == "coverage 100.0 %"
    assert coverage_in_words(replace(progress, coverage=0.437), True) == "coverage 43.7 %"


def test_before_the_first_records_a_guess_stands_instead_of_black(driver: Driver) -> None:
    """Where a surface is seen that no light reaches directly, the first picture has light all the same."""
    driver.session.clear()
    driver.session.options.frozen = True
    driver.frame()
    frame = driver.session.frame()
    shadow = np.isfinite(frame.depth) & (frame.direct.sum(-1) == 0.0)
    assert driver.session.renderers[0].cache.count == 0 and shadow.sum() > 100 and (frame.image[shadow].sum(-1) > 0.0).all()


# ---- outside -------------------------------------------------------------------------------------------------------------


def test_outside_of_the_scene_home_is_offered(driver: Driver) -> None:
    """The room is open in front. From behind its walls are seen from their other side; looking away, nothing; from far, less than
    a line. In front, or inside before a wall, one is not lost, nor where the scene's own camera stands."""
    for eye, target, lost in (
        ((0.0, 0.0, -4.0), (0.0, 0.0, 0.0), True),
        ((0.0, 0.0, 4.0), (0.0, 0.0, 9.0), True),
        ((0.0, 0.0, 2000.0), (0.0, 0.0, 0.0), True),
        ((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), False),
        ((0.0, 0.0, -0.9), (0.0, 0.0, -1.0), False),
        ((0.0, 0.0, 0.9), (0.0, 0.0, 9.0), False),
    ):
        driver.session.free_camera.go(Camera(eye, target))
        driver.frame(2)
        assert driver.display.lost is lost, (eye, target)
    driver.session.free_camera.go(Camera((0.0, 0.0, -4.0), (0.0, 0.0, 0.0)))
    driver.frame(3)
    told = driver.window().astype(int)
    assert ((told[..., 0] > 200) & (told[..., 2] < 120)).sum() > 50, "in the colour of what stands out"
    push(driver, "Home")
    assert not driver.display.lost


def test_well_outside_is_a_tenth_of_the_diagonal(driver: Driver) -> None:
    scene = driver.session.scene
    margin = 0.1 * scene.diagonal
    for beyond, is_outside in ((0.9 * margin, False), (1.1 * margin, True)):
        assert outside(Camera((0.0, 1.0 + beyond, 0.0), (0.0, 0.0, -9.0)), scene) is is_outside
