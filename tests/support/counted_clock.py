"""The clock of the tests: it counts readings and rays, so that no outcome depends on the machine or on its load."""

from __future__ import annotations

from irrsplat.core.timing.clock import RayClock

READING = 1e-3  # seconds that each reading of the clock takes
RAYS = 1e6  # rays in a second


class CountedClock(RayClock):
    """A clock that advances by a millisecond a reading and a microsecond a ray.

    Work without rays takes a reading or two. A frame budget below a millisecond ends after the first step.
    """

    def __init__(self) -> None:
        super().__init__(RAYS)

    def now(self) -> float:
        """Return the seconds since the clock was made, one reading included."""
        self.advance(READING)
        return super().now()
