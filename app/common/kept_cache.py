"""The record cache in a file that several processes may use: none loses the records of another."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from irrsplat.app.common.terminal import say
from irrsplat.core.errors import IrrsplatError


class KeptCache:
    """The file at `path` as this process has seen it last, which is to be made before the file is read."""

    def __init__(self, path: str) -> None:
        self.path = path
        self._seen = self._state()
        self._shared = False  # whether another process writes the file too

    def save(self, write: Callable[[str], object]) -> None:
        """Let `write` make the file, a path of which it is given. Where another process has written the file since this one has
        seen it, the records of both are merged, with a notice.

        Raises IrrsplatError where that fails, and where the other one's records belong to another scene or to other settings: its
        file stays.
        """
        from irrsplat.core import files  # which needs numpy, and --help does not

        with files.locked(Path(os.path.realpath(self.path)).parent):
            if not self._shared and self._state() in (self._seen, None):
                write(self.path)
                self._seen = self._state()
                return
            with tempfile.TemporaryDirectory() as folder:
                own = os.path.join(folder, "own.cache")
                write(own)
                self._merge(own)

    def _merge(self, own: str) -> None:
        from irrsplat.records import cache_file
        from irrsplat.records.merge import merge

        theirs, ours = cache_file.read_any(self.path), cache_file.read_any(own)
        if reason := cache_file.difference(theirs.key, ours.key):
            raise IrrsplatError(f"{self.path}: not written: another process has since made it {reason}; name another file")
        done = merge([theirs.state, ours.state], ours.settings())
        cache_file.write(self.path, ours.key, done.state, ours.scene)
        if not self._shared:
            say(f"notice: {self.path}: another process has written it since; the records of both are in it")
        self._shared = True

    def _state(self) -> tuple[int, int, int] | None:
        """Return a value that differs once the file is written again; None: there is no file."""
        try:
            found = os.stat(self.path)
        except FileNotFoundError:
            return None
        return found.st_ino, found.st_size, found.st_mtime_ns
