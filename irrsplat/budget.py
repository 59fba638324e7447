"""A tick's time: how much of it is left, and how much work fits into it."""

from __future__ import annotations

import time
from collections.abc import Iterator

import moderngl

_SHARE = 0.1  # of a tick that gathering may take in any case, so that the picture refines however slow the rest is


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
    """Cuts work of one kind on the GPU into batches that fit into budgets: what a thing costs is told by the batch before."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self._cost: float | None = None  # seconds a thing

    def batches(self, wanted: int, capacity: int, budget: Budget) -> Iterator[int]:
        """The sizes of the batches, `capacity` at most, in which up to `wanted` things may be done before the budget ends, at
        least one thing. The first of all is small."""
        done, last = 0, 0
        while done < wanted:
            count = min(wanted - done, capacity)
            if budget.limited:
                fits = int(budget.left / self._cost) if self._cost else 8
                if fits < 1 and done:
                    return
                count = min(count, max(fits, 1), 4 * last + 64)
            start = time.perf_counter()
            yield count
            if budget.limited:
                self.ctx.finish()
                self._cost = (time.perf_counter() - start) / count
            done, last = done + count, count
