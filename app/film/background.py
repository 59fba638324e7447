"""A film of a path, made by a process of its own while the caller goes on."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path as File
from threading import Event, Thread

from irrsplat.app.common.outputs import Outputs
from irrsplat.app.common.pictures import Pictures
from irrsplat.app.film import frames, video
from irrsplat.app.film.flight import Flight
from irrsplat.app.film.kept import KeptFrames
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.core.timing import clock, other_process
from irrsplat.image.frame import numbered
from irrsplat.image.view import Progress
from irrsplat.scene.camera_path import Path
from irrsplat.scene.model import Scene
from irrsplat.settings import SettingValues

_MAIN = "from irrsplat.app.film.background import main; main()"
_NICE = 10  # added to the niceness of the process: the window goes first
_EVERY = 2.0  # seconds between two lines of progress, less than a message is shown
_JOIN = 5.0  # seconds that the end of a stopped film is waited for


@dataclass(frozen=True)
class FilmJob:
    """The input of a film: `path` in world space through `scene`, pictures of `size` (W, H), preset and settings."""

    scene: Scene
    path: Path
    size: tuple[int, int]
    preset: str
    values: SettingValues


class _Stopped(Exception):
    """The film was stopped."""


class FilmInBackground:
    """At most one film in the making. warned: True if the user was warned that closing gives it up."""

    def __init__(self) -> None:
        self.warned = False
        self._thread: Thread | None = None
        self._stop, self._share, self._error = Event(), 0.0, ""
        self._name, self._frames, self._said = "", 0, 0.0

    @property
    def busy(self) -> bool:
        """True if a film is being made."""
        return self._thread is not None

    @property
    def progress(self) -> str:
        """The progress in words."""
        frame = int(self._share * self._frames)
        return f"film: frame {frame} of {self._frames}" if frame < self._frames else "film: encoding"

    def begin(self, name: str, job: FilmJob) -> None:
        """Make the film `name`, completely or not at all. Raises InputError if it cannot be written or encoded."""
        video.check(name, flies=True)
        if not video.is_film(name):
            raise InputError(f"a film ends in {', '.join(video.ENDINGS)}", name)
        if job.values.get("backdrop") == "clear":
            raise InputError("films have no alpha; take another backdrop than clear", name)
        self._stop, self._share, self._error, self.warned = Event(), 0.0, "", False
        self._name, self._frames, self._said = name, job.path.frames, clock.now() - _EVERY
        self._thread = Thread(target=self._make, args=(name, job), name="film", daemon=True)
        self._thread.start()

    def release(self) -> None:
        """Stop the film; nothing of it stays."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(_JOIN)
        self._thread = None

    def update(self, say: Callable[..., object]) -> None:
        """Say how far the film is, or that it is written. Raises IrrsplatError if it failed."""
        if self._thread is None:
            return
        if self._thread.is_alive():
            if clock.now() - self._said >= _EVERY:
                self._said = clock.now()
                say(self.progress, topic="film")
            return
        self._thread = None
        if self._error:
            raise IrrsplatError(self._error)
        say(f"{self._name} is written", topic="film")

    def _make(self, name: str, job: FilmJob) -> None:
        """Let the other process make the film in a folder beside its place, then put it there."""
        try:
            parent = File(os.path.abspath(name)).parent  # a file is renamed within a file system only
            with tempfile.TemporaryDirectory(prefix=".film-", dir=parent, ignore_cleanup_errors=True) as folder:
                made = File(folder, File(name).name)
                other_process.call(_MAIN, (job, str(made)), self._note, failure="the film failed ({why})")
                os.replace(made, name)
        except _Stopped:
            pass
        except Exception as error:
            self._error = f"{name}: {error}" if isinstance(error, OSError) else str(error)

    def _note(self, share: float) -> None:
        if self._stop.is_set():
            raise _Stopped
        self._share = share


# ---- in the other process ----------------------------------------------------------------------------------------------


def main() -> None:
    """Make the film of the arguments on stdin."""
    if hasattr(os, "nice"):
        os.nice(_NICE)
    other_process.serve(_write)


def _write(job: FilmJob, name: str, report: Callable[[float], object]) -> None:
    """Render all frames into the folder of the film `name`, and encode them."""
    from irrsplat.renderer import Renderer

    def on_round(state: Progress, frame: str = "", before: float = 0.0, share: float = 1.0) -> None:
        report(before + share * state.coverage)

    pattern, numbers = KeptFrames(File(name).parent).pattern, range(job.path.frames)
    flight, outputs = Flight(job.path, numbers, (pattern,)), Outputs()
    with Renderer(job.scene, job.size, job.preset, **job.values) as renderer:
        frames.render(renderer, flight, None, False, on_round, outputs, Pictures(), kept=pattern)
    outputs.raise_failures()
    report(1.0)
    video.write(name, [File(numbered(pattern, number)) for number in numbers], video.Encoding())
