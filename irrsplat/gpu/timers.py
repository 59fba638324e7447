"""How long each stage takes: by GPU timers on hardware, by wall time between glFinish on a software renderer."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import moderngl


class Timers:
    """Milliseconds per stage name, summed until `clear`. Unless `enabled`, nothing is measured and nothing waits for the GPU."""

    def __init__(self, ctx: moderngl.Context, software: bool, enabled: bool = False) -> None:
        self.ctx = ctx
        self.clock = "wall" if software else "gpu"
        self.enabled = enabled
        self._ms: dict[str, float] = {}
        self._pending: list[tuple[str, moderngl.Query]] = []
        self._spare: list[moderngl.Query] = []

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time what is drawn inside the `with` block under the name `stage`; blocks do not nest."""
        if not self.enabled:
            yield
        elif self.clock == "wall":
            self.ctx.finish()
            start = time.perf_counter()
            yield
            self.ctx.finish()
            self._add(stage, 1e3 * (time.perf_counter() - start))
        else:
            query = self._spare.pop() if self._spare else self.ctx.query(time=True)
            with query:
                yield
            self._pending.append((stage, query))

    def _add(self, stage: str, ms: float) -> None:
        self._ms[stage] = self._ms.get(stage, 0.0) + ms

    def milliseconds(self) -> dict[str, float]:
        """Milliseconds by stage so far, in the order of first use."""
        for stage, query in self._pending:
            self._add(stage, query.elapsed * 1e-6)  # nanoseconds
            self._spare.append(query)
        self._pending.clear()
        return dict(self._ms)

    def clear(self) -> None:
        """Forget all sums."""
        self.milliseconds()
        self._ms.clear()
