"""Everything that the viewer's keys and menus do, without knowing a window: a method an action, by the names that keys.py has."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Literal

import numpy as np

import irrsplat
from irrsplat.app.viewer import preferences as stored
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.file_watch import FileWatch
from irrsplat.app.viewer.input.keys import Key
from irrsplat.app.viewer.lamps import Lamps
from irrsplat.app.viewer.messages import Messages
from irrsplat.app.viewer.preferences import Preferences
from irrsplat.app.viewer.session import Session, overrides
from irrsplat.app.viewer.view_options import SPLITS, Panels, restore, saved
from irrsplat.core.files import write_picture, write_text
from irrsplat.core.load_options import LoadOptions
from irrsplat.gpu.program import Program
from irrsplat.scene.camera_path import camera_flags, camera_line, load_path, path_text
from irrsplat.scene.model import Camera

_STOPS = 64.0  # the greatest exposure, up and down


class Actions:
    """What a user does to a session. source: what its scene was loaded from. preferences: how the viewer was left last time.

    copy: takes text to the clipboard. other_programs: what F5 reads again besides the session's shaders. loading: how scenes are
    read, this one again and others.
    """

    def __init__(
        self,
        session: Session,
        source: str,
        preferences: Preferences,
        copy: Callable[[str], None] = lambda text: None,
        other_programs: Callable[[], Iterable[Program]] = lambda: (),
        loading: LoadOptions = LoadOptions(),  # noqa: B008  # it is frozen
    ) -> None:
        self.session, self.source, self.preferences, self.loading = session, source, preferences, loading
        self._copy, self._other_programs = copy, other_programs
        self.panels, self.messages = Panels(), Messages()
        restore(preferences.ui, session.options, self.panels)
        self.side = 0  # that keys and panels change
        self.lamps = Lamps(session.scene)
        self.file_watch = FileWatch(session.scene.files)
        self.bookmarks = stored.bookmarks(source)
        self.screenshot_wanted: Literal["", "window", "bare"] = ""
        self.fullscreen_wanted = preferences.fullscreen
        self.quitting = False
        preferences.opened(source)

    def press(self, key: Key) -> None:
        """Do what a key is for; what goes wrong becomes a message."""
        method = getattr(self, key.action)
        self.attempt(method if key.argument is None else lambda: method(key.argument))

    def say(self, text: object, error: bool = False, topic: str = "") -> None:
        """Show a message."""
        self.messages.say(text, error, topic)

    def attempt(self, act: Callable[[], object]) -> bool:
        """Call `act`; whether it succeeded. What goes wrong becomes a message."""
        return self.messages.attempt(act)

    def save_preferences(self, size: tuple[int, int] | None, fullscreen: bool) -> str | None:
        """Keep what is set now for the next time; None, or one line that tells what went wrong."""
        renderer, preferences = self.session.renderers[0], self.preferences
        preferences.size, preferences.fullscreen = size or preferences.size, fullscreen
        preferences.preset, preferences.values = renderer.preset, overrides(renderer.preset, renderer.settings)
        preferences.ui = saved(self.session.options, self.panels)
        return stored.save(preferences)

    # ---- camera ----------------------------------------------------------------------------------------------------

    def home(self) -> None:
        """Go back to the first camera."""
        self.stop()
        self.session.free_camera.home()

    def headlamp(self) -> None:
        """Switch a lamp at the eye on, or off."""
        self.session.carry_headlamp(not self.session.headlamp)
        self.say("headlamp on: direct light alone, no shadows" if self.session.headlamp else "headlamp off", topic="headlamp")

    def go(self, camera: Camera) -> None:
        """Jump to a camera."""
        self.stop()
        self.session.free_camera.go(camera)

    def copy_line(self) -> None:
        """Copy the camera as a line of a .scene to the clipboard."""
        self._copy(camera_line(self.session.camera))
        self.say("the camera is in the clipboard, as a line of a .scene")

    def copy_flags(self) -> None:
        """Copy the camera as flags of the command line to the clipboard."""
        self._copy(camera_flags(self.session.camera))
        self.say("the camera is in the clipboard, as flags of irrsplat render")

    def bookmark(self) -> None:
        """Keep the camera as a bookmark of this scene."""
        taken = {b.name for b in self.bookmarks}
        name = next(n for n in (f"bookmark {i}" for i in range(1, len(taken) + 2)) if n not in taken)
        self._keep_bookmarks([*self.bookmarks, replace(self.session.camera, name=name)], f"{name} is kept")

    def forget(self, bookmark: Camera) -> None:
        """Delete a bookmark."""
        self._keep_bookmarks([b for b in self.bookmarks if b != bookmark], f"{bookmark.name} is gone")

    def _keep_bookmarks(self, bookmarks: list[Camera], said: str) -> None:
        problem = stored.set_bookmarks(self.source, bookmarks)
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

    # ---- what is shown -----------------------------------------------------------------------------------------------

    def show(self, name: str) -> None:
        """Show a buffer on the side that keys change."""
        options = self.session.options
        options.buffers[self.side if options.split != "off" else 0] = name
        self.say(BUFFERS[name].title, topic="show")

    def is_on(self, name: str) -> bool:
        """Whether the overlay or panel of this name is on."""
        return bool(getattr(self.panels if hasattr(self.panels, name) else self.session.options, name))

    def toggle(self, name: str) -> None:
        """Turn an overlay or a panel on or off."""
        setattr(self.panels if hasattr(self.panels, name) else self.session.options, name, not self.is_on(name))
        if name == "inspect":
            self.session.held = None

    def split(self) -> None:
        """Split the view the next way."""
        ways = list(SPLITS)
        way = ways[(ways.index(self.session.options.split) + 1) % len(ways)]
        self.session.split(way)
        self.say(SPLITS[way], topic="split")

    def swap_preset(self) -> None:
        """Switch between the paper's algorithm and ours, on the side that keys change."""
        name = "default" if self.session.settings(self.side)[0] == "paper" else "paper"
        self.session.use_preset(self.side, name)
        self.say(f"preset {name}", topic="preset")

    def trace(self) -> None:
        """Trace the truth of the view in the background, or stop that."""
        session = self.session
        bounces = session.settings(self.side)[1].bounces
        self.say(session.truths.toggle(session.scene, session.camera, session.size, bounces), topic="truth")

    def collect_truth(self) -> None:
        """Take the truth that was traced meanwhile."""
        self.attempt(lambda: self.session.truths.collect(self.session.scene, self.say))

    def darker(self) -> None:
        """Expose by half a stop less."""
        self._expose(-0.5)

    def brighter(self) -> None:
        """Expose by half a stop more."""
        self._expose(0.5)

    def _expose(self, step: float) -> None:
        now = self.session.exposure if np.isfinite(self.session.exposure) else 0.0
        self.session.change(self.side, exposure=float(np.clip(round(2.0 * (now + step)) / 2.0, -_STOPS, _STOPS)))
        self.say(f"exposure {self.session.settings(self.side)[1].exposure:+.1f} stops", topic="exposure")

    def auto_exposure(self) -> None:
        """Let the exposure follow the picture."""
        self.session.change(self.side, exposure="auto")
        self.say("exposure auto", topic="exposure")

    def step(self) -> None:
        """Freeze the cache, and gather one round."""
        self.session.step()

    def clear(self) -> None:
        """Forget all records."""
        self.session.clear()

    def relight(self) -> None:
        """Light the scene by the lamps as they are set now: records are gathered again in place."""
        self.attempt(lambda: self.session.relight(self.lamps.lights))

    # ---- the window --------------------------------------------------------------------------------------------------

    def escape(self) -> None:
        """Stop playing, let go of a record, close help and dialog."""
        self.stop()
        self.session.held = None
        self.panels.help = self.panels.open = False

    def fullscreen(self) -> None:
        """Switch to fullscreen or back."""
        self.fullscreen_wanted = not self.fullscreen_wanted

    def quit(self) -> None:
        """Close the window."""
        self.quitting = True

    def screenshot(self) -> None:
        """Write the window as it is, and every buffer."""
        self.screenshot_wanted = "window"

    def screenshot_bare(self) -> None:
        """Write the picture without the interface, and every buffer."""
        self.screenshot_wanted = "bare"

    def save_screenshot(self, picture: np.ndarray) -> None:
        """Write the picture (H, W, 3), display values 0..1, as PNG and the left side's buffers as EXR, where the program runs."""
        name = Path(_stamped("irrsplat", self.session.scene.name, ".png"))

        def write() -> None:
            write_picture(name, picture)
            self.session.frame().save(name.with_suffix(".exr"))

        if self.attempt(write):
            self.say(f"{name} and .exr are written to {os.getcwd()}")

    # ---- scenes ------------------------------------------------------------------------------------------------------

    def open_dialog(self) -> None:
        """Ask for a scene."""
        self.panels.open = True

    def open(self, source: str) -> None:
        """Show the scene at a path, or play the .path there."""
        if Path(source).suffix == ".path":
            path = load_path(source, self.session.camera.fov)
            path.motions.check(self.session.scene, path.frames)
            self.session.path_recorder.path = path
            self.session.path_recorder.play()
            return
        self._load(source, keep_camera=False)
        self.source, self.bookmarks = source, stored.bookmarks(source)
        self.preferences.opened(source)
        self.panels.open = False

    def _load(self, source: str, keep_camera: bool) -> None:
        scene = irrsplat.load(source, **vars(self.loading))
        self.session.open(scene, keep_camera)
        self.lamps, self.file_watch = Lamps(scene), FileWatch(scene.files)
        self.messages.close_errors()
        for notice in (*scene.notices, *self.session.renderers[0].notices):
            self.say(notice)

    def reload(self) -> None:
        """Read shaders and scene again; the camera stays. Where one of them is wrong, the last good ones go on."""
        self.session.reload_shaders(*self._other_programs())
        self._load(self.source, keep_camera=True)
        self.say("shaders and scene are read again")

    def reload_changed_files(self) -> None:
        """Load the scene again where one of its files has changed."""
        if self.file_watch.changed() and self.attempt(lambda: self._load(self.source, keep_camera=True)):
            self.say("the scene has changed, and is read again")


def _stamped(kind: str, scene: str, ending: str) -> str:
    """A file's name that says what it is of and when; none that is there already."""
    stem = f"{kind}-{scene}-{datetime.now():%Y%m%d-%H%M%S}"
    return next(n for i in range(1000) if not os.path.exists(n := f"{stem}{f'-{i}' if i else ''}{ending}"))
