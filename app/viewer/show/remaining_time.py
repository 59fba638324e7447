"""How long a view will go on filling, by how fast it has filled just now."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

_SPAN = 4.0  # seconds that the estimate looks back
_LEAST = 0.5  # seconds that it needs
_SERVED = 1e-3  # share of the pixels: what still asks then is served at once
_WEIGHT = 0.2  # of a new estimate in the running mean of the end
_MINUTE = 60.0  # seconds


@dataclass(frozen=True)
class Work:
    """What a view still lacks.

    unserved: share of its pixels that ask for a record, 0..1. surface: share of the surface cache that is still to be made, 0..1.
    waiting: records that are to be gathered again. gathered: records gathered so far, old ones again among them.
    """

    unserved: float
    surface: float
    waiting: int
    gathered: int

    @property
    def done(self) -> bool:
        """Whether nothing is lacking."""
        return self.unserved == 0.0 and self.surface == 0.0 and self.waiting == 0


class RemainingTime:
    """Estimates when a view is filled, in seconds from now; None while there is nothing to tell it by, or nothing to do.

    The share of pixels that ask falls as an exponential does, since each round serves the same part of what is left; the surface
    cache and the records that wait go down evenly.
    """

    def __init__(self) -> None:
        self._past: deque[tuple[float, Work]] = deque()  # of the last _SPAN seconds
        self._end: float | None = None

    def reset(self) -> None:
        """Another view begins."""
        self._past.clear()
        self._end = None

    def add(self, now: float, work: Work) -> None:
        """Note what is lacking at `now`, seconds, later than the last time."""
        if work.done or (self._past and work.unserved > self._past[-1][1].unserved + 0.5):
            self.reset()  # nothing to do, or all anew
        if work.done:
            return
        self._past.append((now, work))
        while len(self._past) > 2 and now - self._past[1][0] >= _SPAN:
            self._past.popleft()
        left = self._left()
        if left is not None:
            end = now + left
            before = end if self._end is None or self._end <= now else self._end  # none, or it has proved wrong
            self._end = before + _WEIGHT * (end - before)

    @property
    def seconds(self) -> float | None:
        """The seconds that are left as of the last `add`; None where less was done than expected."""
        left = None if self._end is None or not self._past else self._end - self._past[-1][0]
        return left if left is not None and left > 0.0 else None

    def _left(self) -> float | None:
        (then, before), (now, work) = self._past[0], self._past[-1]
        passed = now - then
        if passed < _LEAST:
            return None
        parts = (
            _time(math.log(max(work.unserved / _SERVED, 1.0)), _log_ratio(before.unserved, work.unserved)),
            _time(work.surface, before.surface - work.surface),
            _time(work.waiting, work.gathered - before.gathered),
        )
        filling, surface, waiting = (None if part is None else part * passed for part in parts)
        if filling is None or surface is None or waiting is None:
            return None
        return max(filling, surface) + waiting


def _log_ratio(before: float, now: float) -> float:
    """By how much the logarithm of a share has fallen; 0 for one that was or is 0."""
    return math.log(before / now) if before > 0.0 and now > 0.0 else 0.0


def _time(left: float, done: float) -> float | None:
    """How many times the span since `done` was left `left` will take; None where nothing was done."""
    return 0.0 if left <= 0.0 else left / done if done > 0.0 else None


def in_words(seconds: float) -> str:
    """A time that is not known well: "about 8 s", "about 2 min"."""
    if seconds >= 1.5 * _MINUTE:
        return f"about {seconds / _MINUTE:.0f} min"
    return f"about {max(round(seconds), 1) if seconds < 10.0 else 5 * round(seconds / 5.0)} s"
