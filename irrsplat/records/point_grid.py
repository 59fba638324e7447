"""Points sorted into cells by place, so that those near a place are found without looking at all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MOST = 32  # cells along an axis
_SAMPLE = 4096  # points by which cells are cut


@dataclass(frozen=True)
class Grid:
    """K³ cells between planes along each axis, about as many points between any two of them: far-off places do not coarsen it.

    edges: (K + 1, 3) float32 ascending, from the least coordinates to the greatest. order: (N,) the points' numbers cell by cell,
    x first. starts: (K³ + 1,) where in it each cell begins, whose x is the number of inner edges that are not beyond its points.
    """

    edges: np.ndarray
    order: np.ndarray
    starts: np.ndarray

    @property
    def cells(self) -> int:
        """K."""
        return len(self.edges) - 1

    def find(self, points: np.ndarray) -> np.ndarray:
        """(N,) the numbers of the cells in which points (N, 3) lie, those beyond the grid in its outermost ones."""
        x, y, z = (np.searchsorted(e, p, side="right") for e, p in zip(self.edges[1:-1].T, points.T, strict=True))
        return (z * self.cells + y) * self.cells + x


def build(points: np.ndarray) -> Grid:
    """The grid of points (N, 3) float32, N > 0; the more of them, the finer."""
    count = len(points)
    cells = int(np.clip(np.sqrt(count) / 8.0, 1, MOST))
    sample = np.sort(points[:: -(-count // _SAMPLE)], axis=0)
    inner = sample[len(sample) * np.arange(1, cells) // cells]
    edges, empty = np.concatenate([points.min(0)[None], inner, points.max(0)[None]]), np.zeros(0, np.intp)
    cell = Grid(edges, empty, empty).find(points)
    starts = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=cells**3))])
    return Grid(edges, np.argsort(cell, kind="stable"), starts)
