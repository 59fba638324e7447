"""A real window on a virtual display, driven by xdotool: from the start of `irrsplat view` to a screenshot to its end."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageGrab

TOOLS = ("Xvfb", "xdotool")
MISSING = [tool for tool in TOOLS if shutil.which(tool) is None]
SIZE = (400, 300)
PATIENCE = 180.0  # seconds: machines are slow at times, and nothing here is about speed

pytestmark = pytest.mark.skipif(
    bool(MISSING) and not os.environ.get("CI"), reason=f"{', '.join(MISSING)} missing; run: sh .ci/setup dev"
)


@pytest.fixture
def display(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A virtual display for this test alone."""
    reader, writer = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(writer), "-screen", "0", "1024x768x24", "-nolisten", "tcp"],
        pass_fds=[writer],
        stderr=subprocess.DEVNULL,
    )
    os.close(writer)
    with os.fdopen(reader) as pipe:
        name = f":{pipe.readline().strip()}"
    assert name != ":", "Xvfb did not start"
    monkeypatch.setenv("DISPLAY", name)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    yield name
    server.terminate()
    server.wait()


def hand(*words: object) -> str:
    """Send mouse or keyboard events, then wait a moment, since windows lose events that come too fast."""
    done = subprocess.run(["xdotool", *map(str, words)], capture_output=True, text=True, check=False)
    time.sleep(0.15)
    return done.stdout.strip()


def seen() -> np.ndarray:
    """(H, W, 3) what the display shows where the window is, 0..255."""
    return np.asarray(ImageGrab.grab(xdisplay=os.environ["DISPLAY"]).convert("RGB"))[: SIZE[1], : SIZE[0]].astype(int)


def until(found: Callable[[], Any], what: str) -> Any:
    """What `found` comes to say, once it is true."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if result := found():
            return result
        time.sleep(0.1)
    pytest.fail(f"{what}: not within {PATIENCE:g} s")


def settled() -> np.ndarray:
    """The picture once it stands still."""
    last = [seen()]

    def still() -> bool:
        time.sleep(0.8)  # while a view fills, a picture may stay for 0.3 s and a tick
        last.append(seen())
        return bool((np.abs(last[-1] - last[-2]).max(axis=2) > 8).mean() < 1e-4)

    until(still, "a picture at rest")
    return last[-1]


def differ(one: np.ndarray, other: np.ndarray) -> float:
    """The share of the pixels in which two pictures differ visibly."""
    return float((np.abs(one - other).max(axis=2) > 12).mean())


FAST = ["--gather-size", "8", "--bounces", "1", "--viewer-quality", "0", "--viewer-samples", "0"]


@pytest.mark.slow
def test_from_start_to_screenshot_to_quit(display: str, tmp_path: Path) -> None:
    environment = {**os.environ, "IRRSPLAT_CONFIG": str(tmp_path / "config")}
    words = ["--size", *map(str, SIZE), *FAST]
    command = [sys.executable, "-m", "irrsplat", "view", "cornell", *words]
    viewer = subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        window = until(lambda: hand("search", "--onlyvisible", "--name", "cornell – irrsplat"), "the window").split()[0]
        hand("windowmove", window, 0, 0)
        hand("windowfocus", window)
        hand("mousemove", SIZE[0] // 2, SIZE[1] // 2)
        until(lambda: len(np.unique(seen().reshape(-1, 3), axis=0)) > 1000, "a picture, not a blank")
        whole = seen()

        hand("key", "F2")  # the interface goes, and with it the numbers that never rest
        first = settled()
        assert differ(whole[:20], first[:20]) > 0.3, "the menu bar is gone"

        hand("mousedown", 3)
        for _ in range(4):
            hand("mousemove_relative", 40, 0)
        hand("mouseup", 3)
        turned = settled()
        assert differ(first, turned) > 0.2, "the right mouse looks about"
        hand("keydown", "w")
        until(lambda: differ(turned, seen()) > 0.3, "W flies ahead")  # however few frames a second there are
        hand("keyup", "w")
        nearer = settled()
        assert differ(turned, nearer) > 0.2
        hand("key", "Home")
        assert differ(settled(), first) < 0.02, "Home goes back"

        hand("key", "7")
        normals = settled()
        # the back wall faces the camera: n = (0, 0, -1) is shown as (0.5, 0.5, 0)
        assert np.abs(normals[SIZE[1] // 4, SIZE[0] // 2] - (128, 128, 0)).max() <= 3
        hand("key", "1")
        hand("key", "Escape")
        assert viewer.poll() is None, "Esc never quits"
        before = settled()

        hand("key", "ctrl+F12")
        (picture,) = until(lambda: list(tmp_path.glob("irrsplat-cornell-*.png")), "the screenshot")
        until(lambda: list(tmp_path.glob("irrsplat-cornell-*.exr")), "the buffers")
        shot = np.asarray(Image.open(picture).convert("RGB")).astype(int)
        assert shot.shape == before.shape and differ(shot, before) < 0.001, "the file is what the window showed"

        hand("key", "ctrl+q")
        until(lambda: viewer.poll() is not None, "the end")
        assert viewer.returncode == 0 and viewer.stderr is not None and viewer.stderr.read() == ""
        kept = json.loads((tmp_path / "config" / "viewer.json").read_text(encoding="utf-8"))
        assert kept["size"] == list(SIZE) and len(kept["values"]) == len(FAST) / 2 and kept["values"]["gather_size"] == 8
        assert kept["recent"] == ["cornell"]
        assert not list(tmp_path.glob("*.part*"))
    finally:
        viewer.kill()
        viewer.wait()


def test_ctrl_c_in_the_terminal_closes_it(display: str, tmp_path: Path) -> None:
    environment = {**os.environ, "IRRSPLAT_CONFIG": str(tmp_path / "config")}
    command = [sys.executable, "-m", "irrsplat", "view", "furnace", "--size", "320", "240", "--gather-size", "8"]
    viewer = subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        until(lambda: hand("search", "--onlyvisible", "--name", "furnace – irrsplat"), "the window")
        until(lambda: len(np.unique(seen().reshape(-1, 3), axis=0)) > 100, "a picture, not what announces it")
        viewer.send_signal(signal.SIGINT)
        until(lambda: viewer.poll() is not None, "the end")
        assert viewer.returncode == 130 and viewer.stderr is not None
        told = [line for line in viewer.stderr.read().splitlines() if not line.startswith(("MESA:", "glx:"))]  # drivers may talk
        assert len(told) == 1
        assert (tmp_path / "config" / "viewer.json").is_file(), "and it remembers"
    finally:
        viewer.kill()
        viewer.wait()
