"""A real window on a virtual display, driven by xdotool, from the start of `irrsplat view` to its end."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageGrab

from irrsplat.core import paths
from tests.app.viewer.interface import x_drop

MISSING = [tool for tool in ("Xvfb", "xdotool") if shutil.which(tool) is None]
SIZE = (320, 240)
SAFETY = 180.0  # seconds that a wait may take; it decides no outcome
FAST = ["--gather-size", "8", "--bounces", "1", "--viewer-quality", "0", "--viewer-samples", "0", "--radius-min", "5"]
WALL = (245, 85)  # a pixel of the back wall that no text covers
OUTLINE = (250, 171, 77)  # around a picked object
RED = (191, 51, 38)  # behind errors

pytestmark = pytest.mark.skipif(
    bool(MISSING) and not os.environ.get("CI"), reason=f"{', '.join(MISSING)} missing; run: sh .ci/setup dev"
)


@pytest.fixture
def display(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Provide a virtual display for one test, as large as the window."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.setenv(name, "")  # both are restored
    with x_drop.display(SIZE):
        yield


def hand(*words: object) -> str:
    """Send mouse or keyboard events by xdotool; return its output."""
    return subprocess.run(["xdotool", *map(str, words)], capture_output=True, text=True, check=False).stdout.strip()


def seen() -> np.ndarray:
    """Return the picture on the display, (H, W, 3), 0..255."""
    return np.asarray(ImageGrab.grab(xdisplay=os.environ["DISPLAY"]).convert("RGB")).astype(int)


def until(found: Callable[[], Any], what: str, *words: object) -> Any:
    """Call `found` until its result is true; return the result.

    words: events for `hand` before each call, because a new window may lose an event.
    """
    end = time.monotonic() + SAFETY
    while time.monotonic() < end:
        if words:
            hand(*words)
        if result := found():
            return result
        time.sleep(0.1)
    print(hand("getwindowfocus"), hand("search", "--onlyvisible", "--name", "."), hand("getmouselocation"))
    pytest.fail(f"{what}: not within {SAFETY:g} s")


def differ(one: np.ndarray, other: np.ndarray) -> float:
    """Return the share of pixels with a visible difference between two pictures."""
    return float((np.abs(one - other).max(axis=2) > 12).mean())


def normals_shown() -> bool:
    """True if the back wall has the colour of its normal: (0, 0, -1) is (0.5, 0.5, 0)."""
    return bool(np.abs(seen()[WALL[1], WALL[0]] - (128, 128, 0)).max() <= 3)


def hide_interface() -> None:
    """Hide menus and panels; wait until the menu bar is invisible."""
    bar = seen()[:20]
    hand("key", "F2")
    until(lambda: differ(bar, seen()[:20]) > 0.3, "the menu bar is gone")


@contextmanager
def viewer(folder: Path, *words: str) -> Iterator[subprocess.Popen[str]]:
    """Start the viewer of the Cornell box; yield its process after the first picture."""
    config = folder / "config"
    config.mkdir()
    command = [sys.executable, "-m", "irrsplat", "view", "cornell", "--size", *map(str, SIZE), *FAST, *words]
    environment = {**os.environ, "IRRSPLAT_CONFIG": str(config)}
    environment |= {"XDG_CONFIG_HOME": str(config), "XDG_PICTURES_DIR": str(folder)}
    process = subprocess.Popen(command, cwd=folder, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        # in the locale C, the title that xdotool reads lacks the dash
        window = until(lambda: hand("search", "--onlyvisible", "--name", "cornell .*irrsplat"), "the window").split()[0]
        until(lambda: len(np.unique(seen() @ (1, 256, 65536))) > 1000, "a picture, not what announces it")
        until(lambda: hand("getwindowfocus") == window, "the focus", "windowfocus", window)
        hand("mousemove", *WALL)
        yield process
    finally:
        process.kill()
        process.wait()


def ended(process: subprocess.Popen[str]) -> tuple[int, list[str]]:
    """Return the exit status and the lines on stderr without those of drivers."""
    _, said = process.communicate(timeout=SAFETY)
    return process.returncode, [line for line in said.splitlines() if not line.startswith(("MESA:", "glx:"))]


def test_it_opens_reacts_to_a_key_a_click_and_sizes_and_ends(display: None, tmp_path: Path) -> None:
    with viewer(tmp_path) as process:
        until(normals_shown, "normals", "key", "7")
        window = hand("getwindowfocus")
        until(lambda: not normals_shown(), "a window of one pixel", "windowsize", window, 1, 1)
        until(normals_shown, "the window as before", "windowsize", window, *SIZE)
        hand("click", 1)
        until(lambda: (np.abs(seen().astype(int) - OUTLINE) < 8).all(-1).any(), "an outline")
        until(lambda: process.poll() is not None, "the end", "key", "ctrl+q")
        assert ended(process) == (0, [])
    kept = json.loads((tmp_path / "config" / "viewer.json").read_text(encoding="utf-8"))
    assert kept["size"] == list(SIZE) and kept["recent"] == ["cornell"]


def test_files_are_dropped_on_it(display: None, tmp_path: Path) -> None:
    """The viewer opens the first scene of the dropped files. It refuses a folder, a damaged file and a Latin-1 name."""
    image, bad, latin = tmp_path / "wood.png", tmp_path / "bad.obj", tmp_path / os.fsdecode(b"\xe9.scene")
    latin.touch()
    bad.write_text("f 1 2\n")
    scenes = paths.folder("scenes")
    one, two = next(scenes.rglob("furnace.scene")), next(scenes.rglob("curved.scene"))
    with viewer(tmp_path) as process:
        source = x_drop.DropSource(int(hand("search", "--onlyvisible", "--name", "irrsplat").split()[0]))
        refused = [tmp_path, image], [bad, one], [latin, one]
        for files, title in (([image, one, two], "furnace"), ([two, one], "curved"), *((files, "curved") for files in refused)):
            assert source.drop(files, WALL)
            until(partial(hand, "search", "--onlyvisible", "--name", f"^{title} .*irrsplat"), title)
        until(lambda: (np.abs(seen() - RED).max(-1) < 40).mean() > 0.05, "the errors on red")
        source.close()
        process.terminate()
        assert ended(process) == (0, [])


def test_in_flight_no_shortcut_fires_and_a_screenshot_is_what_the_window_shows(display: None, tmp_path: Path) -> None:
    """While W is held, Ctrl+O and Ctrl+Q have no effect. The view of normals needs no gathering."""
    with viewer(tmp_path) as process:
        until(normals_shown, "normals", "key", "7")
        hide_interface()
        before = seen()
        hand("mousedown", 3)
        until(lambda: differ(before, seen()) > 0.2, "the right mouse button looks about", "mousemove_relative", 20, 0)
        hand("mouseup", 3)
        turned = seen()
        hand("keydown", "w")
        until(lambda: differ(turned, seen()) > 0.02, "W flies ahead")
        hand("key", "ctrl+o", "key", "ctrl+q")
        hand("keyup", "w")
        until(lambda: differ(before, seen()) < 0.001, "Home goes back, and no dialog is open", "key", "Home")
        hand("key", "F12")
        (picture,) = until(lambda: list(tmp_path.glob("irrsplat-cornell-*.png")), "the screenshot")
        assert differ(np.asarray(Image.open(picture).convert("RGB")).astype(int), before) < 0.001
        until(lambda: process.poll() is not None, "the end", "key", "ctrl+q")
        assert ended(process) == (0, []) and not list(tmp_path.glob("*.part*"))
