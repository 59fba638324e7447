"""A grid of points for searches near a place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MAX_CELLS = 32  # along an axis
_SAMPLE = 4096  # points in the sample that places the planes


@dataclass(frozen=True)
class Grid:
    """K³ cells between K + 1 planes across each axis, with about equal numbers of points between neighbouring planes.

    Quantiles keep cells fine despite a few distant points.

    edges: (K + 1, 3) float32, the planes' coordinates, ascending. order: (N,) the points' numbers, cell by cell, along x first.
    starts: (K³ + 1,) the start of each cell in `order`. A point on a plane belongs to the cell above it.
    """

    edges: np.ndarray
    order: np.ndarray
    starts: np.ndarray

    @property
    def cells(self) -> int:
        """K."""
        return len(self.edges) - 1

    def find(self, points: np.ndarray) -> np.ndarray:
        """Return (N,) the numbers of the cells of points (N, 3); the outermost cells extend to infinity."""
        x, y, z = (np.searchsorted(e, p, side="right") for e, p in zip(self.edges[1:-1].T, points.T, strict=True))
        cells: np.ndarray = (z * self.cells + y) * self.cells + x
        return cells


def build(points: np.ndarray) -> Grid:
    """Build the grid of points (N, 3) float32, N > 0; K is √N/8, within 1 and MAX_CELLS."""
    count = len(points)
    cells = int(np.clip(np.sqrt(count) / 8.0, 1, MAX_CELLS))
    sample = np.sort(points[:: -(-count // _SAMPLE)], axis=0)
    inner = sample[len(sample) * np.arange(1, cells) // cells]
    edges, empty = np.concatenate([points.min(0)[None], inner, points.max(0)[None]]), np.zeros(0, np.intp)
    cell = Grid(edges, empty, empty).find(points)
    starts = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=cells**3))])
    return Grid(edges, np.argsort(cell, kind="stable"), starts)
