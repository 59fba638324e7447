"""Measuring planes and lines: a parallelogram in space with the points of a grid, and the points along a straight line."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.vectors import Vector, corners, vector
from irrsplat.scene.model import Scene

MOST_POINTS = 1_000_000
_ROUNDING = 1e-6  # of a cell or a step: a smaller excess over whole ones adds none


@dataclass(frozen=True)
class Grid:
    """The points of a grid: `points` (N, 3) metres, row by row along the first edge; `normals` (N, 3) unit; columns and rows."""

    points: np.ndarray
    normals: np.ndarray
    columns: int
    rows: int


@dataclass(frozen=True)
class Plane:
    """A parallelogram: `corner` and its edges `u` and `v`, (3,) metres, world space, measured from the side of u × v.

    Raises InputError for edges that span no area.
    """

    corner: Vector
    u: Vector
    v: Vector

    def __post_init__(self) -> None:
        if not np.isfinite((self.corner, self.u, self.v)).all():
            raise InputError("a plane's corner and edges must be finite numbers")
        lengths = math.hypot(*self.u) * math.hypot(*self.v)
        if not np.linalg.norm(np.cross(self.u, self.v)) > 1e-9 * lengths:
            raise InputError("the plane's two edges span no area; give edges of some length that are not parallel")

    @property
    def normal(self) -> np.ndarray:
        """(3,) unit."""
        normal = np.cross(self.u, self.v)
        return normal / np.linalg.norm(normal)

    def usual_spacing(self, margin: float = 0.0) -> float:
        """Return the `usual_spacing` of the longer edge, or of the shorter edge of a plane at least twice as long as wide,
        without the margin."""
        short, long = sorted(max(math.hypot(*edge) - 2.0 * margin, 0.0) for edge in (self.u, self.v))
        return usual_spacing(short if long >= 2.0 * short else long)

    def grid(self, spacing: float, margin: float = 0.0) -> Grid:
        """Return the centres of equal cells with sides of at most `spacing` metres.

        margin: metres left out along the edges. Raises InputError for a spacing not above 0, a margin that leaves nothing, and
        more than MOST_POINTS points.
        """
        if not spacing > 0.0:
            raise InputError(f"the grid's spacing is {spacing:g}; it takes metres above 0")
        if not margin >= 0.0:
            raise InputError(f"the margin is {margin:g}; it takes metres, 0 or more")
        corner, edges, counts = np.array(self.corner, float), [], []
        for edge in (np.array(self.u, float), np.array(self.v, float)):
            length = float(np.linalg.norm(edge))
            if length <= 2.0 * margin:
                raise InputError(f"a margin of {margin:g} m leaves nothing of an edge of {length:g} m; give a smaller one")
            corner = corner + edge * (margin / length)
            edges.append(edge * (1.0 - 2.0 * margin / length))
            counts.append(max(1.0, math.ceil((length - 2.0 * margin) / spacing - _ROUNDING)))
        if counts[0] * counts[1] > MOST_POINTS:
            raise InputError(f"the grid would have {counts[0] * counts[1]:.3g} points, at most {MOST_POINTS:,} go; widen it")
        columns, rows = int(counts[0]), int(counts[1])
        s, t = ((np.arange(n) + 0.5) / n for n in (columns, rows))
        points = corner + (s[None, :, None] * edges[0] + t[:, None, None] * edges[1]).reshape(-1, 3)
        return Grid(points, np.tile(self.normal, (len(points), 1)), columns, rows)


def usual_spacing(d: float) -> float:
    """Return the spacing in metres of EN 12464-1 for an area of dimension `d`, metres: 0.2·5^log₁₀(d), at most 10."""
    return min(0.2 * 5.0 ** math.log10(d), 10.0) if d > 0.0 else 10.0


def horizontal(scene: Scene, height: float) -> Plane:
    """Return the level plane `height` metres above the scene's lowest point, over its near bounds, measured from above.

    Raises InputError for a box without horizontal extent.
    """
    up = np.asarray(scene.up, float)
    first = np.eye(3)[np.argmin(np.abs(up))]
    first = first - up * (first @ up)
    first /= np.linalg.norm(first)
    axes = np.stack([first, np.cross(up, first), up])
    along = corners(scene.near_bounds) @ axes.T
    low, extent = along.min(0), np.ptp(along, axis=0)
    low[2] = (scene.corners @ up).min()
    if not extent[:2].min() > 1e-9 * extent.max():
        raise InputError("the scene has no horizontal extent, so there is no level plane to measure")
    corner = vector((low + np.array([0.0, 0.0, height])) @ axes)
    return Plane(corner, vector(axes[0] * extent[0]), vector(axes[1] * extent[1]))


def line_points(start: Vector, end: Vector, spacing: float | None = None) -> tuple[np.ndarray, np.ndarray]:
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
