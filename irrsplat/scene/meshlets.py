"""Triangles grouped into meshlets of neighbours, so that a gather that draws many views can skip what a view does not see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SIZE = 96  # triangles in a meshlet at most, as long as that makes no more than about MOST meshlets
MOST = 256  # meshlets, about; a view takes at most two draws for each
_MARGIN = 1e-5  # of the largest coordinate: added to a meshlet's box when it is tested, for the rounding of float32
_LARGE = 0.2  # of the bounding box's diagonal: larger triangles get their own meshlets, so as not to enlarge others


@dataclass(frozen=True)
class Meshlets:
    """C meshlets of F triangles.

    order: (F,) the triangles' numbers, meshlet by meshlet. first, count: (C,) where each begins there, and how many it has.
    centre, half: (C, 3) float64 of their bounding boxes, the middle and half the sides.
    """

    order: np.ndarray
    first: np.ndarray
    count: np.ndarray
    centre: np.ndarray
    half: np.ndarray

    def __len__(self) -> int:
        return len(self.first)

    def seen(self, rows: np.ndarray, near: float) -> tuple[np.ndarray, np.ndarray]:
        """Which meshlets may reach into the pyramid |x|, |y| <= w of each view, and which of them lie wholly inside it and beyond
        w = `near`: both (C, …) bool, conservative.

        rows: (…, 3, 4) float64, x, y and w from world, dotted with (p, 1).
        """
        x, y, w = np.moveaxis(rows, -2, 0)
        ahead = w.copy()
        ahead[..., 3] -= near
        sides = np.stack([w - x, w + x, w - y, w + y, ahead]).reshape(-1, 4)
        scale = np.abs(self.centre).max(initial=0.0) + self.half.max(initial=0.0)
        # float32 is enough, with a margin: the shader's own coordinates are no finer
        middle = self.centre.astype("f4") @ sides[:, :3].T.astype("f4") + sides[:, 3].astype("f4")
        reach = (self.half + _MARGIN * scale).astype("f4") @ np.abs(sides[:, :3]).T.astype("f4")
        shape = len(self), 5, *rows.shape[:-2]
        some = (middle >= -reach).reshape(shape)[:, :4].all(1)
        return some, (middle >= reach).reshape(shape).all(1) & some


def cut(corners: np.ndarray) -> Meshlets:
    """The meshlets of triangles (F, 3, 3), reproducibly.

    Groups are split in halves of equal number, along the axis in which the triangles' centres spread most, until they are small.
    """
    a, b, c = corners.swapaxes(0, 1)
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    middle, reach = 0.5 * (low + high), (high - low).max(1, initial=0.0)
    size = max(SIZE, -(-len(corners) // MOST))
    large = reach > _LARGE * np.linalg.norm(np.ptp(middle, axis=0)) if len(corners) else np.zeros(0, bool)
    order, starts = np.zeros(0, np.intp), [np.zeros(0, np.intp)]
    for group in (np.flatnonzero(large), np.flatnonzero(~large)):
        places, begin = _halved(middle[group], size)
        starts.append(len(order) + begin)
        order = np.concatenate([order, group[places]])
    first = np.concatenate(starts)
    if not len(first):
        return Meshlets(order, first, first, np.zeros((0, 3)), np.zeros((0, 3)))
    low, high = np.minimum.reduceat(low[order], first).astype(float), np.maximum.reduceat(high[order], first).astype(float)
    return Meshlets(order, first, np.diff(first, append=len(order)), 0.5 * (low + high), 0.5 * (high - low))


def joined(one: Meshlets, other: Meshlets) -> Meshlets:
    """The meshlets of both, where the triangles of `other` are numbered after those of `one`."""
    order, first = other.order + len(one.order), other.first + len(one.order)
    pairs = (one.order, order), (one.first, first), (one.count, other.count), (one.centre, other.centre), (one.half, other.half)
    return Meshlets(*(np.concatenate(pair) for pair in pairs))


def _halved(points: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """An order of points (N, 3) in runs of at most `size` points that are close together, and where each run begins."""
    order, begin = np.arange(len(points)), np.zeros(min(len(points), 1), np.intp)
    while len(begin) and len(points) > size * len(begin):
        run = np.repeat(np.arange(len(begin)), np.diff(begin, append=len(points)))
        there = points[order]
        spread = np.maximum.reduceat(there, begin) - np.minimum.reduceat(there, begin)
        along = there[np.arange(len(points)), np.argmax(spread, axis=1)[run]]
        order = order[np.lexsort((along, run))]
        begin = np.arange(2 * len(begin)) * len(points) // (2 * len(begin))
    return order, begin
