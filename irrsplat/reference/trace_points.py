"""Irradiance at given points by path tracing, timed with increasing sample counts, for the benchmark.

Importing this needs the extra `reference`; the benchmark calls `timed` in another process.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import drjit as dr
import numpy as np

from irrsplat.reference.path_tracer import Tracer
from irrsplat.reference.timed_levels import JudgedView, TimedLevels, levels
from irrsplat.scene.model import Scene

_SIDES = (1, 2, 3, 4, 6, 8, 11, 16, 23, 32)  # sides of the stratified grids of a point's samples


def timed(scene: Scene, bounces: int, view: JudgedView, report: Callable[[float], object]) -> TimedLevels:
    """Return times and errors of irradiance with `bounces` at the points of a view."""
    start = time.perf_counter()
    tracer, p, n, g, few = Tracer(scene), view.position, view.normal, view.geometric, slice(0, 256)
    load = time.perf_counter() - start

    def compiled(count: int) -> None:
        tracer.irradiance(p[few], n[few], g[few], round(count**0.5), 1, bounces)

    def irradiance(count: int) -> np.ndarray:
        side = round(count**0.5)
        return tracer.irradiance(p, n, g, side, 1 + side, bounces)  # with new strata

    found = levels(irradiance, [side * side for side in _SIDES], view, report, compiled)
    return {"load": load, "threads": dr.thread_count(), "levels": found}
