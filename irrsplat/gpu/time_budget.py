"""The time of one tick of the viewer: how much of it is left, and how much GPU work fits into it."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import TypeVar

import moderngl
import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.timing.clock import now, traced
from irrsplat.core.timing.input_waits import input_waits, interruptible

Result = TypeVar("Result")

_GATHER_SHARE = 0.2  # of a tick: gathering may take that much in any case, so that the picture refines however slow the rest is
_FIRST_STEP = 64  # items: the largest first batch of a tick; each further one may be this plus four times the one before
_LONGEST = 0.03  # seconds of a batch that input may have to wait for
_DECAY = 0.7  # weight of a measured batch relative to the one after it
_PRIOR_VARIANCE = 0.05  # relative variance of batch sizes at which new measurements weigh as much as the present estimate
_LEAST_MARGINAL_COST = 0.1  # of an item's mean cost: the least that one more item in the same batch is taken to cost
_COLD = 4.0  # times what the second batch takes: a first one that took more compiled programs and made tables, and tells nothing
_EXPLORE = 0.1  # relative growth of the estimated overhead while all batches have the same size


class Budget:
    """The time of one tick: `Budget(0.09)` ends 90 ms from now; `Budget(None)` never does. tick: seconds of the whole tick, of
    which this is a part (default: this is all of it). Raises InputError for what is no number of seconds."""

    def __init__(self, seconds: float | None, tick: float | None = None) -> None:
        if seconds is not None and not (isinstance(seconds, (int, float, np.number)) and seconds == seconds):
            raise InputError(f"seconds is a number, or None for no limit, not {seconds!r:.60}")
        self.seconds = seconds
        self.tick = seconds if tick is None else tick
        self.end = float("inf") if seconds is None else now() + seconds

    @property
    def limited(self) -> bool:
        """Whether there is an end at all."""
        return self.seconds is not None

    @property
    def left(self) -> float:
        """Seconds to the end; negative after it, and -inf while input waits for the end of a limited one."""
        return float("-inf") if self.limited and input_waits() else self.end - now()

    def part(self, share: float, reserve: float, least: float = 0.0) -> Budget:
        """A budget of `share` of what is left after keeping `reserve` seconds back, but at least 20 % of it all; or at least the
        share `least` of the whole tick, whatever has been spent."""
        if self.seconds is None or self.tick is None:
            return self
        return Budget(max(share * (self.end - now() - reserve), _GATHER_SHARE * self.seconds, least * self.tick), self.tick)

    def go_on(self, work: Generator[object, None, Result]) -> Result | None:
        """Go on with `work`, by one step at least, as far as this goes; what it returns, None where this ends before."""
        try:
            while True:
                next(work)
                if self.left <= 0.0:
                    return None
        except StopIteration as end:
            result: Result = end.value
            return result


class Pace:
    """Cuts GPU work of one kind into batches that fit into budgets.

    A batch of n items is taken to cost overhead + n·(marginal cost): a line fitted through the measured batches, older ones with
    exponentially less weight. Where a budget does not even hold the overhead, a batch is as large as makes both terms equal: half
    of its time is then of use. Batches of one size alone do not tell the terms apart: the overhead is then taken to be greater
    after each of them, so that a larger batch is tried before long. A first batch that took far longer than the second is
    forgotten.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self._sums = np.zeros(5)  # weighted, of 1, n, n², t and n·t over the batches of n items in t seconds
        self._cold: float | None = None  # seconds of the first batch, until there is a second one
        self._overhead = 0.0  # of a batch, as the number of items that cost as much

    def _affordable(self, seconds: float) -> float:
        """The estimated size of a batch that takes so many seconds: 1 before anything was measured, infinite for work that takes
        the clock no time."""
        batches, n, _, t, _ = self._sums
        if not batches:
            return 1.0
        return seconds * (n + batches * self._overhead) / t - self._overhead if t > 0.0 else np.inf

    @property
    def _efficient(self) -> float:
        """The size from which a batch spends at least half of its time on items; at most twice the recent mean size."""
        batches, n, *_ = self._sums
        return max(min(self._overhead, 2.0 * n / batches), 1.0) if batches else 1.0

    def _learn(self, count: int, seconds: float, stuck: bool) -> None:
        """Refit the line with a batch of `count` items in `seconds`; stuck: it was as large as time allowed, not as wanted."""
        if not self._sums[0]:
            self._cold = seconds
        elif self._cold is not None:
            if self._cold > _COLD * seconds:
                self._sums[:], self._overhead = 0.0, 0.0
            self._cold = None
        self._sums = _DECAY * self._sums + np.array([1.0, count, count * count, seconds, count * seconds])
        batches, n, nn, t, nt = self._sums
        if t <= 0.0:
            return
        spread, prior, mean = batches * nn - n * n, _PRIOR_VARIANCE * batches * nn, t / n
        marginal = (batches * nt - n * t + prior * t / (n + batches * self._overhead)) / (spread + prior)
        self._overhead = (t / min(max(marginal, _LEAST_MARGINAL_COST * mean), mean) - n) / batches
        if stuck and spread < prior:
            self._overhead += _EXPLORE * (1.0 + self._overhead)

    def batches(self, wanted: int, capacity: int, budget: Budget, rays: int = 0) -> Iterator[int]:
        """Sizes of batches, each at most `capacity`, until all items are done or the budget ends; at least one item, but none
        while input waits.

        The caller does each batch before it takes the next size: the time in between is what a batch costs.
        rays: of an item, for a clock that counts rays.
        """
        done, last = 0, 0
        while done < wanted:
            count = min(wanted - done, capacity)
            if budget.limited and input_waits():
                return
            if budget.limited:
                affordable, efficient, most = self._affordable(budget.left), self._efficient, min(count, 4 * last + _FIRST_STEP)
                if done and affordable < min(efficient, count):
                    return  # the next tick does more in that time
                longest = self._affordable(_LONGEST) if interruptible() else affordable
                count = int(min(most, max(min(affordable, longest), efficient)))
                self.ctx.finish()  # so that earlier draws are not measured as part of this batch
            start = now()
            yield count
            traced(count * rays)
            if budget.limited:
                self.ctx.finish()
                self._learn(count, now() - start, affordable < 2.0 * efficient < most)
            done, last = done + count, count
