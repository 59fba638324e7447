"""Clocks of the tests: they count rays, or readings as well, so that results do not depend on the machine and its load."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, wait
from typing import Any

from irrsplat.core.timing.clock import Clock

READING = 1e-3  # seconds per reading of the clock
RAYS = 1e6  # rays per second


class RayClock(Clock):
    """A clock that advances by traced rays alone, and waits for threads without a limit.

    A frame budget then ends after the same work on every machine and under every load. second: the number of rays in a second.
    """

    def __init__(self, second: float) -> None:
        self._second, self._now = second, 0.0

    def now(self) -> float:
        """Return the seconds since the clock was made."""
        return self._now

    def traced(self, rays: float) -> None:
        """Advance by the time of `rays`."""
        self.advance(rays / self._second)

    def advance(self, seconds: float) -> None:
        """Let `seconds` pass."""
        self._now += seconds

    def wait(self, futures: Sequence[Future[Any]], seconds: float) -> bool:
        """Wait until all `futures` are done. Return True."""
        wait(futures)
        return True


class CountedClock(RayClock):
    """Clock that advances by a millisecond per reading and a microsecond per ray.

    Work without rays takes a reading or two. A frame budget below a millisecond ends after the first step.
    """

    def __init__(self) -> None:
        super().__init__(RAYS)

    def now(self) -> float:
        """Return the seconds since the clock was made, including this reading."""
        self.advance(READING)
        return super().now()
