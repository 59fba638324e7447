"""Each key of the viewer has its documented effect on values or pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from irrsplat.app.viewer.input.commands import GROUPS
from irrsplat.indirect.temporal_filter import PICTURES
from irrsplat.scene.camera_path import load_path
from tests.support.viewing import Cases, Driver, push

pytestmark = pytest.mark.few_sites
BUFFERS_BY_KEY = GROUPS["View/Buffer"]
OTHER = "I", "Y", "F5", "Home", *(f"Ctrl+{key}" for key in ("D", "L", "M", "O", "P", "S", "Shift+S"))  # elsewhere
LISTED = [name for name in GROUPS if name != "Edit"]  # those are in tests/app/editing
CASES = Cases(*LISTED, elsewhere=OTHER)
case = CASES.case


def test_every_key_has_its_case() -> None:
    CASES.check()


@pytest.mark.parametrize("group", LISTED)
def test_a_key_does_its_action(driver: Driver, group: str) -> None:
    """Each key of the group starts from the first camera and has its effect without an error."""
    if group == "View/Camera":
        driver.resize((80, 60))
        driver.settle()
    for key in GROUPS[group]:
        if key.shown in CASES.keys:
            driver.session.options.frozen = group == "View/Camera"  # new views would take a while
            driver.actions.messages.lines.clear()
            CASES.run(driver, key.shown, moving=(key.shown,))
            driver.press("HOME")
            driver.reset() if key.shown in ("Tab", "Space") else driver.settle()


# ---- camera --------------------------------------------------------------------------------------------------------------


@case("R")
def record(driver: Driver, shown: str) -> None:
    """The recorded path follows the flight at 30 frames per second. Quit writes a flight that is still recorded."""
    begin, speed = driver.session.camera, driver.session.free_camera.speed
    push(driver, "R")
    for _ in range(10):
        driver.session.free_camera.move(0.0, 0.0, 1.0, 0.1)
        driver.frame(dt=0.1)
    driver.frame(4, dt=0.1)
    push(driver, "R")
    path = load_path(max(Path().glob("flight-room-*.path")), begin.fov)
    assert path.frames == 1 + 30 * 1.4, "1.45 s are recorded, a key every 0.2 s"
    assert begin.eye[2] - path.camera(24).eye[2] == pytest.approx(0.8 * speed, abs=0.1 * speed), "where it was after 0.8 s"
    push(driver, "R")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("irrsplat.app.viewer.actions._stamped", lambda *_: "no folder/a.path")
        push(driver, "Ctrl+Q")
    assert not driver.wnd.is_closing and "no folder" in driver.said, "the error is shown, and the next Quit quits"
    driver.actions.messages.close_errors()
    push(driver, "R")
    driver.actions.quit()
    driver.actions.quitting = False
    assert len(list(Path().glob("flight-room-*.path"))) == 2 and driver.session.path_recorder.recording is None


# ---- buffers, overlays, cache ----------------------------------------------------------------------------------------------


@case(*(key.shown for key in BUFFERS_BY_KEY))
def show_buffer(driver: Driver, shown: str) -> None:
    """Only the picture changes, without new passes."""
    name = next(str(k.argument) for k in BUFFERS_BY_KEY if k.shown == shown)
    push(driver, "2" if name == "image" else "1")
    canvas = driver.canvas()
    push(driver, shown)
    assert driver.session.options.buffer == name and (driver.canvas() != canvas).any()
    assert driver.session.renderers[0].timers.milliseconds() == {}


def changed(driver: Driver, shown: str) -> float:
    """Return the share of pixels that the key changes; assert that no pass runs and that a second press undoes the change."""
    before = driver.canvas()
    push(driver, shown)
    after = driver.canvas()
    assert driver.session.renderers[0].timers.milliseconds() == {}
    push(driver, shown)
    assert np.array_equal(driver.canvas(), before)
    return float((after != before).any(-1).mean())


@case("X")
def overlay(driver: Driver, shown: str) -> None:
    """An overlay changes a part of the pixels."""
    assert 0.002 < changed(driver, shown) < 1.0


@case("Shift+F")
def freeze(driver: Driver, shown: str) -> None:
    """From another camera, a frozen cache gets no records; after thawing, the view is covered."""
    session, cache = driver.session, driver.session.renderers[0].cache
    count = cache.count
    push(driver, shown)
    session.free_camera.camera = session.scene.camera("corner")
    driver.frame(PICTURES + 5)  # while the picture fades over
    assert cache.count == count and session.progress[0].coverage < 1.0 and session.at_rest
    push(driver, shown)
    driver.settle()
    assert cache.count > count and session.progress[0].coverage == 1.0


# ---- picture -------------------------------------------------------------------------------------------------------------


@case("Tab")
def split(driver: Driver, shown: str) -> None:
    """The left half is unchanged up to the white divider; a second press restores the single picture."""
    before, middle = driver.canvas(), driver.wnd.width // 2
    driver.session.options.frozen = True  # the paper's own settings take a while
    push(driver, shown)
    driver.quicken()
    driver.session.options.frozen = False
    driver.settle()
    picture = driver.canvas()
    assert driver.session.options.split and (picture[:, middle - 1 : middle + 1] == 255).all()
    assert np.array_equal(picture[:, : middle - 1], before[:, : middle - 1])
    assert (picture[:, middle + 1 :] != before[:, middle + 1 :]).any(-1).mean() > 0.2
    push(driver, shown)
    assert not driver.session.options.split and np.array_equal(driver.canvas(), before)


@case("Space")
def flip(driver: Driver, shown: str) -> None:
    """The key alternates between the sides; later keys change the visible side."""
    left = driver.canvas()
    driver.split_presets()
    for side in (1, 0, 1):
        push(driver, shown)
        driver.frame(8, dt=0.1)
        assert np.array_equal(driver.canvas(), left) == (side == 0)
    driver.actions.session.use_preset("preview")
    assert [renderer.preset for renderer in driver.session.renderers] == ["default", "preview"]


# ---- window --------------------------------------------------------------------------------------------------------------


def covered(driver: Driver) -> float:
    """Return the share of the window's pixels that the interface changes."""
    driver.frame(4)
    return float((driver.window() != driver.canvas()).any(-1).mean())


@case("F1")
def keys(driver: Driver, shown: str) -> None:
    """The list of keys covers more of an unchanged picture, and Esc closes it."""
    before = covered(driver)
    push(driver, shown)
    assert covered(driver) > before + 0.05 and driver.session.renderers[0].timers.milliseconds() == {}
    assert any(one.label == "Edit: Undo  (Ctrl+Z)" for one in driver.widgets)
    push(driver, "Esc")
    assert covered(driver) == pytest.approx(before, abs=0.01)


@case("F3", "F4")
def section(driver: Driver, shown: str) -> None:
    """The side panel opens with the section and stays open without it; the picture is fitted into the remaining width."""
    before, options, titles = driver.session.size, driver.session.options, {"F3": "settings", "F4": "lights"}
    driver.session.options.frozen = True
    for titled in (True, False):
        push(driver, shown)
        driver.frame(3)
        assert options.controls and driver.session.size[0] < 0.7 * before[0]
        assert (titles[shown] in driver.viewer.interface.open_titles) == titled
    options.frozen = options.controls = False


@case("F2")
def hide(driver: Driver, shown: str) -> None:
    """No pixel of the interface is visible, except for errors."""
    push(driver, shown)
    driver.actions.messages.lines.clear()
    assert covered(driver) == 0.0
    driver.actions.say("something is wrong", error=True)
    assert covered(driver) > 0.01
    driver.actions.messages.lines.clear()
    push(driver, shown)
    assert covered(driver) > 0.05


@case("F12")
def screenshot(driver: Driver, shown: str) -> None:
    """The PNG in the pictures folder equals the picture exactly."""
    folder = Path("pictures").absolute()
    before = set(folder.glob("irrsplat-room-*.png"))
    push(driver, shown)
    (file,) = set(folder.glob("irrsplat-room-*.png")) - before
    picture = np.asarray(Image.open(file).convert("RGB"))
    assert np.array_equal(picture, driver.canvas()) and str(file) in driver.said


@case("Ctrl+Q")
def quits(driver: Driver, shown: str) -> None:
    push(driver, shown)
    assert driver.wnd.is_closing
    driver.wnd.is_closing = driver.actions.quitting = False


def test_escape(driver: Driver) -> None:
    """Esc releases the mouse, closes a panel and removes errors, and never quits."""
    driver.move(200, 120)
    driver.button(True, 2)
    push(driver, "F1")
    assert driver.wnd.mouse_exclusivity
    driver.actions.say("something is wrong", error=True)
    for _ in range(3):
        push(driver, "Esc")
    assert not driver.said and not driver.wnd.mouse_exclusivity and driver.actions.prompt is None and not driver.wnd.is_closing
    driver.button(False, 2)
