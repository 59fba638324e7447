"""Times of stages: by GPU timers on hardware, by wall time between glFinish on a software renderer."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import cast

import moderngl


class Timers:
    """Milliseconds per stage name, summed until `clear`. Measures nothing, and never waits for the GPU, unless `enabled`."""

    def __init__(self, ctx: moderngl.Context, software: bool, enabled: bool = False) -> None:
        self.ctx = ctx
        self.clock = "wall" if software else "gpu"
        self.enabled = enabled
        self._ms: dict[str, float] = {}
        self._stage: str | None = None  # the stage being timed
        self._since = 0.0  # seconds
        self._running = ExitStack()  # of the running query, if any
        self._pending: list[tuple[str, moderngl.Query]] = []
        self._spare: list[moderngl.Query] = []

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time the draws inside the `with` block as `stage`. A nested block counts for its own stage only."""
        if not self.enabled:
            yield
            return
        outer = self._stage
        self._count_for(stage)
        try:
            yield
        finally:
            self._count_for(outer)

    def _count_for(self, stage: str | None) -> None:
        """Count further draws for `stage`. (OpenGL runs one timer at a time.)"""
        if self.clock == "wall":
            self.ctx.finish()
            now = time.perf_counter()
            if self._stage is not None:
                self._add(self._stage, 1e3 * (now - self._since))
            self._since = now
        else:
            self._running.close()
            if stage is not None:
                query = self._spare.pop() if self._spare else self.ctx.query(time=True)
                self._running.callback(self._pending.append, (stage, query))  # when it has ended
                self._running.enter_context(cast(AbstractContextManager[object], query))
        self._stage = stage

    def _add(self, stage: str, ms: float) -> None:
        self._ms[stage] = self._ms.get(stage, 0.0) + ms

    def milliseconds(self) -> dict[str, float]:
        """Return milliseconds by stage, in the order of first use."""
        for stage, query in self._pending:
            self._add(stage, query.elapsed * 1e-6)  # nanoseconds
            self._spare.append(query)
        self._pending.clear()
        return dict(self._ms)

    def clear(self) -> None:
        """Reset all sums."""
        self.milliseconds()
        self._ms.clear()
