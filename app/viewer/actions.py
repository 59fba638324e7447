"""All that the viewer's keys and menus do, on a session, with what the user's folder remembers; it knows no window."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

import moderngl
import numpy as np

import irrsplat
from irrsplat.app.viewer import preferences
from irrsplat.app.viewer.file_watch import FileWatch
from irrsplat.app.viewer.input.keys import Key
from irrsplat.app.viewer.session import SPLITS, Session, overrides
from irrsplat.app.viewer.show.legend import SHOWINGS
from irrsplat.core.errors import IrrsplatError
from irrsplat.core.files import write_picture, write_text
from irrsplat.gpu.program import Program
from irrsplat.scene.camera_path import camera_flags, camera_line, load_path, path_text
from irrsplat.scene.model import Camera, Light, Scene

_SHOWN = 4.0  # seconds that a message stays


@dataclass
class Panels:
    """Which windows of the interface are open."""

    settings: bool = True
    lights: bool = False
    hud: bool = True
    help: bool = False
    open: bool = False
    hidden: bool = False


@dataclass(frozen=True)
class Message:
    """A line for the user; `error` ones stay until they are mended or closed, a new one of the same topic takes its place."""

    text: str
    until: float
    error: bool = False
    topic: str = ""


@dataclass
class Lamp:
    """A light of the scene as it is set: `light` at its place in its full colour, brighter by `stops`, or off."""

    light: Light
    stops: float = 0.0
    on: bool = True

    @property
    def shone(self) -> Light:
        """The light that the scene gets."""
        red, green, blue = self.light.color
        gain = 2.0**self.stops if self.on else 0.0
        return replace(self.light, color=(red * gain, green * gain, blue * gain))


class Actions:
    """The viewer without its window. source: what the scene was loaded from. copy: takes text to the clipboard.

    others: further programs that F5 reads again.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        scene: Scene,
        source: str,
        size: tuple[int, int],
        remembered: preferences.Preferences,
        camera: Camera | None = None,
        copy: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.preferences, self.source, self.copy = remembered, source, copy
        self.session = Session(ctx, scene, size, remembered.preset, remembered.values, camera)
        self.others: tuple[Program, ...] = ()
        self.panels = Panels()
        self._restore(remembered.ui)
        self.side = 0  # that keys and panels are about
        self._as_loaded = scene.lights
        self.lamps = [Lamp(light) for light in scene.lights]
        self.lamp = 0  # the one picked from the list
        self.messages: list[Message] = []
        self.shot: Literal["", "whole", "bare"] = ""  # a screenshot that is wanted
        self.quitting = False
        self.wants_fullscreen = remembered.fullscreen
        self.bookmarks = preferences.bookmarks(source)
        self.watch = FileWatch(scene.files)
        remembered.opened(source)

    # ---- messages and memory ---------------------------------------------------------------------------------------

    def say(self, text: object, error: bool = False, topic: str = "") -> None:
        """Show a line for a moment, instead of the last one of its `topic`; an error until it is closed."""
        line = " ".join(str(text).split())
        self.messages = [m for m in self.messages if m.text != line and (not topic or m.topic != topic)][-4:]
        self.messages.append(Message(line, time.monotonic() + _SHOWN, error, topic))

    def tidy(self) -> None:
        """Drop the messages whose time is over."""
        self.messages = [m for m in self.messages if m.error or m.until > time.monotonic()]

    def remember(self, size: tuple[int, int] | None, fullscreen: bool) -> str | None:
        """Keep what is set now for the next time; None, or one line that tells what went wrong."""
        renderer, options = self.session.renderers[0], self.session.options
        self.preferences.size, self.preferences.fullscreen = size or self.preferences.size, fullscreen
        self.preferences.preset, self.preferences.values = renderer.preset, overrides(renderer.preset, renderer.settings)
        kept = {f: getattr(options, f) for f in ("points", "discs", "normals", "by_age", "sites", "wire")}
        panels = {k: v for k, v in asdict(self.panels).items() if k not in ("help", "open", "hidden")}
        self.preferences.ui = {"look": kept, "panels": panels}
        return preferences.save(self.preferences)

    def _restore(self, ui: dict[str, Any]) -> None:
        for name, target in (("look", self.session.options), ("panels", self.panels)):
            values = ui.get(name)
            for one in fields(target):
                value = values.get(one.name) if isinstance(values, dict) else None
                if isinstance(value, bool) and isinstance(getattr(target, one.name), bool):
                    setattr(target, one.name, value)

    # ---- what keys and menus do ------------------------------------------------------------------------------------

    def press(self, key: Key) -> None:
        """Do what a key is for; whatever goes wrong becomes a message."""
        method = getattr(self, key.action)
        self.trying(lambda: method() if key.argument is None else method(key.argument))

    def trying(self, act: Callable[[], object]) -> bool:
        """Do it; whether it went well. What goes wrong becomes a message."""
        try:
            act()
        except (IrrsplatError, OSError) as error:
            self.say(error, error=True)
            return False
        return True

    def show(self, name: str) -> None:
        """Show a buffer on the side at hand."""
        self.session.options.buffers[self.side if self.session.options.split != "off" else 0] = name
        self.say(SHOWINGS[name].title, topic="show")

    def toggle(self, name: str) -> None:
        """Turn an overlay or a panel on or off."""
        target: Any = self.panels if hasattr(self.panels, name) else self.session.options
        setattr(target, name, not getattr(target, name))
        if name == "inspect":
            self.session.held = None

    def home(self) -> None:
        """Back to the first camera."""
        self.stop()
        self.session.free_camera.home()

    def go(self, camera: Camera) -> None:
        """Jump to a camera."""
        self.stop()
        self.session.free_camera.go(camera)

    def copy_line(self) -> None:
        """The camera as a line of a .scene, to the clipboard."""
        self.copy(camera_line(self.session.camera))
        self.say("the camera is in the clipboard, as a line of a .scene")

    def copy_flags(self) -> None:
        """The camera as flags of the command line, to the clipboard."""
        self.copy(camera_flags(self.session.camera))
        self.say("the camera is in the clipboard, as flags of irrsplat render")

    def bookmark(self) -> None:
        """Keep the camera for this scene."""
        taken = {b.name for b in self.bookmarks}
        name = next(n for n in (f"bookmark {i}" for i in range(1, len(taken) + 2)) if n not in taken)
        self._keep([*self.bookmarks, replace(self.session.camera, name=name)], f"{name} is kept")

    def forget(self, bookmark: Camera) -> None:
        """Let go of a bookmark."""
        self._keep([b for b in self.bookmarks if b != bookmark], f"{bookmark.name} is gone")

    def _keep(self, bookmarks: list[Camera], said: str) -> None:
        problem = preferences.set_bookmarks(self.source, bookmarks)
        self.bookmarks = bookmarks
        self.say(problem or said, error=problem is not None)

    def record(self) -> None:
        """Begin to record the flight, or end it and write the path file."""
        path = self.session.path_recorder.record(self.session.camera)
        if path is None:
            self.say("recording the flight; R ends it")
            return
        name = _stamped("flight", self.session.scene.name, ".path")
        write_text(name, path_text(path))
        self.say(f"{name}: {path.frames} frames; P plays it")

    def play(self) -> None:
        """Play the path, or stop it."""
        if self.session.path_recorder.playing is not None:
            self.stop()
        elif self.session.path_recorder.path is None:
            self.say("there is no path yet; R records one, and a .path dropped here is opened")
        else:
            self.session.path_recorder.play()

    def stop(self) -> None:
        """Stop playing; the flight goes on from there."""
        camera = self.session.path_recorder.stop()
        if camera is not None:
            self.session.free_camera.go(camera)

    def escape(self) -> None:
        """Stop playing, let go of a record, close the sheet."""
        self.stop()
        self.session.held = None
        self.panels.help = self.panels.open = False

    def step(self) -> None:
        """Freeze, and gather one round."""
        self.session.step()

    def clear(self) -> None:
        """Forget all records."""
        self.session.clear()

    def split(self) -> None:
        """The next way to split the view."""
        way = SPLITS[(SPLITS.index(self.session.options.split) + 1) % len(SPLITS)]
        self.session.split(way)
        self.say({"off": "one picture", "buffers": "two buffers", "presets": "two presets"}[way], topic="split")

    def swap_preset(self) -> None:
        """Between the paper's algorithm and ours, on the side at hand."""
        name = "default" if self.session.settings(self.side)[0] == "paper" else "paper"
        self.session.use(self.side, name)
        self.say(f"preset {name}", topic="preset")

    def trace(self) -> None:
        """Trace the truth of the view in the background, or stop that."""
        on = self.session
        self.say(on.truths.toggle(on.scene, on.camera, on.size, on.settings(self.side)[1].bounces), topic="truth")

    def darker(self) -> None:
        """Half a stop less."""
        self._expose(-0.5)

    def brighter(self) -> None:
        """Half a stop more."""
        self._expose(0.5)

    def _expose(self, step: float) -> None:
        now = self.session.exposure if np.isfinite(self.session.exposure) else 0.0
        self.session.change(self.side, exposure=float(np.clip(round(2.0 * (now + step)) / 2.0, -64.0, 64.0)))
        self.say(f"exposure {self.session.settings(self.side)[1].exposure:+.1f} stops", topic="exposure")

    def auto_exposure(self) -> None:
        """The exposure follows the picture."""
        self.session.change(self.side, exposure="auto")
        self.say("exposure auto", topic="exposure")

    def fullscreen(self) -> None:
        """Fullscreen or not."""
        self.wants_fullscreen = not self.wants_fullscreen

    def screenshot(self) -> None:
        """The window as it is, and every buffer."""
        self.shot = "whole"

    def screenshot_bare(self) -> None:
        """The picture without the interface, and every buffer."""
        self.shot = "bare"

    def open_dialog(self) -> None:
        """Ask for a scene."""
        self.panels.open = True

    def quit(self) -> None:
        """Close the window."""
        self.quitting = True

    # ---- scenes, lights, pictures ----------------------------------------------------------------------------------

    def open(self, source: str) -> None:
        """Show the scene at a path, or play the .path there."""
        if Path(source).suffix == ".path":
            self.session.path_recorder.path = load_path(source, self.session.camera.fov)
            self.session.path_recorder.play()
            return
        self._load(source, keep_camera=False)
        self.source, self.bookmarks = source, preferences.bookmarks(source)
        self.preferences.opened(source)
        self.panels.open = False

    def _load(self, source: str, keep_camera: bool) -> None:
        scene = irrsplat.load(source)
        self.session.open(scene, keep_camera)
        self._as_loaded, self.watch = scene.lights, FileWatch(scene.files)
        self.lamps, self.lamp = [Lamp(light) for light in scene.lights], 0
        self.messages = [m for m in self.messages if not m.error]
        for notice in scene.notices:
            self.say(notice)

    def reload(self) -> None:
        """Read shaders and scene again; the camera stays. What is wrong is told, and the last good ones go on."""
        self.session.reload_shaders(*self.others)
        self._load(self.source, keep_camera=True)
        self.say("shaders and scene are read again")

    def look_after_files(self) -> None:
        """Load the scene again where one of its files has changed."""
        if self.watch.changed() and self.trying(lambda: self._load(self.source, keep_camera=True)):
            self.say("the scene has changed, and is read again")

    def look_after_truth(self) -> None:
        """Take the truth that was traced meanwhile."""
        self.trying(lambda: self.session.truths.collect(self.session.scene, self.say))

    def loaded(self, number: int) -> Lamp:
        """A lamp as the scene's file has it."""
        return Lamp(self._as_loaded[number])

    def relight(self) -> None:
        """The lamps have changed: records are gathered again in place."""
        self.trying(lambda: self.session.relight([lamp.shone for lamp in self.lamps]))

    def save_shot(self, picture: np.ndarray) -> None:
        """Write the picture (H, W, 3), display values 0..1, as PNG and the left side's buffers as EXR, where the program runs."""
        name = Path(_stamped("irrsplat", self.session.scene.name, ".png"))

        def write() -> None:
            write_picture(name, picture)
            self.session.frame().save(name.with_suffix(".exr"))

        if self.trying(write):
            self.say(f"{name} and .exr are written to {os.getcwd()}")


def _stamped(kind: str, scene: str, ending: str) -> str:
    """A file's name that says what it is of and when; none that is there already."""
    stem = f"{kind}-{scene}-{datetime.now():%Y%m%d-%H%M%S}"
    return next(n for i in range(1000) if not os.path.exists(n := f"{stem}{f'-{i}' if i else ''}{ending}"))
