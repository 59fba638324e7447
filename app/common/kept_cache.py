"""Record cache file shared between processes, without loss of records."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from irrsplat.app.common.terminal import say
from irrsplat.core.errors import IrrsplatError


def state_of(path: str | Path) -> tuple[int, int, int] | None:
    """Return a value that changes with each write of a file; None for a file that is missing or out of reach."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


class KeptCache:
    """Record cache file at `path`; create the object before the file is read."""

    def __init__(self, path: str) -> None:
        self.path = path
        self._seen = state_of(self.path)
        self._shared = False  # True after another process has written the file

    def save(self, write: Callable[[str], object]) -> None:
        """Call `write` with a path to make the file.

        Records that another process wrote meanwhile are merged, with a notice. Raises IrrsplatError for a failed write, and
        if the other records belong to another scene or other settings: that file stays.
        """
        from irrsplat.core import files  # needs numpy, which --help does not import

        with files.locked(Path(os.path.realpath(self.path)).parent):
            if not self._shared and state_of(self.path) in (self._seen, None):
                write(self.path)
                self._seen = state_of(self.path)
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
        merged = merge([theirs.state, ours.state], ours.settings())
        cache_file.write(self.path, ours.key, merged)
        if not self._shared:
            say(f"notice: {self.path}: another process has written it since; the records of both are in it")
        self._shared = True
