"""A tick's time: how much of it is left, and how much work fits into it."""

from __future__ import annotations

import time
from collections.abc import Iterator

import moderngl
import numpy as np

_SHARE = 0.2  # of a tick that gathering may take in any case, so that the picture refines however slow the rest is
_FIRST = 8  # things in the first batch of all
_FORGET = 0.5  # how much an older batch counts of what the one after it does
_ALIKE = 1e-3  # variance of the sizes of batches over their mean square, below which they tell nothing of the parts
_LEAST = 0.1  # of the mean cost of a thing: what another one in the same batch costs at least


class Budget:
    """The time of one tick: `Budget(0.09)` ends 90 ms from now; `Budget(None)` never does."""

    def __init__(self, seconds: float | None) -> None:
        self.seconds = seconds
        self.end = float("inf") if seconds is None else time.perf_counter() + seconds

    @property
    def limited(self) -> bool:
        """Whether there is an end at all."""
        return self.seconds is not None

    @property
    def left(self) -> float:
        """Seconds to the end; below 0 after it."""
        return self.end - time.perf_counter()

    def part(self, share: float, reserve: float) -> Budget:
        """This `share` of what is left once `reserve` seconds are kept back, but at least _SHARE of the whole tick."""
        if self.seconds is None:
            return self
        return Budget(max(share * (self.left - reserve), _SHARE * self.seconds))


class Pace:
    """Cuts work of one kind on the GPU into batches that fit into budgets: what a batch costs is told by those before, a part
    that every batch costs and a part for each thing in it (a line through them, of which the older ones count less and less)."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self._sums = np.zeros(5)  # of 1, n, n², t and n·t over the batches of n things in t seconds

    def _fits(self, seconds: float) -> int:
        """How many things a batch of so many seconds holds, as far as is known."""
        one, n, nn, t, nt = self._sums
        if not one:
            return _FIRST
        spread, mean = one * nn - n * n, t / n
        each = 0.5 * mean  # as long as batches do not differ in size
        if spread > _ALIKE * one * nn:
            each = min(max((one * nt - n * t) / spread, _LEAST * mean), mean)
        return int((seconds - (t - each * n) / one) / each)

    def batches(self, wanted: int, capacity: int, budget: Budget) -> Iterator[int]:
        """The sizes of the batches, `capacity` at most, in which up to `wanted` things may be done before the budget ends, at
        least one thing."""
        done, last = 0, 0
        while done < wanted:
            count = min(wanted - done, capacity)
            if budget.limited:
                fits = self._fits(budget.left)
                if fits < 1 and done:
                    return
                count = min(count, max(fits, 1), 4 * last + 64)
                self.ctx.finish()  # what was drawn before is not this batch's
            start = time.perf_counter()
            yield count
            if budget.limited:
                self.ctx.finish()
                seconds = time.perf_counter() - start
                self._sums = _FORGET * self._sums + np.array([1.0, count, count * count, seconds, count * seconds])
            done, last = done + count, count
