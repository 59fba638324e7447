"""The frames of a film while it is made: pictures in a folder beside it, so that no process that is stopped has worked in vain.

The folder goes when the film is whole. A file in it says what the frames are of; `--resume` goes on with those of the same film.
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
    """The folder of a film's frames, each a PNG."""

    folder: Path

    @classmethod
    def beside(cls, film: str) -> KeptFrames:
        """Those of the film `film`."""
        return cls(Path(os.path.realpath(film) + ".frames"))

    @property
    def pattern(self) -> str:
        """The name of a frame, with {frame} in it."""
        return str(self.folder).replace("{", "{{").replace("}", "}}") + "/{frame:06d}.png"

    def check(self) -> None:
        """Raises InputError where something else is in the folder's place."""
        if os.path.lexists(self.folder) and not self._ours:
            raise InputError("the frames of a film are kept here, and something else is in the way; move it", self.folder)

    @property
    def _ours(self) -> bool:
        """Whether the folder is one that this class has made: with its key, or with nothing yet."""
        return (self.folder / _KEY).is_file() or (self.folder.is_dir() and not any(self.folder.iterdir()))

    def begin(self, key: str, resume: bool) -> None:
        """Have the folder ready, empty unless its frames are of the same film, by its `key`, and to `resume` is wanted."""
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
        """Remove the folder with all frames, and what says what they are of last: a folder that is left half removed is gone on
        with, or removed the next time."""
        with suppress(OSError):
            for path in sorted(self.folder.iterdir(), key=lambda path: path.name == _KEY):
                path.unlink()
            self.folder.rmdir()


def key_of(renderer: Renderer, flight: Flight, colours: object, cache: str | None) -> str:
    """All that a film's frames are made of, as text. colours: the false ones, None for none. cache: the file of a frozen cache,
    None where records are gathered as frames ask for them."""
    settings = renderer.settings
    light = cache_file.key(renderer.scene.local, settings)
    made_of = {
        "format": _FORMAT,
        "size": renderer.size,
        "settings": astuple(settings),
        "scene": [light.geometry, light.lights],
        "cameras": [[camera.eye, camera.target, camera.up, camera.fov] for camera in flight.path],
        "motions": repr(flight.path.motions),
        "colours": repr(colours),
        "records": None if cache is None else hashlib.sha256(Path(cache).read_bytes()).hexdigest(),
    }
    return json.dumps(made_of, default=str)


def unwritten(patterns: Sequence[str], number: int) -> list[str]:
    """Those of the outputs `patterns` that have no file of this frame yet."""
    return [pattern for pattern in patterns if not os.path.exists(numbered(pattern, number))]
