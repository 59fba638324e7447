"""Watches a few files for changes by looking at their times and sizes twice a second."""

from __future__ import annotations

import os
from collections.abc import Sequence

from irrsplat.core.timing.clock import now

_EVERY = 0.5  # seconds


class FileWatch:
    """Watches `files` (paths); one that is missing now counts as changed when it appears."""

    def __init__(self, files: Sequence[str]) -> None:
        self._files = tuple(files)
        self._known = self._last = self._state()
        self._next = now() + _EVERY

    def _state(self) -> tuple[tuple[int, int] | None, ...]:
        """Time of the last change and size of each file, None for a missing one."""

        def one(path: str) -> tuple[int, int] | None:
            try:
                found = os.stat(path)
            except OSError:
                return None
            return found.st_mtime_ns, found.st_size

        return tuple(one(path) for path in self._files)

    def changed(self) -> bool:
        """Return True if a file has changed since the last time that this was true, and has been left alone between two looks.

        An editor may write in several steps. The times of files are compared with each other alone: they may be of another clock.
        """
        if now() < self._next:
            return False
        self._next = now() + _EVERY
        state = self._state()
        before, self._last = self._last, state
        fresh = [f for f, k in zip(state, self._known, strict=True) if f != k]
        if not fresh or None in fresh or state != before:
            return False  # nothing has changed, or a file is being written or replaced
        self._known = state
        return True
