"""Temporary folder of a film's frames next to the film, so that an interrupted process loses little work.

The folder is removed after encoding. A key file identifies the film; `--resume` continues with frames of the same film.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from irrsplat.app.common.terminal import say
from irrsplat.core import files
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.image.frame import numbered
from irrsplat.records import cache_file

if TYPE_CHECKING:
    from irrsplat.app.film.flight import Flight
    from irrsplat.renderer import Renderer

_FORMAT = 1
_KEY = "made-of.json"


@dataclass(frozen=True)
class KeptFrames:
    """Folder of a film's frames, one PNG each."""

    folder: Path

    @classmethod
    def beside(cls, film: str) -> KeptFrames:
        """Return the folder of the film `film`."""
        return cls(Path(os.path.realpath(film) + ".frames"))

    @property
    def pattern(self) -> str:
        """File name pattern of a frame, with {frame}."""
        return str(self.folder).replace("{", "{{").replace("}", "}}") + "/{frame:06d}.png"

    def check(self) -> None:
        """Raise InputError if another file or folder is in its place."""
        if os.path.lexists(self.folder) and not self._ours:
            raise InputError("the frames of a film are kept here, and something else is in the way; move it", self.folder)

    @property
    def _ours(self) -> bool:
        """True if this class made the folder: it has a key file, or is empty."""
        return (self.folder / _KEY).is_file() or (self.folder.is_dir() and not any(self.folder.iterdir()))

    def begin(self, key: str, resume: bool) -> None:
        """Prepare the folder; keep its frames only for `resume` with an equal `key`."""
        self.check()
        if self.folder.is_dir():
            of_this = self._key == key
            if resume and of_this:
                return
            if resume and self._key is not None:
                say(f"notice: {self.folder} holds frames by other settings, another scene or other records; it begins anew")
            self.remove()
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise IrrsplatError(f"{self.folder}: cannot write: {error.strerror}") from error
        files.write_text(self.folder / _KEY, key)

    @property
    def _key(self) -> str | None:
        try:
            return (self.folder / _KEY).read_text(encoding="utf-8")
        except (OSError, ValueError):
            return None

    def remove(self) -> None:
        """Remove the folder with all frames, the key file last: a partly removed folder can be resumed or removed later."""
        with suppress(OSError):
            for path in sorted(self.folder.iterdir(), key=lambda path: path.name == _KEY):
                path.unlink()
            self.folder.rmdir()


def key_of(renderer: Renderer, flight: Flight, files: object, cache: str | None) -> str:
    """Return the parameters of a film's frames as text.

    files: output formats. cache: the file of a frozen cache, None if frames gather records.
    """
    settings = renderer.settings
    light = cache_file.key(renderer.scene.local, settings)
    made_of = {
        "format": _FORMAT,
        "size": renderer.size,
        "settings": astuple(settings),
        "scene": [light.geometry, light.lights],
        "cameras": [[camera.eye, camera.target, camera.up, camera.fov] for camera in flight.path],
        "motions": repr(flight.path.motions),
        "files": repr(files),
        "records": None if cache is None else hashlib.sha256(Path(cache).read_bytes()).hexdigest(),
    }
    return json.dumps(made_of, default=str)


def unwritten(patterns: Sequence[str], number: int) -> list[str]:
    """Return the outputs among `patterns` without a file of this frame."""
    return [pattern for pattern in patterns if not os.path.exists(numbered(pattern, number))]
