"""Clock of the tests: it counts readings and rays, so that results are independent of the machine and its load."""

from __future__ import annotations

from irrsplat.core.timing.clock import RayClock

READING = 1e-3  # seconds per reading of the clock
RAYS = 1e6  # rays per second


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
