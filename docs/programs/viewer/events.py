"""Sends random events to the viewer's window on a virtual display.

`python docs/programs/viewer/events.py [SECONDS] [SEED]` (600, 0) sends keys, clicks, drags, the wheel, dropped files,
sizes and scenes, as an X server hands them out (XTEST, XDND). Each line on stderr, each exit by a fault, and each time of HANG
seconds without a frame after an event is reported, with the last events. Messages in red are counted: most of them answer a
bad file. Needs Xvfb, libX11 and libXtst. Exit status 1: faults were found.
"""

from __future__ import annotations

import ctypes
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter, deque
from ctypes import c_char_p, c_int, c_uint, c_ulong, c_void_p
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tests.app.viewer.interface import x_drop  # noqa: E402

SCREEN = (1200, 800)
HANG, FIRST = 5.0, 60.0  # seconds: without a frame; until the first frame, and until it is given up
LED = 25  # events that are reported with a fault
SCENES = ("cornell", "furnace", "curved", "door")  # the first one is open at the start
FAST = ["--gather-size", "16", "--size", "800", "600"]
KEYS = "minus equal bracketleft bracketright backslash Escape Escape Tab Return BackSpace Delete Home End space Left Up Down"
KEYS = [*KEYS.split(), *"abcdefghijklmnopqrstuvwxyz0123456789", *(f"F{i}" for i in range(1, 13))]
MODIFIERS = {"ctrl": "Control_L", "shift": "Shift_L", "alt": "Alt_L"}
SIZES = ((1, 1), (40, 800), (1200, 40), SCREEN, (640, 480), (333, 777))
TEXTS = ("c o r n e l l", "n a n", "minus 1", "1 e 9 9 9", "0 period 5", "x", "numbersign 8 0 8 0 8 0")
FILES = {"bad.obj": "f 1 2\n", "bad.scene": "cam 1 2\n", "note.txt": "no scene\n", "bad.path": "cam\n", "empty.glb": ""}
SIGNATURES: dict[str, tuple[object, list[object]]] = {  # of Xlib.h: result, arguments
    "XStringToKeysym": (c_ulong, [c_char_p]),
    "XKeysymToKeycode": (c_uint, [c_void_p, c_ulong]),
    "XSetInputFocus": (c_int, [c_void_p, c_ulong, c_int, c_ulong]),
    "XResizeWindow": (c_int, [c_void_p, c_ulong, c_uint, c_uint]),
    "XSync": (c_int, [c_void_p, c_int]),
    "XQueryTree": (c_int, [c_void_p, c_ulong, *[c_void_p] * 4]),
    "XGetWindowAttributes": (c_int, [c_void_p, c_ulong, c_void_p]),
    "XSetErrorHandler": (c_void_p, [c_void_p]),
}
MAP_STATE, VIEWABLE = 23, 2  # Xlib.h: the place of a window's map_state in its attributes, as ints; its value for one on show
LAUNCHER = """
import os, sys
from moderngl_window.context.glfw.window import Window
from irrsplat.app.viewer.messages import Messages
from irrsplat.app.cli import main
swap, say, out = Window.swap_buffers, Messages.say, int(sys.argv.pop(1))
Window.swap_buffers = lambda self: (swap(self), os.write(out, b"frame\\n"))[0]
def heard(self, text, error=False, topic=""):
    if error: os.write(out, (" ".join(str(text).split()) + "\\n").encode())
    return say(self, text, error, topic)
Messages.say = heard
sys.exit(main(sys.argv[1:]))
"""


class Hand(x_drop.DropSource):
    """Mouse, keyboard and drops on the viewer's window."""

    def __init__(self) -> None:
        super().__init__(0)
        for name, (result, arguments) in SIGNATURES.items():
            function = getattr(self.x, name)
            function.restype, function.argtypes = result, arguments
        self.test, self.root = ctypes.CDLL("libXtst.so.6"), self.x.XDefaultRootWindow(self.display)
        for name, kinds in {"Key": [c_uint, c_int], "Button": [c_uint, c_int], "Motion": [c_int, c_int, c_int]}.items():
            getattr(self.test, f"XTestFake{name}Event").argtypes = [c_void_p, *kinds, c_ulong]
        self.ignore = ctypes.CFUNCTYPE(c_int, c_void_p, c_void_p)(lambda display, error: 0)  # a window that has just gone
        self.x.XSetErrorHandler(self.ignore)

    def find(self) -> None:
        """Take the window that is on the display, and give it the focus."""
        found, count, other, values = ctypes.POINTER(c_ulong)(), c_uint(), c_ulong(), (c_int * 64)()
        self.x.XQueryTree(self.display, self.root, *map(ctypes.byref, (other, other, found, count)))
        for window in found[: count.value]:
            if self.x.XGetWindowAttributes(self.display, window, values) and values[MAP_STATE] == VIEWABLE:
                self.target = window
                self.x.XSetInputFocus(self.display, window, 1, 0)
        self.x.XSync(self.display, 0)

    def send(self, kind: str, *values: int) -> None:
        """Send a key (its code, whether it goes down), a button (its number, the same) or a motion (-1, x, y)."""
        getattr(self.test, f"XTestFake{kind}Event")(self.display, *values, 0)
        self.x.XSync(self.display, 0)

    def key(self, name: str, down: bool) -> None:
        """Press or release a key."""
        self.send("Key", self.x.XKeysymToKeycode(self.display, self.x.XStringToKeysym(name.encode())) & 255, down)

    def act(self, dice: random.Random, files: list[Path]) -> str:
        """Send a random event, or a few that belong together. Return what was sent."""
        kind = dice.choices(("key", "click", "drag", "wheel", "drop", "size", "type"), (40, 30, 15, 5, 2, 1, 4))[0]
        x, y = dice.randrange(SCREEN[0]), dice.choice((dice.randrange(30), dice.randrange(SCREEN[1]), dice.randrange(SCREEN[1])))
        self.find()
        if kind == "key":
            chord = (*dice.choice(((), (), (), ("ctrl",), ("shift",), ("alt",), ("ctrl", "shift"))), dice.choice(KEYS))
            for down in (True, False):
                for name in chord:
                    self.key(MODIFIERS.get(name, name), down)
                time.sleep(dice.choice((0.0, 0.0, 0.3)))
            return "+".join(chord)
        if kind == "drop":
            chosen = dice.sample(files, dice.choice((1, 1, 1, 2)))
            return f"drop {[path.name for path in chosen]} {self.drop(chosen, (x, y))}"
        if kind == "size":
            size = dice.choice(SIZES)
            self.x.XResizeWindow(self.display, self.target, *size)
            return f"size {size}"
        if kind == "type":
            text = dice.choice(TEXTS)
            for name in text.split():
                self.key(name, True)
                self.key(name, False)
            return f"type {text}"
        self.send("Motion", -1, x, y)
        button = dice.choice((4, 5)) if kind == "wheel" else dice.choices((1, 2, 3), (8, 1, 2))[0]
        for _ in range(dice.choice((1, 1, 1, 2, 5))):
            self.send("Button", button, True)
            for _ in range(dice.randrange(1, 12) if kind == "drag" else 0):
                x, y = x + dice.randrange(-90, 91), y + dice.randrange(-90, 91)
                self.send("Motion", -1, x, y)
                time.sleep(0.01)
            self.send("Button", button, False)
        return f"{kind} {button} at {x} {y}"


class Run:
    """One run of the viewer. frames: those so far; said: the messages in red."""

    def __init__(self, folder: Path) -> None:
        self.reader, writer = os.pipe()
        os.set_blocking(self.reader, False)
        self.written, self.frames, self.said = folder / "stderr.txt", 0, Counter[str]()
        command = [sys.executable, "-c", LAUNCHER, str(writer), "view", SCENES[0], *FAST]
        known = {**os.environ, "IRRSPLAT_CONFIG": str(folder / "config"), "PYTHONPATH": str(ROOT), "IRRSPLAT_DEBUG": "1"}
        with self.written.open("w") as errors:
            self.process = subprocess.Popen(command, cwd=folder, env=known, stderr=errors, pass_fds=[writer])
        os.close(writer)

    def look(self, after: int = -1, seconds: float = 0.0) -> bool:
        """Wait for a frame after the first `after`. Return True if there is one, or the program has ended."""
        end = time.monotonic() + seconds
        while self.process.poll() is None or seconds == 0.0:
            try:
                lines = os.read(self.reader, 1 << 20).decode(errors="replace").splitlines()
            except BlockingIOError:
                lines = []
            self.frames += lines.count("frame")
            self.said.update(line for line in lines if line != "frame")
            if self.frames > after or time.monotonic() > end:
                return self.frames > after
            time.sleep(0.01)
        return True

    def end(self) -> str:
        """End it. Return what it has written to stderr, but the lines of drivers."""
        self.process.kill()
        self.process.wait()
        self.look()
        os.close(self.reader)
        lines = self.written.read_text(errors="replace").splitlines()
        return "\n".join(line for line in lines if not line.startswith(("MESA:", "glx:", "libEGL")))


def main(seconds: float, seed: int) -> int:
    """Send events for so many seconds. Return the number of faults."""
    dice, faults, waits, said, end = random.Random(seed), 0, [0.0], Counter[str](), time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as name, x_drop.display(SCREEN):
        folder, hand, x_drop.LIMIT = Path(name), Hand(), 30.0
        for file, text in FILES.items():
            (folder / file).write_text(text)
        scenes = [next((ROOT / "scenes").rglob(f"{scene}.scene")) for scene in SCENES]
        files = [*scenes, *scenes, *(folder / file for file in FILES), folder, folder / "missing.obj"]
        while time.monotonic() < end:
            run, events = Run(folder), deque[str](maxlen=LED)
            fault = "" if run.look(1, FIRST) else f"no frame within {FIRST:g} s"
            while not fault and run.process.poll() is None and time.monotonic() < end:
                run.look()
                before, start = run.frames, time.monotonic()
                try:
                    events.append(hand.act(dice, files))
                    for down in (True, False):  # so that a frame comes in any case
                        hand.key("Control_R", down)
                except AssertionError as error:  # no answer to a drop
                    events.append(str(error))
                if not run.look(before, HANG):
                    fault = f"a frame after {HANG:g} s" if run.look(before, FIRST) else f"no frame within {FIRST:g} s"
                waits.append(time.monotonic() - start)
                time.sleep(dice.choice((0.0, 0.02, 0.1, 0.5)))
            time.sleep(0.2)  # a program that ends has a status then
            status, written = run.process.poll(), run.end()
            said += run.said
            if fault or written or status:
                faults += 1
                print(f"-- fault {faults} (status {status}): {fault}\n{written}\n   after: {'; '.join(events)}", flush=True)
        hand.close()
    print(f"{len(waits) - 1} events in {seconds:g} s, seed {seed}: {faults} faults; longest wait for a frame {max(waits):.1f} s")
    print("\n".join(f"   {count} times: {text:.150}" for text, count in said.most_common()))
    return faults


if __name__ == "__main__":
    sys.exit(main(float(sys.argv[1]) if len(sys.argv) > 1 else 600.0, int(sys.argv[2]) if len(sys.argv) > 2 else 0) > 0)
