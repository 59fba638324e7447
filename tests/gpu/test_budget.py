"""What fits into a tick: batches are cut by what those before them cost, on a clock that only they move."""

from __future__ import annotations

import numpy as np
import pytest

from irrsplat.gpu import time_budget
from irrsplat.gpu.time_budget import Budget, Pace

FIXED, EACH = 0.010, 0.001  # seconds that a batch costs, and each thing in it


class Clock:
    """A context and its time."""

    now = 0.0

    def perf_counter(self) -> float:
        return self.now

    def finish(self) -> None:
        pass


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(time_budget, "time", made)
    return made


def tick(clock: Clock, pace: Pace, wanted: int, seconds: float = 0.05) -> int:
    """How many things are done in a tick."""
    done = 0
    for count in pace.batches(wanted, 1000, Budget(seconds)):
        clock.now += FIXED + EACH * count
        done += count
    return done


def test_a_tick_is_filled_and_not_overrun(clock: Clock) -> None:
    """50 ms hold one batch of 40 things; a first, small one, 8 of 18 ms, and another of 22."""
    pace = Pace(clock)  # type: ignore[arg-type]
    done, ends = [], []
    for _ in range(12):
        start = clock.now
        done.append(tick(clock, pace, 10_000))
        ends.append(clock.now - start)
    assert min(done[2:]) >= 30 and max(ends) < 0.065, (done, ends)


def test_single_things_do_not_make_batches_look_dear(clock: Clock) -> None:
    """One thing costs 11 ms, but that is the batch's: the next tick takes as many as before."""
    pace = Pace(clock)  # type: ignore[arg-type]
    for _ in range(4):
        tick(clock, pace, 10_000)
    for _ in range(3):
        assert tick(clock, pace, 1) == 1
        assert tick(clock, pace, 10_000) >= 25


def test_without_an_end_all_is_done_at_once(clock: Clock) -> None:
    pace = Pace(clock)  # type: ignore[arg-type]
    assert list(pace.batches(2500, 1000, Budget(None))) == [1000, 1000, 500]
    assert tick(clock, pace, 100, seconds=-1.0) >= 1, "at least one thing"
    assert np.isfinite(clock.now)
