"""Frame budgets: the time left in a frame, and the size of GPU batches that fit into it."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import TypeVar

import moderngl
import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.timing.clock import now, traced
from irrsplat.core.timing.input_waits import input_waits, interruptible

Result = TypeVar("Result")

HALF = 0.5  # of a budget: for each kind of work before another kind that waits
_GATHER_SHARE = 0.2  # of a frame: the least share of gathering, so that a view refines even if other stages are slow
_STEP_RAYS = 262_144  # rays of the largest first batch of a frame; each further batch has at most four times as many items more
_STEP = 64  # items of that batch at least
_LONGEST = 0.03  # seconds: longest batch while input may arrive
_DECAY = 0.7  # weight of a measured batch relative to the one after it
_PRIOR_VARIANCE = 0.05  # relative variance of batch sizes at which new measurements weigh as much as the present estimate
_LEAST_MARGINAL_COST = 0.1  # of an item's mean cost: least assumed cost of one more item in a batch
_COLD = 4.0  # times the second batch: a slower first batch included compilation and is discarded
_FIRST_RAYS = 16_384  # rays of the first batch of all, which takes a few milliseconds
_EXPLORE = 0.1  # relative growth of the estimated overhead while all batches have equal size


class Budget:
    """The time of one frame: `Budget(0.09)` ends 90 ms from now; `Budget(None)` never does.

    tick: seconds of the whole frame, if this budget is a part of it. Raises InputError if `seconds` is not a number.
    """

    def __init__(self, seconds: float | None, tick: float | None = None) -> None:
        if seconds is not None and not (isinstance(seconds, (int, float, np.number)) and seconds == seconds):
            raise InputError(f"seconds is a number, or None for no limit, not {seconds!r:.60}")
        self.seconds = seconds
        self.tick = seconds if tick is None else tick
        self.end = float("inf") if seconds is None else now() + seconds

    @property
    def limited(self) -> bool:
        """True if the budget ends."""
        return self.seconds is not None

    @property
    def left(self) -> float:
        """Seconds to the end, negative after it; -inf for a limited budget while input waits."""
        return float("-inf") if self.limited and input_waits() else self.end - now()

    def part(self, share: float, reserve: float, least: float = 0.0) -> Budget:
        """Return a budget of `share` of the time left after `reserve` seconds, at least 20 % of this budget and `least` of the
        whole frame."""
        if self.seconds is None or self.tick is None:
            return self
        return Budget(max(share * (self.end - now() - reserve), _GATHER_SHARE * self.seconds, least * self.tick), self.tick)

    def advance(self, work: Generator[object, None, Result]) -> Result | None:
        """Advance `work` until the budget ends or a step yields True; return its result, or None if it is unfinished."""
        try:
            while not next(work) and self.left > 0.0:
                pass
            return None
        except StopIteration as end:
            result: Result = end.value
            return result


class Pace:
    """Splits GPU work of one kind into batches that fit into budgets.

    The model is cost = overhead + n·(marginal cost) for n items: a line fitted to the measured batches with exponentially
    decaying weights. If a budget is smaller than the overhead, the batch is large enough that both terms are equal: half of its
    time is useful. Batches of one size do not separate the terms, so the overhead estimate grows after each until a larger batch
    is tried. A first batch that took much longer than the second is discarded. The first batch has _FIRST_RAYS: a batch of one
    item would measure its overhead alone.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self._sums = np.zeros(5)  # weighted sums of 1, n, n², t and n·t over the batches of n items in t seconds
        self._cold: float | None = None  # seconds of the first batch, until the second is measured
        self._overhead = 0.0  # of a batch, in items of equal cost

    def _affordable(self, seconds: float) -> float:
        """Return the estimated batch size for these seconds: the overhead in items before the first measurement, infinite if the
        clock measures no time."""
        batches, n, _, t, _ = self._sums
        if not batches:
            return max(self._overhead, 1.0)
        return seconds * (n + batches * self._overhead) / t - self._overhead if t > 0.0 else np.inf

    @property
    def _efficient(self) -> float:
        """Smallest batch size that spends half of its time on items; at most twice the recent mean size."""
        batches, n, *_ = self._sums
        return max(min(self._overhead, 2.0 * n / batches), 1.0) if batches else 1.0

    def _fit(self, count: int, seconds: float, stuck: bool) -> None:
        """Refit the line with a batch of `count` items in `seconds`; stuck: time, not demand, limited its size."""
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

    def batches(self, requested: int, capacity: int, budget: Budget, rays: int = 0) -> Iterator[slice]:
        """Yield batches of at most `capacity` items until all are done or the budget ends.

        There is at least one item, but none while input waits. The caller processes each batch before it takes the next one; the
        time in between is the batch's cost. rays: per item, for a clock that counts rays.
        """
        done, last, step = 0, 0, max(_STEP, _STEP_RAYS // max(rays, 1) if rays else 0)
        if not self._sums[0] and rays:
            self._overhead = _FIRST_RAYS / rays
        while done < requested:
            count = min(requested - done, capacity)
            if budget.limited and input_waits():
                return
            if budget.limited:
                affordable, efficient, most = self._affordable(budget.left), self._efficient, min(count, 4 * last + step)
                if done and affordable < min(efficient, count):
                    return  # the next frame uses that time better
                longest = self._affordable(_LONGEST) if interruptible() else affordable
                count = int(min(most, max(min(affordable, longest), efficient)))
                self.ctx.finish()  # exclude earlier draws from the measurement
            start = now()
            yield slice(done, done + count)
            traced(count * rays)
            if budget.limited:
                self.ctx.finish()
                self._fit(count, now() - start, affordable < 2.0 * efficient < most)
            done, last = done + count, count
