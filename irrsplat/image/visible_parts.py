"""Frustum and back-face culling of a g-buffer's triangles, by parts of meshes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from irrsplat.gpu.program import Draw
from irrsplat.scene.looks import in_order
from irrsplat.scene.model import Scene
from irrsplat.scene.seen_by_light import CLOSED, sort_of

_MOST = 4096  # triangles per part
_SLACK = 1e-4  # of the far distance: more than rounding

Sides = Literal["back"] | None  # culled sides


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
        planes = np.stack([w + x, w - x, w + y, w - y, w])
        farthest = np.where(planes[:, None, :3] > 0.0, self.high, self.low)  # corner of each box farthest inward of each plane
        seen = ((farthest * planes[:, None, :3]).sum(-1) + planes[:, 3:] >= -_SLACK * far).all(0)
        slack = _SLACK * far
        outside = ((eye < self.inner_low - slack) | (eye > self.inner_high + slack)).any(1)
        return np.where(seen, np.where(outside, 1, 2), 0)

    def draws(self, draws: Sequence[Draw], sides: np.ndarray, cull: Sides) -> Iterator[tuple[Sides, list[Draw]]]:
        """Yield the culled side and the draws with it, without invisible parts, in the same order.

        sides: from `sides`. cull: side culled in any case.
        """
        now: Sides = None
        kept: list[Draw] = []
        for draw in draws:
            begin, end = np.searchsorted(self.first, (draw.first // 3, (draw.first + draw.count) // 3))
            here = sides[begin:end]
            edges = [0, *(np.flatnonzero(np.diff(here)) + 1).tolist(), len(here)]
            for a, b in pairwise(edges):
                if here[a] == 0:
                    continue
                culled: Sides = "back" if here[a] == 1 else cull
                if culled != now and kept:
                    yield now, kept
                    kept = []
                now = culled
                first, last = int(self.first[begin + a]), int(self.first[begin + b])
                uniforms = {**draw.uniforms, "first_triangle": first}
                kept.append(replace(draw, first=3 * first, count=3 * (last - first), uniforms=uniforms))
        if kept:
            yield now, kept
