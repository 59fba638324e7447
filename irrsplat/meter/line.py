"""Measuring lines: points along a straight line in space."""

from __future__ import annotations

import math

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.meter.plane import MOST_POINTS, usual_spacing

_ROUNDING = 1e-6  # of a step: a smaller excess over whole steps adds no point


def line_points(
    start: tuple[float, float, float], end: tuple[float, float, float], spacing: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, 3) equidistant points from `start` to `end` at most `spacing` metres apart, and (N,) their metres from `start`.

    spacing: None for that of EN 12464-1. Raises InputError for coincident ends, a spacing not above 0, and more than MOST_POINTS
    points.
    """
    length = math.dist(start, end)
    if not length > 0.0:
        raise InputError("the line's two ends are one point; give two")
    spacing = usual_spacing(length) if spacing is None else spacing
    if not spacing > 0.0:
        raise InputError(f"the line's spacing is {spacing:g}; it takes metres above 0")
    steps = max(math.ceil(length / spacing - _ROUNDING), 1.0)
    if steps + 1.0 > MOST_POINTS:
        raise InputError(f"the line would have {steps + 1.0:.3g} points, at most {MOST_POINTS:,} go; widen the grid")
    share = np.linspace(0.0, 1.0, int(steps) + 1)
    return np.array(start, float) + share[:, None] * np.subtract(end, start, dtype=float), share * length
