"""Batches that fit into ticks: sizes follow from what earlier batches cost, on a clock that only batches advance."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field

import moderngl
import numpy as np
import pytest

from irrsplat.core.timing.clock import Clock, use_clock
from irrsplat.core.timing.input_waits import InputWaits, checked_by, stop_for_input
from irrsplat.gpu.time_budget import Budget, Pace
from tests.support.counted_clock import RayClock

MANY = 10**6  # items, more than any tick does


@dataclass
class Machine(Clock):
    """A context and its clock: a batch of n items takes overhead + n·each seconds, times a log-normal noise."""

    overhead: float
    each: float
    noise: float = 0.0
    time: float = 0.0
    sizes: list[int] = field(default_factory=list)
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def __post_init__(self) -> None:
        self.pace = Pace(self)  # type: ignore[arg-type]

    def now(self) -> float:
        return self.time

    def finish(self) -> None:
        pass

    def tick(self, seconds: float | None, requested: int = MANY, rays: int = 0) -> float:
        """Do one tick of items with so many rays each; the seconds that it took."""
        start = self.time
        for some in self.pace.batches(requested, 1000, Budget(seconds), rays):
            count = some.stop - some.start
            self.time += (self.overhead + self.each * count) * self.random.lognormal(0.0, self.noise)
            self.sizes.append(count)
        return self.time - start

    def ticks(self, number: int, seconds: float, requested: int = MANY) -> np.ndarray:
        """Do so many ticks; the seconds of each. `sizes` are those of these ticks alone."""
        self.sizes.clear()
        return np.array([self.tick(seconds, requested) for _ in range(number)])

    @property
    def useful(self) -> float:
        """Seconds that the items of `sizes` took without the batches' overhead."""
        return sum(self.sizes) * self.each


@pytest.fixture
def machine() -> Iterator[Callable[..., Machine]]:
    """Make a Machine whose clock budgets read."""
    with ExitStack() as used:

        def make(overhead: float, each: float, noise: float = 0.0) -> Machine:
            made = Machine(overhead, each, noise)
            used.enter_context(use_clock(made))
            return made

        yield make


def test_a_tick_is_filled_and_not_overrun(machine: Callable[..., Machine]) -> None:
    """50 ms hold one batch of 40 items at 10 ms + 1 ms an item: at least 30 of them once the costs are known."""
    made, took, done = machine(0.010, 0.001), [], []
    for _ in range(12):
        took.append(made.ticks(1, 0.05)[0])
        done.append(sum(made.sizes))
    assert min(done[2:]) >= 30 and max(took) < 0.065, (done, took)


@pytest.mark.parametrize("noise", [0.0, 0.2])
@pytest.mark.parametrize("seconds", [-1.0, 0.016])
def test_batches_grow_where_ticks_are_shorter_than_the_overhead(
    machine: Callable[..., Machine], seconds: float, noise: float
) -> None:
    """20 ms a batch and 0.3 ms an item: one item a tick would take 68 times as long as the items alone. At least a third of the
    time goes to items, and no tick takes much longer than a batch whose two terms are equal."""
    made = machine(0.020, 0.0003, noise)
    first, took = made.ticks(40, seconds), made.ticks(200, seconds)
    assert made.useful > 0.33 * took.sum(), made.sizes
    assert max(first.max(), took.max()) < 0.040 * (1.0 + 3.0 * noise) + 0.010


def test_the_first_batch_has_rays_enough_to_measure(machine: Callable[..., Machine]) -> None:
    """16 384 rays take a few milliseconds: 64 items of 256 rays. One item would measure the overhead alone."""
    made = machine(0.010, 0.0001)
    made.tick(0.001, rays=256)
    assert made.sizes == [64]


def test_costs_that_change_are_learned_anew(machine: Callable[..., Machine]) -> None:
    """A first batch that compiles shaders for a second; later the overhead grows tenfold, and falls again."""
    made = machine(1.0, 0.001)
    made.tick(0.05)
    for overhead in (0.004, 0.040, 0.004):
        made.overhead = overhead
        made.ticks(25, 0.05)
        took = made.ticks(50, 0.05)
        assert made.useful > 0.4 * took.sum() and took.max() < 0.11, (overhead, made.sizes)


def test_without_an_end_everything_is_done_at_once(machine: Callable[..., Machine]) -> None:
    made = machine(0.010, 0.001)
    made.tick(None, 2500)
    assert made.sizes == [1000, 1000, 500]
    made.tick(-1.0, 100)
    assert made.sizes[3:] and made.sizes[3] >= 1, "at least one item, although the budget is over"


@pytest.mark.parametrize(("share", "reserve", "seconds"), [(1.0, 0.0, 100.0), (0.5, 40.0, 30.0), (1.0, 90.0, 20.0)])
def test_a_part_keeps_the_reserve_but_has_a_fifth_of_the_tick(share: float, reserve: float, seconds: float) -> None:
    assert Budget(100.0).part(share, reserve).left == pytest.approx(seconds, abs=1.0)
    assert not Budget(None).part(share, reserve).limited


def test_work_that_takes_no_time_by_the_clock_is_done_at_once(ctx: moderngl.Context) -> None:
    """Let the work trace no rays, for a clock that counts rays."""
    with use_clock(RayClock(1e6)):
        pace = Pace(ctx)
        assert sum(some.stop - some.start for some in pace.batches(500, 1000, Budget(0.01))) == 500
        assert sum(some.stop - some.start for some in pace.batches(500, 1000, Budget(0.01))) == 500


def test_input_ends_the_budget_of_a_tick_that_must_make_a_picture() -> None:
    """The tick after a new size has no older picture to keep: its stages run to their end."""
    with checked_by(lambda: True, raises=False):
        stop_for_input()
        assert Budget(1.0).left == -np.inf and Budget(None).left == np.inf
    with checked_by(lambda: True), pytest.raises(InputWaits):
        stop_for_input()
