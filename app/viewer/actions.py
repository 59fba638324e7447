"""All actions of the viewer, without a window. Each action in input/commands.py is a method by its name."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import datetime
from importlib.util import find_spec
from math import dist
from operator import attrgetter
from pathlib import Path

import numpy as np
import platformdirs

import irrsplat
from irrsplat.app.common.kept_cache import state_of
from irrsplat.app.film.background import FilmInBackground, FilmJob
from irrsplat.app.viewer.editing.editor import Editor
from irrsplat.app.viewer.editing.objects import light_name, object_name, on_screen
from irrsplat.app.viewer.input import prompts
from irrsplat.app.viewer.input.commands import EXTRAS, Command
from irrsplat.app.viewer.messages import Messages
from irrsplat.app.viewer.preferences import Preferences, check_path
from irrsplat.app.viewer.session import Session, overrides
from irrsplat.app.viewer.view_options import SECTIONS
from irrsplat.app.viewer.window import trim
from irrsplat.core.errors import InputError
from irrsplat.core.files import make_folder, write_picture, write_text
from irrsplat.core.load_options import LoadOptions
from irrsplat.scene.camera_path import path_text
from irrsplat.scene.io.text.scene_writer import parts_folder, scene_file, write_scene
from irrsplat.scene.model import Camera
from irrsplat.settings import preset

_FINEST = 0.05  # % of estimated error: the least aim of refinement by the menu
_RING = 12.0  # window coordinates: the greatest distance of a click from the middle of a light's ring


class Actions:
    """The actions of the user on a session. source: the path or name of the scene. preferences: the choices of the last run.

    loading: the options for reading scenes. native: True if the desktop's dialogs may open.
    """

    _seen: Sequence[object]  # state_of the watched files

    def __init__(self, session: Session, source: str, preferences: Preferences, loading: LoadOptions, native: bool) -> None:
        self.session, self.source, self.preferences, self.loading = session, source, preferences, loading
        self.messages = Messages()
        self.say, self.attempt = self.messages.say, self.messages.attempt
        self.editor = Editor(session)
        self.screenshot_wanted = self.quitting = False
        self.dialog = prompts.DesktopDialog(native)
        self.prompt: prompts.Prompt | None = None  # the open question to the user
        self.saved_as = ""  # the .scene file that Save writes; "" before the first save
        self.film = FilmInBackground()
        # calls work that takes seconds, once a frame has shown the words
        self.announce: Callable[[str, Callable[[], object]], object] = lambda words, work: work()
        preferences.opened(source)
        self._watch(session.scene.files)

    def press(self, command: Command) -> None:
        """Run an action of the table, if it can run. Errors and missing extras become messages."""
        if not self.can(command):
            self.say(self.missing(command) or f"{command.title}: not possible now", topic="missing")
            return
        self.messages.drop("pick")
        method = attrgetter(command.action)(self)
        self.attempt(method if command.argument is None else lambda: method(command.argument))

    def can(self, command: Command) -> bool:
        return not self.missing(command) and (not command.enabled or bool(attrgetter(command.enabled)(self)))

    def missing(self, command: Command) -> str:
        """Return a line that names the missing extra of an action, and the command that installs it; "" for none."""
        module, install = EXTRAS.get(command.extra, ("", ""))
        return f"needs the extra {command.extra}: {install}" if module and find_spec(module) is None else ""

    @property
    def selected(self) -> bool:
        return self.editor.mesh is not None or (self.editor.light is not None and self.session.options.lights)

    @property
    def film_possible(self) -> bool:
        """True if a flight is recorded, and no film is in progress."""
        return self.session.path_recorder.path is not None and not self.film.busy

    # ---- camera, buffers and sides ---------------------------------------------------------------------------------

    def record(self) -> None:
        """Begin to record the flight, or end the recording and write the path file."""
        path = self.session.path_recorder.record(self.session.camera)
        if path is None:
            self.say("recording the flight; R ends it")
            return
        name = _stamped("flight", self.title, ".path")
        write_text(name, path_text(path.shifted(self.session.origin)))
        self.say(f"{name}: {path.frames} frames; File, Save film makes a film of it")

    def show(self, name: str) -> None:
        self.session.options.buffer = name

    def is_on(self, name: str) -> bool:
        """Return True if an option or a part of the interface is on. A section is on only while the side panel is open."""
        options = self.session.options
        return bool(getattr(options, name)) and (options.controls or name not in SECTIONS)

    def is_active(self, command: Command) -> bool:
        """Return True if the choice or the option of an action is the present one."""
        session, argument = self.session, command.argument
        now = {"show": session.options.buffer, "session.use_preset": session.chosen.preset}
        if command.action == "toggle" and isinstance(argument, str):
            return self.is_on(argument)
        return command.action in now and argument == now[command.action]

    @property
    def title(self) -> str:
        """The title of the scene on show: the name of its saved file, or else its name."""
        return Path(self.saved_as).stem if self.saved_as else self.name

    @property
    def file(self) -> str:
        """The file of the scene on show, or the name of a bundled scene."""
        return self.saved_as or self.source

    @property
    def name(self) -> str:
        """The name of the opened scene; the name of its folder if the file has the common name "scene"."""
        name = self.session.scene.name
        return Path(os.path.abspath(self.source)).parent.name if name == "scene" and os.path.isfile(self.source) else name

    def toggle(self, name: str) -> None:
        options, on = self.session.options, not self.is_on(name)
        setattr(options, name, on)
        options.controls |= on and name in SECTIONS

    def compare(self, alone: bool = False) -> None:
        """Show two presets side by side, or one picture again. alone: True to show one side alone, at the next call the other."""
        session, options = self.session, self.session.options

        def change() -> None:
            if not (alone and options.split):
                session.split(alone or not options.split)
            if alone:
                options.side = 0 if options.divider == 0.0 else 1
                options.divider = float(1 - options.side)

        if len(session.renderers) == 1:  # the second one takes seconds
            self.announce("preparing the second preset…", change)
        else:
            change()

    def refine_further(self) -> None:
        """Halve the estimated error at which refinement ends. Set it to the default if it is 0, which means no refinement."""
        now = self.session.chosen.settings.viewer_quality
        aim = max(0.5 * now, _FINEST) if now else preset("default").viewer_quality
        self.session.change(self.session.options.side, viewer_quality=aim)
        self.say(f"refinement ends at {aim:.2g} % of estimated error", topic="refine")

    def trace(self) -> None:
        """Start path-tracing the reference of the view in the background, or stop."""
        self.say(self.session.tracing.toggle(self.session.subject), topic="reference")

    def collect(self) -> None:
        """Update all background work: dialog, film and reference. Measure the plane if it is shown. Notice a changed file."""
        other = [path for path, seen in zip(self._files, self._seen, strict=True) if state_of(path) not in (None, seen)]
        if other:
            self._seen, self.changed = [state_of(path) for path in self._files], True
            self.say(f"{os.path.basename(other[0])} has changed on disk; F5 opens the scene again", topic="file")
        self.attempt(self.dialog.update)
        self.attempt(lambda: self.film.update(self.say))
        plane = self.session.options.plane and not self.editor.dragging
        self.attempt(lambda: self.session.plane.update(plane, self.session.scene))
        self.attempt(lambda: self.session.tracing.update(self.session.subject, self.say))

    def clear(self) -> None:
        for renderer in self.session.active:
            renderer.forget(lights=False)

    # ---- lights and objects ------------------------------------------------------------------------------------------

    def pick(self, pixel: tuple[int, int], mesh: int | None, density: float = 1.0) -> None:
        """Pick the light with its ring at a pixel, while the panel of lights is open. Else pick the `mesh` there, if any.

        density: pixels per window coordinate.
        """
        editor, session = self.editor, self.session
        near = {}  # by light: its distance from the eye
        for number, light in enumerate(editor.scene.lights if session.options.lights else ()):
            place = None if light.directional else on_screen(session.camera, session.size, light.position)
            if place is not None and dist(place, pixel) <= _RING * density:
                near[number] = dist(light.position, session.camera.eye)
        if near:
            editor.pick_light(min(near, key=lambda number: near[number]))
        else:
            editor.mesh, editor.light = mesh, None if mesh is None else editor.light

    def add_light(self) -> None:
        """Add a light, and open the list of lights."""
        self.session.options.lights = self.session.options.controls = True
        self.announce("adding a light…", self.editor.add_light)  # another number of lights needs other shaders

    def delete(self) -> None:
        """Delete the selected light, or hide the selected object. A mesh stays in the scene's files."""
        editor, light, mesh = self.editor, self.editor.light, self.editor.mesh
        if mesh is not None:
            editor.hide(mesh)
            self.say(f"{object_name(editor.scene, mesh)} is hidden; Ctrl+Z shows it again", topic="pick")
        elif light is not None:
            one, name = editor.scene.lights[light], light_name(editor.scene.lights[light], light)

            def work() -> None:
                if one in editor.scene.lights:  # a second request may have come before the work
                    editor.set_light(editor.scene.lights.index(one))
                    self.say(f"{name} is deleted; Ctrl+Z restores it", topic="pick")

            self.announce(f"deleting {name}…", work)

    # ---- saving ------------------------------------------------------------------------------------------------------

    def save_as(self, then: Callable[[], object] | None = None) -> None:
        """Request a file name by the dialog of the desktop, or else by a prompt, and save the scene there."""
        new = os.path.join(prompts.folder(self), f"{self.name}-2.scene")
        name, take = self.saved_as or new, lambda path: self.save(path, then)
        if self.dialog.native:
            self.dialog.request(name, take, save=True)
        else:
            self.prompt = prompts.file_name(name, take)

    def save_again(self, then: Callable[[], object] | None = None) -> None:
        """Save the scene in its last saved file; the first time, in a new file.

        Request the name again if another program has changed the files.
        """
        changed = self.saved_as and (self.changed or self._seen != [state_of(path) for path in self._files])
        if changed:
            self.say(f"{self.saved_as} has changed since it was saved; replace it, or save under another name")
        if self.saved_as and not changed:
            self.save(self.saved_as, then)
        else:
            self.save_as(then)

    def save(self, name: str, then: Callable[[], object] | None = None) -> None:
        """Save the present scene as a `.scene` of this name and a folder of its parts, in place of old ones, and call `then`."""
        path = scene_file(name)
        lost = write_scene(self.session.scene.placed(self.session.origin), path)
        self.editor.saved = self.editor.scene
        self.saved_as = str(path)
        self._watch((path, *parts_folder(path).glob("*")))
        self.preferences.opened(str(path))
        self.say(f"{path} is written, with {parts_folder(path).name}")
        if lost:
            self.say(lost)
        if then is not None:
            then()

    def _watch(self, files: Iterable[str | Path], before: Mapping[str, object] | None = None) -> None:
        """Watch the files of the scene on show. before: states by file, from before it was read; default: the present ones."""
        self._files, self.changed = tuple(files), False  # changed: True if another program has changed one of them
        self._seen = [(before or {}).get(str(path), state_of(path)) for path in self._files]

    def _unless_unsaved(self, act: Callable[[], object]) -> None:
        """Write the flight that is recorded, and call `act`. If there are unsaved changes, open the prompt about them first.

        Without a file of the flight, `act` waits for the next call.
        """
        if self.session.path_recorder.recording is not None:
            self.record()
        if self.editor.unsaved:
            self.prompt = prompts.unsaved(self, act)
        else:
            act()

    def save_film(self) -> None:
        """Begin a film of the path with the present scene, settings and picture size, in the videos folder."""
        session, folder = self.session, Path(platformdirs.user_videos_path())
        path, renderer = session.path_recorder.path, session.renderers[0]
        if path is None:
            raise InputError("there is no path to film; R records one")
        values = overrides(renderer.preset, renderer.settings)
        if np.isfinite(session.auto_exposure.stops):
            values["exposure"] = session.auto_exposure.stops
        make_folder(folder)
        scene, path = session.scene.placed(session.origin), path.shifted(session.origin)
        name = _stamped(str(folder / "irrsplat"), self.title, ".mp4")
        self.film.begin(name, FilmJob(scene, path, session.size, renderer.preset, values))

    def cancel_film(self) -> None:
        self.film.release()
        self.say("the film is given up; nothing of it was kept", topic="film")

    # ---- the window --------------------------------------------------------------------------------------------------

    def escape(self) -> None:
        """Close the prompt. Without a prompt, close menus and messages, and deselect object and light."""
        if self.prompt is None:
            self.editor.pick_light(None)
            self.messages.lines = []
        self.session.options.close_menus, self.prompt = True, None

    def find_command(self, all_keys: bool = False) -> None:
        """Open the prompt for an action, a setting or a scene. all_keys: True to begin with the keys of flight and the mouse."""
        self.prompt = prompts.command(self, all_keys)

    def show_setting(self, name: str) -> None:
        """Open the list of settings at the setting `name`."""
        options = self.session.options
        options.controls, options.settings, options.sought = True, True, name

    def quit(self) -> None:
        """Close the window, once unsaved changes are saved or discarded."""
        self._unless_unsaved(self._quit)

    def _quit(self) -> None:
        if self.film.busy and not self.film.warned:
            self.film.warned = True
            self.say("a film is being made; Quit again gives it up", topic="quit")  # progress has another topic
            return
        self.quitting = True

    def screenshot(self) -> None:
        """Request a screenshot, which the next frame writes."""
        self.screenshot_wanted = True

    def save_screenshot(self, picture: np.ndarray) -> None:
        """Write a picture (H, W, 3), display values 0..1, as PNG into the pictures folder."""
        folder = Path(platformdirs.user_pictures_path())
        make_folder(folder)
        path = _stamped(str(folder / "irrsplat"), self.title, ".png")
        write_picture(Path(path), picture)
        self.say(f"{path} is written")

    # ---- scenes ------------------------------------------------------------------------------------------------------

    def open_file(self) -> None:
        """Request a scene, and open it. Without a dialog of the desktop, open the command palette for it."""
        if self.dialog.native:
            self.dialog.request(prompts.folder(self) + os.sep, self.open)
        else:
            self.find_command()

    def open(self, source: str, camera: Camera | None = None) -> None:
        """Show the scene at `source`, from `camera` in world space, once unsaved changes are saved or discarded."""
        check_path(source)

        def show() -> None:
            self.announce(f"opening {os.path.basename(source)}…", lambda: self._show_scene(source, camera))

        self._unless_unsaved(show)

    def reload(self) -> None:
        """Open the file of the scene again, at the present camera, once unsaved changes are saved elsewhere or discarded."""
        self.open(self.file, self.session.camera.shifted(self.session.origin))

    def _show_scene(self, source: str, camera: Camera | None) -> None:
        former, before = self.session.notices, {str(path): state_of(path) for path in (source, *self._files)}
        self.session.open(irrsplat.load(source, **vars(self.loading)), camera)
        trim()
        self.editor = Editor(self.session)
        self.messages.close_errors(former)
        for notice in self.session.notices:
            self.say(notice)
        if source != self.saved_as:
            self.source, self.saved_as = source, ""
        self._watch(self.session.scene.files, before)
        self.messages.drop("file")
        self.preferences.opened(source)


def _stamped(kind: str, scene: str, ending: str) -> str:
    """Return the name of a new file, with its kind, scene and time."""
    stem = f"{kind}-{scene}-{datetime.now():%Y%m%d-%H%M%S}"
    return next(n for i in range(1000) if not os.path.exists(n := f"{stem}{f'-{i}' if i else ''}{ending}"))
