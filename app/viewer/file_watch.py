"""Watches a few files for changes by looking at their times and sizes twice a second."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence

from irrsplat.core.timing.clock import now

_EVERY = 0.5  # seconds
_STILL = 0.2  # seconds that a file must have been left alone: an editor may write in several steps


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
        """Whether a file has changed since the last time that this was true."""
        if now() < self._next:
            return False
        self._next = now() + _EVERY
        state = self._state()
        before, self._last = self._last, state
        fresh = [f for f, k in zip(state, self._known, strict=True) if f != k]
        if not fresh or None in fresh:
            return False  # nothing has changed, or a file is being replaced
        # by the clock it was left alone, or, whatever the clock is set to, since the last look
        if state != before and any(f is not None and time.time() - f[0] * 1e-9 < _STILL for f in fresh):
            return False
        self._known = state
        return True
