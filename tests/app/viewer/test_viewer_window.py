"""The keys of the window itself, its size and its end; what it remembers, and what it says without a display."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from irrsplat.app.viewer import preferences
from irrsplat.app.viewer.viewer import Viewer, announce
from irrsplat.app.viewer.window import open_window
from irrsplat.core.buffers import CHANNELS
from irrsplat.scene.model import Scene
from tests.support.viewing import FAST, SIZE, Cases, Driver, push, viewing, write_room

CASES = Cases("window")
case = CASES.case


def test_every_key_has_its_case() -> None:
    CASES.check()


@pytest.mark.parametrize("shown", CASES.keys)
def test_a_key_does_what_it_says(driver: Driver, shown: str) -> None:
    CASES.run(driver, shown)


def covered(driver: Driver) -> float:
    """The share of the window's pixels that the interface changes."""
    return float((driver.window() != driver.canvas()).any(-1).mean())


@case("F1", "F3", "F4", "F6")
def panel(driver: Driver, shown: str) -> None:
    """It covers more of the picture, which stays what it is below; and goes again."""
    driver.frame(4)
    canvas, before = driver.canvas(), covered(driver)
    push(driver, shown)
    driver.frame(4)
    assert covered(driver) > before + 0.05 and np.array_equal(driver.canvas(), canvas) and driver.session.ms == {}
    push(driver, shown)
    driver.frame(4)  # the legend has a line more while the mouse is not on the panel
    assert covered(driver) == pytest.approx(before, abs=0.01)


@case("F2")
def hide(driver: Driver, shown: str) -> None:
    """Not a pixel of it is left; but errors show all the same."""
    driver.actions.panels.settings = driver.actions.panels.hud = True
    driver.frame(2)
    assert covered(driver) > 0.3
    push(driver, shown)
    assert covered(driver) == 0.0
    driver.actions.say("something is wrong", error=True)
    driver.frame(3)
    assert covered(driver) > 0.01
    driver.actions.messages.lines.clear()
    push(driver, shown)
    assert covered(driver) > 0.1


@case("F5")
def reload(driver: Driver, shown: str) -> None:
    """Everything is made anew from the files, which say what they said: the picture is the same in the end."""
    driver.session.free_camera.change_speed(3.0)
    before, speed, old = driver.canvas().astype(float), driver.session.free_camera.speed, driver.session.renderers[0]
    push(driver, shown)
    assert "read again" in driver.said and driver.session.renderers[0] is not old and driver.session.free_camera.speed == speed
    driver.settle()
    assert np.abs(driver.canvas() - before).mean() < 2.0


@case("F11")
def fullscreen(driver: Driver, shown: str) -> None:
    for wanted in (True, False):
        push(driver, shown)
        driver.frame()
        assert driver.wnd.fullscreen is wanted


@case("F12", "Ctrl+F12")
def screenshot(driver: Driver, shown: str) -> None:
    """The PNG is the window with its interface, or the picture below it, to the pixel; the EXR has every buffer."""
    driver.actions.panels.settings = True
    driver.frame(3)
    push(driver, shown)
    (file,) = Path().glob("irrsplat-room-*.png")
    picture = np.asarray(Image.open(file).convert("RGB"))
    assert np.array_equal(picture, driver.window() if shown == "F12" else driver.canvas())
    assert covered(driver) > 0.3 and str(file) in driver.said
    with OpenEXR.File(str(file.with_suffix(".exr")), separate_channels=True) as exr:
        channels = exr.channels()
        assert {name.split(".")[0] for name in channels} == set(CHANNELS)
        seen = driver.display.buffer_view.value("irradiance", driver.session.source(0), 100, 60)
        assert seen is not None and channels["irradiance.G"].pixels[60, 100] == pytest.approx(seen[1], rel=1e-5)
    push(driver, shown)
    assert len(list(Path().glob("irrsplat-room-*.png"))) == 2, "the first one is not written over"


@case("Ctrl+O")
def open_dialog(driver: Driver, shown: str) -> None:
    """What is typed goes into the dialog and nowhere else, keys that fly and keys that show among it; Esc closes it."""
    canvas = driver.canvas()
    driver.down("W")
    push(driver, shown)
    here = driver.session.camera
    driver.frame(3)
    for letter in "WASDEQZXF":
        driver.press(letter)
    driver.type("wasd")
    assert driver.session.camera == here and driver.viewer.controls.pressed == set(), "W is held no longer"
    assert (
        driver.viewer.interface.dialog.typed == "wasd" and not driver.session.options.points and not driver.session.options.frozen
    )
    push(driver, "Esc")
    driver.frame(5)
    assert not driver.actions.panels.open and driver.session.camera == here
    driver.up("W")
    driver.session.free_camera.home()
    driver.settle()
    assert np.array_equal(driver.canvas(), canvas)
    driver.viewer.interface.dialog.typed = ""


@case("Ctrl+Q")
def quits(driver: Driver, shown: str) -> None:
    """While one flies slowly, Ctrl and Q lead down; else they quit."""
    driver.down("LEFT_CTRL")
    driver.down("W")
    driver.down("Q")
    driver.up("W")
    driver.frame(4)
    driver.up("Q")
    driver.up("LEFT_CTRL")
    assert not driver.wnd.is_closing and driver.session.camera.eye[1] < -0.01
    driver.session.free_camera.home()
    push(driver, shown)
    assert driver.wnd.is_closing
    driver.wnd.is_closing = False


@case("Esc")
def escape(driver: Driver, shown: str) -> None:
    """It lets go of everything, and never quits."""
    actions = driver.actions
    actions.record()
    driver.frame(10)
    actions.record()
    actions.play()
    driver.move(200, 120)
    driver.button(True, 2)
    assert driver.viewer.controls.looking and driver.wnd.mouse_exclusivity
    driver.session.held, actions.panels.help = (0, 3), True
    actions.play()
    push(driver, shown)
    assert not driver.viewer.controls.looking and not driver.wnd.mouse_exclusivity
    assert not actions.panels.help and driver.session.held is None
    assert driver.session.path_recorder.playing is None
    driver.button(False, 2)
    for _ in range(3):
        push(driver, shown)
    assert not driver.wnd.is_closing and not actions.quitting


def test_reset_leaves_the_shared_viewer_as_new(driver: Driver, tmp_path: Path) -> None:
    """Whatever a test has done: so that the next one does not depend on it."""

    def state() -> tuple[object, ...]:
        actions, session = driver.actions, driver.session
        shown = asdict(session.options), asdict(actions.panels), session.camera, session.free_camera.speed, session.scene.lights
        rest = [m.text for m in actions.messages.lines], actions.bookmarks, actions.source, driver.wnd.buffer_size, session.held
        return (*shown, *rest, [r.settings for r in session.renderers], driver.viewer.controls.pressed, actions.side)

    before, picture = state(), driver.canvas()
    for shown in ("F3", "X", "I", "B", "2", "M", "R"):
        push(driver, shown)
    driver.actions.open(str(write_room(tmp_path)))
    driver.session.options.frozen = True
    driver.session.split("presets")
    driver.actions.side = 1
    driver.actions.editor.set_lamp(0, replace(driver.actions.editor.lamps[0], stops=-2.0))
    driver.session.free_camera.change_speed(3.0)
    driver.down("LEFT_SHIFT")
    driver.down("W")
    driver.resize((200, 100))
    driver.actions.say("wrong", error=True)
    driver.frame(3)
    driver.reset()
    assert state() == before
    assert np.abs(driver.canvas().astype(float) - picture).mean() < 2.0


# ---- size ----------------------------------------------------------------------------------------------------------------


def test_another_size_keeps_the_records(driver: Driver) -> None:
    """Down to a single pixel, and nothing at all while minimised; then the first picture comes back."""
    before, count = driver.canvas(), driver.session.renderers[0].cache.count
    for size in ((200, 260), (1, 1), (640, 100)):
        driver.resize(size)
        driver.settle()
        assert driver.session.size == driver.viewer.canvas.size == size
        assert driver.window().shape == (size[1], size[0], 3)
    driver.resize((0, 0))
    driver.frame(3)
    assert driver.session.size == (640, 100), "nothing is drawn"
    driver.resize(SIZE)
    driver.settle()
    assert driver.session.renderers[0].cache.count >= count
    assert np.abs(driver.canvas().astype(float) - before).mean() < 3.0


def test_two_presets_are_resized_both(driver: Driver) -> None:
    driver.split_presets()
    driver.resize((100, 80))
    driver.frame(2)
    driver.session.split("off")
    driver.resize((120, 90))
    driver.settle()
    driver.session.split("presets")
    driver.settle()
    assert {r.size for r in driver.session.renderers} == {(120, 90)}
    driver.resize(SIZE)


# ---- the end -------------------------------------------------------------------------------------------------------------


def test_preferences_are_restored_in_the_next_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Settings, overlays, panels, size and the scene are remembered by closing; a damaged file is told and does no harm."""
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path / "config"))
    room = write_room(tmp_path)
    with viewing(room) as driver:
        driver.session.change(0, a=0.7, tolerance=3.0)
        for shown in ("X", "F3"):
            push(driver, shown)
        driver.resize((260, 200))
        driver.frame()
        assert driver.actions.save_preferences(driver.wnd.size, False) is None
    remembered, notices = preferences.load()
    assert notices == [] and remembered.size == (260, 200) and remembered.recent[0] == str(room)
    with viewing(room, (260, 200), remembered) as driver:
        driver.frame()
        settings = driver.session.settings(0)[1]
        assert (settings.a, settings.tolerance, settings.gather_size) == (0.7, 3.0, FAST["gather_size"])
        assert driver.session.options.discs and driver.actions.panels.settings and not driver.actions.panels.hud
    (tmp_path / "config" / "viewer.json").write_text("{ not JSON")
    remembered, notices = preferences.load()
    assert len(notices) == 1 and "viewer.json" in notices[0] and remembered == preferences.Preferences()


def test_closing_saves_preferences_and_tells_what_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By default; and what cannot be written is told."""
    kept: list[bool] = []

    def save(one: preferences.Preferences) -> str:
        kept.append(one.fullscreen)
        return "no room left"

    monkeypatch.setattr(preferences, "save", save)
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path))
    close = Viewer.close
    monkeypatch.setattr(Viewer, "close", lambda self, remember=True: said.append(close(self)))
    said: list[str | None] = []
    with viewing(write_room(tmp_path)) as driver:
        driver.actions.fullscreen_wanted = True
        driver.frame()
    assert said == ["no room left"] and kept == [True]


def test_without_a_display_one_line_says_what_to_do(tmp_path: Path) -> None:
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR")}
    environment["IRRSPLAT_CONFIG"] = str(tmp_path)
    done = subprocess.run(
        [sys.executable, "-m", "irrsplat", "view"], check=False, capture_output=True, text=True, env=environment
    )
    assert done.returncode == 1 and done.stdout == ""
    assert done.stderr.count("\n") == 1 and "irrsplat render" in done.stderr and "xvfb-run" in done.stderr


def test_on_a_finer_monitor_text_is_larger(driver: Driver) -> None:
    """Twice the scale, twice the height of the menu bar: as many rows again hold nothing of the picture."""

    def bar() -> int:
        driver.frame(4)
        return int((driver.window() != driver.canvas()).any(-1)[:, 240:].mean(1).cumprod().round().sum())

    plain = bar()
    driver.viewer.controls.scale_changed(2.0)
    assert bar() == pytest.approx(2 * plain, abs=2) and plain > 10
    driver.viewer.controls.scale_changed(1.0)
    assert bar() == plain


def test_what_the_window_waits_for_is_shown_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A line of text in the middle, on a grey."""
    wnd = open_window((320, 200), headless=True)
    shown: list[np.ndarray] = []
    monkeypatch.setattr(wnd, "swap_buffers", lambda: shown.append(np.frombuffer(wnd.fbo.read(), "u1").reshape(200, 320, 3)))
    announce(wnd, Scene((), (), (), name="hall"))
    assert wnd.title.startswith("hall") and wnd.ctx.error == "GL_NO_ERROR"
    wnd.ctx.release()
    [picture] = shown
    bright = picture.min(-1) > 150
    assert bright[90:110, 120:200].sum() > 30 and not bright[:80].any()
    assert (picture[:80] == 56).all()
