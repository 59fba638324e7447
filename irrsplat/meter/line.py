"""Measuring lines: a straight line in space, and points along it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.meter.plane import MOST_POINTS, usual_spacing

_ROUNDING = 1e-6  # of a step: a smaller excess over whole steps adds no point


@dataclass(frozen=True)
class Line:
    """From `start` to `end`, (3,) metres, world space. Raises InputError for coincident ends."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not np.isfinite((self.start, self.end)).all():
            raise InputError("a line's two ends must be finite numbers")
        if not self.length > 0.0:
            raise InputError("the line's two ends are one point; give two")

    @property
    def length(self) -> float:
        """Metres."""
        return math.dist(self.start, self.end)

    def usual_spacing(self) -> float:
        """Return the metres between points of EN 12464-1 for an area of this length."""
        return usual_spacing(self.length)

    def points(self, spacing: float) -> tuple[np.ndarray, np.ndarray]:
        """Return (N, 3) equidistant points at most `spacing` metres apart, with both ends; and (N,) their distances from `start`,
        metres.

        Raises InputError for a spacing not above 0, and more than MOST_POINTS points.
        """
        if not spacing > 0.0:
            raise InputError(f"the line's spacing is {spacing:g}; it takes metres above 0")
        steps = max(math.ceil(self.length / spacing - _ROUNDING), 1.0)
        if steps + 1.0 > MOST_POINTS:
            raise InputError(f"the line would have {steps + 1.0:.3g} points, at most {MOST_POINTS:,} go; widen the grid")
        share = np.linspace(0.0, 1.0, int(steps) + 1)
        start, end = np.array(self.start, float), np.array(self.end, float)
        return start + share[:, None] * (end - start), share * self.length
