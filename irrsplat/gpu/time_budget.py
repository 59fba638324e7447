"""A tick's time: how much of it is left, and how much work fits into it."""

from __future__ import annotations

import time
from collections.abc import Iterator

import moderngl
import numpy as np

_SHARE = 0.2  # of a tick that gathering may take in any case, so that the picture refines however slow the rest is
_STEP = 64  # things in a tick's first batch at most; one after it has four times as many as the one before, and these
_FORGET = 0.7  # how much an older batch counts of what the one after it does
_ALIKE = 0.05  # variance of the sizes of batches over their mean square, at which they tell as much as was known before
_LEAST = 0.1  # of the mean cost of a thing: what another one in the same batch costs at least
_CURIOUS = 0.1  # of the part that a batch costs by itself: by how much it is taken for greater after one like those before it


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
    that every batch costs and a part for each thing in it (a line through them, of which the older ones count less and less).

    Where a budget does not even hold the first part, a batch is as large as makes both parts equal: it costs twice what a single
    thing would at most, and half of its time is of use. Batches of one size do not tell the parts from each other: the first is
    then taken for greater and greater, so that a larger batch is tried by and by.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self._sums = np.zeros(5)  # of 1, n, n², t and n·t over the batches of n things in t seconds
        self._own = 0.0  # how many things cost as much as the part that every batch costs

    def _fits(self, seconds: float) -> float:
        """How many things a batch of so many seconds holds, as far as is known."""
        one, n, _, t, _ = self._sums
        return seconds * (n + one * self._own) / t - self._own if one else 1.0

    @property
    def _worth(self) -> float:
        """How many things are worth a batch: they double what it costs by itself; at most twice as many as lately."""
        one, n, *_ = self._sums
        return max(min(self._own, 2.0 * n / one), 1.0) if one else 1.0

    def _learn(self, count: int, seconds: float, stuck: bool) -> None:
        """A batch of so many things took so long; stuck: there were more of them, but not the time."""
        self._sums = _FORGET * self._sums + np.array([1.0, count, count * count, seconds, count * seconds])
        one, n, nn, t, nt = self._sums
        spread, known, mean = one * nn - n * n, _ALIKE * one * nn, t / n
        each = (one * nt - n * t + known * t / (n + one * self._own)) / (spread + known)
        self._own = (t / min(max(each, _LEAST * mean), mean) - n) / one
        if stuck and spread < known:
            self._own += _CURIOUS * (1.0 + self._own)

    def batches(self, wanted: int, capacity: int, budget: Budget) -> Iterator[int]:
        """The sizes of the batches, `capacity` at most, in which up to `wanted` things may be done before the budget ends, at
        least one thing."""
        done, last = 0, 0
        while done < wanted:
            count = min(wanted - done, capacity)
            if budget.limited:
                fits, worth, most = self._fits(budget.left), self._worth, min(count, 4 * last + _STEP)
                if done and fits < min(worth, count):
                    return  # the next tick does more in that time
                count = min(most, int(max(fits, worth)))
                self.ctx.finish()  # what was drawn before is not this batch's
            start = time.perf_counter()
            yield count
            if budget.limited:
                self.ctx.finish()
                self._learn(count, time.perf_counter() - start, fits < 2.0 * worth < most)
            done, last = done + count, count
