"""Measures the time from a key or a click to the frame that shows it, in a real window on a virtual display.

`python docs/programs/viewer/latency.py [SCENE] [--count N] [--busy N] [--size W H]` (door, 20, 0, 1000 640) sends X events
(XTEST). It does so while the view fills, in flight, while the picture is refined, and at rest. `--busy` further processes
compute. A table has median and worst time in ms, and the parts of the slowest frame. Needs Xvfb, libX11 and libXtst.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

from events import ROOT, Hand, x_drop

FIRST, PATIENCE, PAUSE = 60.0, 5.0, 0.35  # seconds: until the first frame; until an event counts as lost; between two events
NOISE = 1e-6  # metres
BUSY = "while True: pass"
LAUNCHER = """
import json, os, sys, time
from moderngl_window.context.glfw.window import Window
from irrsplat.app.viewer import viewer as module
from irrsplat.app.viewer.viewer import Viewer
from irrsplat.app.cli import main
out, parts, made = int(sys.argv.pop(1)), {}, []
def timed(owner, name):
    whole = getattr(owner, name)
    def call(self, *args, **options):
        start = time.monotonic()
        try:
            return whole(self, *args, **options)
        finally:
            parts[name] = parts.get(name, 0.0) + 1e3 * (time.monotonic() - start)
    setattr(owner, name, call)
for name in ("_take_events", "_tick", "_present"):
    timed(Viewer, name)
timed(module.Display, "update")
timed(Window, "swap_buffers")
begun, frame, swap = Viewer.__init__, Viewer.frame, Window.swap_buffers
Viewer.__init__ = lambda self, *args, **options: (made.append(self), begun(self, *args, **options))[1]
def swapped(self):
    swap(self)
    if made and made[0].session.progress:
        session, actions = made[0].session, made[0].actions
        rest, filled = session.at_rest, all(p.coverage == 1.0 and p.surface == 1.0 for p in session.progress)
        shown = {"discs": session.options.discs, "lights": actions.session.options.lights}
        camera = session.views[0].camera
        shown["aside"] = float(camera.axes[0] @ camera.eye)  # which flight ahead does not change
        state = "rest" if rest else "refining" if filled else "filling"
        line = json.dumps({"t": time.monotonic(), "state": state, "parts": parts, **shown})
        os.write(out, (line + "\\n").encode())
    parts.clear()
Window.swap_buffers = swapped
sys.exit(main(sys.argv[1:]))
"""
Frame = dict[str, Any]


class Run:
    """One run of the viewer. last: the last frame; slowest: by the state, the longest time and its frame."""

    def __init__(self, folder: str, scene: str, size: list[str], flags: list[str]) -> None:
        self.reader, writer = os.pipe()
        os.set_blocking(self.reader, False)
        command = [sys.executable, "-c", LAUNCHER, str(writer), "view", scene, "--size", *size, *flags]
        known = {**os.environ, "IRRSPLAT_CONFIG": folder, "PYTHONPATH": str(ROOT)}
        self.process = subprocess.Popen(command, cwd=folder, env=known, stderr=subprocess.DEVNULL, pass_fds=[writer])
        os.close(writer)
        self.rest, self.last, self.hand = b"", Frame(), Hand()
        self.times: dict[str, list[float]] = {}
        self.slowest: dict[str, tuple[float, Frame]] = {}

    def until(self, true: Callable[[Frame], object], seconds: float) -> Frame:
        """Return the first frame from now on for which something is `true`, or {} after so many seconds."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            assert self.process.poll() is None, "the viewer has ended"
            try:
                *lines, self.rest = (self.rest + os.read(self.reader, 1 << 20)).split(b"\n")
            except BlockingIOError:
                time.sleep(0.001)
                continue
            for line in lines:
                self.last = json.loads(line)
                if true(self.last):
                    return self.last
        return {}

    def measure(self, name: str, send: Callable[[], None], shows: Callable[[Frame, Frame], object], state: str = "") -> None:
        """Send an event and note the time until a frame shows it. state: of the view meanwhile; "": its own."""
        self.until(lambda frame: False, PAUSE)
        before, start = self.last, time.monotonic()
        send()
        frame = self.until(lambda frame: shows(before, frame), PATIENCE)
        key = f"{state or before['state']}: {name}"
        ms = 1e3 * ((frame["t"] if frame else time.monotonic()) - start)
        self.times.setdefault(key, []).append(ms)
        if ms > self.slowest.get(key, (0.0, {}))[0]:
            self.slowest[key] = ms, frame

    def key(self, name: str) -> None:
        """Press a key and release it."""
        for down in (True, False):
            self.hand.key(name, down)

    def click(self, x: int, y: int) -> None:
        """Click at a place of the window."""
        self.hand.send("Motion", -1, x, y)
        for down in (True, False):
            self.hand.send("Button", 1, down)

    def switch(self) -> None:
        """Measure a key and a click at the side panel."""
        self.measure("key", lambda: self.key("x"), lambda a, b: a["discs"] != b["discs"])
        self.measure("click", lambda: self.click(*LINK), lambda a, b: a["lights"] != b["lights"])

    def fly(self, count: int) -> None:
        """Measure flight to the right and to the left while the camera flies ahead and back, without discs."""
        if self.last["discs"]:
            self.key("x")
        for number in range(count):
            along, across = ("w", "d") if number % 2 else ("s", "a")
            self.hand.key(along, True)
            self.measure("key", lambda: self.hand.key(across, True), lambda a, b: abs(b["aside"] - a["aside"]) > NOISE, "flying")  # noqa: B023
            for name in (across, along):
                self.hand.key(name, False)


LINK = 60, 214  # window coordinates of "Lights…" in the side panel


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="door")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--busy", type=int, default=0)
    parser.add_argument("--size", nargs=2, default=["1000", "640"])
    args = parser.parse_args()
    busy = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(args.busy)]
    try:
        with tempfile.TemporaryDirectory() as folder, x_drop.display((int(args.size[0]), int(args.size[1]))):
            run = Run(folder, args.scene, args.size, ["--viewer-quality", "2"])
            assert run.until(lambda frame: True, FIRST), "no frame"
            run.hand.find()
            for _ in range(args.count):
                if run.last["state"] == "filling":
                    run.switch()
            run.fly(args.count)
            run.key("Home")
            for _ in range(args.count):
                if run.last["state"] != "rest":
                    run.switch()
            run.until(lambda frame: frame["state"] == "rest", 10.0 * FIRST)
            for _ in range(args.count):
                run.switch()
            run.process.kill()
            run.process.wait()
            run.hand.close()
    finally:
        for process in busy:
            process.kill()
    load = os.getloadavg()[0]  # of other programs, too
    print(f"{args.scene}, {args.busy} busy processes, {os.cpu_count()} cores, load average {load:.1f}")
    print(f"{'':20}{'events':>8}{'median':>8}{'worst':>8}")
    for key, times in sorted(run.times.items()):
        ms, frame = run.slowest[key]
        parts = ", ".join(f"{name.strip('_')} {part:.0f}" for name, part in frame.get("parts", {}).items() if part >= 1.0)
        print(f"{key:20}{len(times):8}{statistics.median(times):8.0f}{ms:8.0f}   {parts or 'no frame shows it'}")


if __name__ == "__main__":
    main()
