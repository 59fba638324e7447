"""The window's size, preferences and events, and its message without a display."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from irrsplat.app.viewer.window import Desktop
from irrsplat.renderer import frames
from tests.support.viewing import SIZE, Driver


def test_another_size_keeps_the_records(driver: Driver) -> None:
    """The view follows the window down to one pixel; the first size gives the first picture again. Both sides are resized."""
    before, count = driver.canvas(), driver.session.renderers[0].cache.count
    for size in ((200, 260), (1, 1)):
        driver.resize(size)
        driver.settle()
        assert driver.session.size == driver.viewer.canvas.size == size
        assert driver.window().shape == (size[1], size[0], 3)
    driver.resize((0, 0))
    driver.frame(3)
    assert driver.session.size == (1, 1), "nothing is drawn"
    driver.resize(SIZE)
    driver.settle()
    assert driver.session.renderers[0].cache.count >= count
    assert np.abs(driver.canvas().astype(float) - before).mean() < 3.0
    driver.session.options.frozen = True
    driver.session.split(True)
    driver.resize((100, 80))
    driver.frame(2)
    driver.session.split(False)
    driver.resize((120, 90))
    driver.frame(2)
    driver.session.split(True)
    driver.frame(2)
    assert {r.size for r in driver.session.renderers} == {(120, 90)}


def test_a_new_size_shows_before_its_first_light(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """Input ends the wait for the light of a new scene. The next frame has the new size, and a later one the light."""
    driver.session.change(0, bounces="all", gather="auto")
    with monkeypatch.context() as patch:
        patch.setattr(driver.viewer.desktop, "waits", lambda flowing: True)
        driver.actions.open(driver.actions.source)
        driver.frame()
    gatherer = driver.session.renderers[0].scheduler.gatherer
    driver.resize((120, 90))
    driver.frame()
    assert driver.session.views[0].image.size == (120, 90) and gatherer.awaits_light
    driver.settle()
    assert not gatherer.awaits_light


def test_the_window_enlarges_a_moving_view_but_no_marks(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """A moving view has half the resolution and is enlarged; marks have the window's resolution.

    An enlarged picture is soft at edges, 3 of 255 in the mean; a wrongly shifted or scaled picture differs by tens.
    """
    monkeypatch.setattr(frames, "divisor_after", lambda *_: 2)
    before, canvas, half = driver.window(), driver.canvas(), (SIZE[0] // 2, SIZE[1] // 2)
    driver.down("D")
    driver.frame(3, dt=1e-4)
    assert driver.session.views[0].image.size == driver.viewer.canvas.size == half
    assert 0.0 < np.abs(driver.window().astype(float) - before).mean() < 8.0
    driver.session.options.discs = True
    driver.frame(dt=1e-4)
    assert driver.session.views[0].image.size == half and driver.viewer.canvas.size == SIZE
    driver.up("D")
    driver.session.options.discs = False
    driver.settle()
    assert driver.viewer.canvas.size == SIZE and np.abs(driver.canvas().astype(float) - canvas).mean() < 1.0


def test_without_a_display_one_line_says_what_to_do(tmp_path: Path) -> None:
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR")}
    environment["IRRSPLAT_CONFIG"] = str(tmp_path)
    command = [sys.executable, "-m", "irrsplat", "view"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1)
    assert "irrsplat render" in done.stderr and "xvfb-run" in done.stderr


def test_a_click_waits_for_a_pass_of_the_interface(driver: Driver) -> None:
    """Events of one burst are handled one pass at a time, so that the interface sees each click."""
    desktop, handled = Desktop(driver.wnd), list[str]()
    for kind in ("cursor_pos", "mouse_button", "key", "window_size", "cursor_pos", "scroll"):
        desktop._keeping(kind, lambda *_, kind=kind: handled.append(kind))(None, 0, 0, 0)
    assert desktop.waits(flowing=False) and not handled and [len(desktop.take()) for _ in range(5)] == [1, 1, 1, 1, 2]


def test_a_key_that_is_pressed_in_a_tick_of_flight_moves_its_picture(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """A key during a tick restarts the tick with the key's motion, before any gathering."""
    desktop, session = driver.viewer.desktop, driver.session
    driver.down("W")
    driver.frame(3)
    before, count = session.views[0].camera, session.renderers[0].cache.count
    events = [lambda: driver.down("E")]

    def waits(flowing: bool) -> bool:
        if events and not desktop._events:
            desktop._keeping("key", lambda *_: events.pop()())(None, 0, 0, 0)
            return True
        return False

    monkeypatch.setattr(desktop, "waits", waits)
    driver.frame()
    after = session.views[0].camera
    assert after.eye[1] > before.eye[1] and after == session.camera and session.renderers[0].cache.count == count
    driver.up("E")
    driver.up("W")
