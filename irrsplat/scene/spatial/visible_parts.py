"""Frustum and back-face culling of triangles by parts of meshes, for g-buffers and shadow maps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from irrsplat.scene.appearance import in_order
from irrsplat.scene.model import Scene
from irrsplat.scene.seen_by_light import CLOSED, sort_of

_MOST = 4096  # triangles per part
_SLACK = 1e-4  # of the far distance: more than rounding


@dataclass(frozen=True, eq=False)
class SceneParts:
    """All triangles of a scene in the order of their numbers, in N parts of one mesh and at most _MOST triangles each.

    first: (N + 1,) number of each part's first triangle, and the total. low, high: (N, 3) bounding boxes of the parts. inner_low,
    inner_high: (N, 3) bounding boxes of closed meshes, else of all space; from outside, no back face is visible.
    """

    first: np.ndarray
    low: np.ndarray
    high: np.ndarray
    inner_low: np.ndarray
    inner_high: np.ndarray

    @staticmethod
    def of(scene: Scene) -> SceneParts:
        """Return the parts of a scene."""
        first, boxes = [np.zeros(1, int)], [np.zeros((0, 4, 3))]
        for mesh in in_order(scene):
            count = len(mesh.faces)
            if not count:
                continue
            starts, corners = np.arange(0, count, _MOST), mesh.positions.T[:, mesh.faces.ravel()]  # (3, 3 F)
            low, high = (extreme.reduceat(corners, 3 * starts, axis=1).T for extreme in (np.minimum, np.maximum))
            closed = mesh.closed and sort_of(mesh) == CLOSED
            inner = np.stack([low.min(0), high.max(0)]) if closed else np.array([[-np.inf] * 3, [np.inf] * 3])
            boxes.append(np.concatenate([np.stack([low, high], 1), np.tile(inner, (len(low), 1, 1))], 1))
            first.append(first[-1][-1] + np.append(starts[1:], count))
        low, high, inner_low, inner_high = np.concatenate(boxes).swapaxes(0, 1)
        return SceneParts(np.concatenate(first), low, high, inner_low, inner_high)

    def sides(self, clip_from_world: np.ndarray, eye: np.ndarray, far: float) -> np.ndarray:
        """Return (N,) 0 for parts outside the view, 1 for parts with visible front faces only, 2 for all others.

        clip_from_world: (4, 4). eye: (3,). far: beyond the whole scene, metres.
        """
        x, y, _, w = clip_from_world
        slack = _SLACK * far
        outside = ((eye < self.inner_low - slack) | (eye > self.inner_high + slack)).any(1)
        return np.where(self.seen(x, y, w, far), np.where(outside, 1, 2), 0)

    def seen(self, x: np.ndarray, y: np.ndarray, w: np.ndarray, far: float) -> np.ndarray:
        """Return (N,) True for parts that may lie within -w <= x, y <= w and 0 <= w; all (4,), dotted with (p, 1).

        far: metres, the scale of rounding.
        """
        planes = np.stack([w + x, w - x, w + y, w - y, w])
        farthest = np.where(planes[:, None, :3] > 0.0, self.high, self.low)  # corner of each box farthest inward of each plane
        return np.asarray(((farthest * planes[:, None, :3]).sum(-1) + planes[:, 3:] >= -_SLACK * far).all(0))

    def runs(self, first: int, count: int, kinds: np.ndarray) -> Iterator[tuple[int, int, int]]:
        """Yield the kind, the first triangle and the number of triangles of successive parts of one kind.

        first, count: the triangles to go through, whole parts. kinds: (N,) of all parts; those of kind 0 are left out.
        """
        begin, end = np.searchsorted(self.first, (first, first + count))
        here = kinds[begin:end].astype(int)
        edges = [0, *(np.flatnonzero(np.diff(here)) + 1).tolist(), len(here)]
        for a, b in pairwise(edges):
            if a < b and here[a]:
                low, high = int(self.first[begin + a]), int(self.first[begin + b])
                yield int(here[a]), low, high - low
