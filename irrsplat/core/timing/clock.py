"""The clock of frame budgets and of timed notices: the wall clock, or another one that `use_clock` sets."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, wait
from contextlib import contextmanager
from typing import Any


class Clock:
    """The wall clock."""

    def now(self) -> float:
        """Return the seconds since a fixed moment."""
        return time.perf_counter()

    def traced(self, rays: float) -> None:
        """Record the number of rays traced since the last call."""

    def wait(self, futures: Sequence[Future[Any]], seconds: float) -> bool:
        """Wait for `futures`, at most `seconds`. Return True if all of them are done."""
        return not wait(futures, max(seconds, 0.0)).not_done


_clocks = [Clock()]  # the last one is in use


def now() -> float:
    """Return the seconds since a fixed moment, by the clock in use."""
    return _clocks[-1].now()


def traced(rays: float) -> None:
    """Record traced rays, for the clock in use."""
    _clocks[-1].traced(rays)


def wait_for(futures: Sequence[Future[Any]], seconds: float) -> bool:
    """Wait for `futures`, at most `seconds` by the clock in use. Return True if all of them are done."""
    return _clocks[-1].wait(futures, seconds)


@contextmanager
def use_clock(clock: Clock) -> Iterator[None]:
    """Use `clock` within the block."""
    _clocks.append(clock)
    try:
        yield
    finally:
        _clocks.pop()
