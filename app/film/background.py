"""A film of a path, made in a process of its own while the caller continues."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path as File

from irrsplat.app.common.outputs import Outputs
from irrsplat.app.film import films, frames, video
from irrsplat.app.film.flight import Flight
from irrsplat.core.errors import InputError
from irrsplat.core.timing import clock, other_process
from irrsplat.image.frame import numbered
from irrsplat.renderer import Renderer
from irrsplat.scene.camera_path import Path
from irrsplat.scene.model import Scene
from irrsplat.settings import SettingValues

_NICE = 10  # added to the niceness of the process: the window goes first
_EVERY = 2.0  # seconds between two lines of progress, less than a message is shown


@dataclass(frozen=True)
class FilmJob:
    """The input of a film: `path` in world space through `scene`, pictures of `size` (W, H), preset and settings."""

    scene: Scene
    path: Path
    size: tuple[int, int]
    preset: str
    values: SettingValues


class FilmInBackground:
    """At most one film in the making. warned: True if the user was warned that closing gives it up."""

    def __init__(self) -> None:
        self.warned = False
        self._calling: other_process.Calling | None = None
        self._name, self._frames, self._said = "", 0, 0.0
        self._first = 0.0, 0.0  # the share and the time at the end of the first frame, which takes the longest
        self._folder: tempfile.TemporaryDirectory[str] | None = None  # in which the film is made

    @property
    def busy(self) -> bool:
        return self._calling is not None

    @property
    def progress(self) -> str:
        share = self._calling.share if self._calling is not None else 0.0
        frame = int(share * self._frames)
        if frame >= self._frames:
            return "film: encoding"
        before, begun = self._first
        seconds = (1.0 - share) * (clock.now() - begun) / (share - before) if share > before > 0.0 else 0.0
        left = f", about {seconds / 60.0:.0f} min left" if seconds > 60.0 else ""
        return f"film: frame {frame} of {self._frames}{left}"

    def begin(self, name: str, job: FilmJob) -> None:
        """Make the film `name`, completely or not at all. Raises InputError if it cannot be written or encoded."""
        video.check(name, flies=True)
        if not video.is_film(name):
            raise InputError(f"a film ends in {', '.join(video.ENDINGS)}", name)
        if job.values.get("backdrop") == "clear":
            raise InputError("films have no alpha; take another backdrop than clear", name)
        self._folder = films.folder_beside(name)
        self._name, self._frames, self._said, self.warned = name, job.path.frames, clock.now() - _EVERY, False
        self._first = 0.0, 0.0
        self._calling = other_process.Calling(other_process.code(_write), (job, self._made), "the film failed ({why})")

    @property
    def _made(self) -> str:
        assert self._folder is not None
        return str(File(self._folder.name, File(self._name).name))

    def release(self) -> None:
        """Stop the film; nothing of it stays."""
        calling, self._calling = self._calling, None
        if calling is not None and self._folder is not None:
            calling.release()
            self._folder.cleanup()

    def update(self, say: Callable[..., object]) -> None:
        """Say how far the film is, or that it is written. Raises IrrsplatError or OSError if it failed."""
        calling = self._calling
        if calling is not None and calling.is_alive():
            if not self._first[0] and calling.share * self._frames >= 1.0:
                self._first = calling.share, clock.now()
            if clock.now() - self._said >= _EVERY:
                self._said = clock.now()
                say(self.progress, topic="film")
        elif calling is not None:
            try:
                if calling.error is not None:
                    raise calling.error
                os.replace(self._made, self._name)
            finally:
                self.release()
            say(f"{self._name} is written", topic="film")


# ---- in the other process ----------------------------------------------------------------------------------------------


def _write(job: FilmJob, name: str, report: Callable[[float], None]) -> None:
    """Render all frames into the folder of the film `name`, and encode them."""
    if hasattr(os, "nice"):
        os.nice(_NICE)

    def on_frame(frame: str, done: int, count: int) -> frames.OnRound:
        return lambda state: report((done + state.coverage) / count)

    pattern, numbers = films.pattern_in(str(File(name).parent)), range(job.path.frames)
    flight, outputs = Flight(job.path, numbers, (pattern,)), Outputs()
    with Renderer(job.scene, job.size, job.preset, **job.values) as renderer:
        frames.render(renderer, flight, None, False, on_frame, outputs, None, kept=pattern)
    outputs.raise_failures()
    report(1.0)
    video.write(name, [File(numbered(pattern, number)) for number in numbers], Fraction(video.RATE))
