"""Ray casting with Embree, by the optional package embreex, on all processors.

The package is imported by RayCaster, so that other ways of gathering work without it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np

from irrsplat.scene.seen_by_light import Holes

INSTALL = "pip install 'irrsplat[embree]'"
_MOST_RAYS = 1 << 16  # rays per call of a thread, about: small enough to share them out evenly
_LEAST_RAYS = 1 << 12  # rays below which the overhead of a call dominates
_LAYERS = 64  # greatest number of holes that a ray passes
_BEHIND = 1e-5  # of the greatest coordinate: how far behind a hole the search continues
_FAR = 1e30  # metres: the end of rays that end nowhere
_PROCESSORS = os.cpu_count() or 1  # the system takes 30 µs to count them


def available() -> bool:
    """True if embreex is installed."""
    return find_spec("embreex") is not None


@cache
def _threads() -> ThreadPoolExecutor:
    """Return the threads of all casters; embreex releases the interpreter lock while it traces."""
    return ThreadPoolExecutor(_PROCESSORS, "irrsplat-rays")


def _rays_per_call(rays: int) -> int:
    """Return the number of rays per call of a thread, of `rays` in all."""
    return min(max(-(-rays // _PROCESSORS), _LEAST_RAYS), _MOST_RAYS)


class RayCaster:
    """A set of triangles in Embree.

    positions: (V, 3) float32, metres; faces: (T, 3) int, their corners. holes: of the last triangles; None: all are whole. apart:
    numbers of whole triangles that are absent until `placed` adds them.
    Results are deterministic. Raises ImportError where embreex is missing.
    """

    def __init__(
        self, positions: np.ndarray, faces: np.ndarray, holes: Holes | None = None, apart: Sequence[int] | np.ndarray = ()
    ) -> None:
        whole = len(faces) if holes is None else holes.first
        self._holes, self._behind = holes, _BEHIND * float(np.abs(positions).max(initial=0.0))
        self._apart = np.asarray(apart, np.intp)
        still = np.delete(np.arange(whole), self._apart)
        self._trees = [(tree, still) for tree in [_tree(positions, faces[still])] if tree is not None]  # with triangle numbers
        self._cut_out = _tree(positions, faces[whole:])

    def placed(self, corners: np.ndarray) -> RayCaster:
        """Return a caster with all triangles, of these `corners` (T, 3, 3); only those `apart` may differ from the first ones."""
        found, points = copy(self), np.ascontiguousarray(corners[self._apart], np.float32).reshape(-1, 3)
        tree = _tree(points, np.arange(len(points)).reshape(-1, 3))
        found._trees = [*self._trees, *([(tree, self._apart)] if tree is not None else [])]
        return found

    def first_hits(self, origins: np.ndarray, frames: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Return (N, R) int32, the first triangle that each of R rays from N places hits, from either side; -1: none.

        origins: (N, 3) metres. frames: (N, 3, 3), rows tangent, bitangent, normal: the space of the `directions` (R, 3), or
        (P, R, 3) that places use in turn.
        """
        directions = np.asarray(directions, np.float32).reshape(-1, *np.shape(directions)[-2:])
        sets, rays_each = directions.shape[:2]
        hits = np.full((len(origins), rays_each), -1, np.int32)
        step = max(sets, _rays_per_call(hits.size) // rays_each // sets * sets)
        origins, frames = (np.asarray(array, np.float32) for array in (origins, frames))

        def trace(some: slice) -> None:
            """Trace the rays of some places."""
            rays = (directions @ frames[some].reshape(-1, sets, 3, 3)).reshape(-1, 3)
            hits[some] = self.run(np.repeat(origins[some], rays_each, axis=0), rays).reshape(-1, rays_each)

        _in_parts(len(origins), step, trace)
        return hits

    def run(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Return (N,) int, the first triangle that each ray hits, -1: none, on the present thread; origins, directions: (N, 3)
        float32."""
        if self._holes is None and len(self._trees) == 1 and not len(self._apart):
            return np.asarray(self._trees[0][0].run(origins, directions))  # takes less time without distances
        found, ends = np.full(len(origins), -1), np.full(len(origins), _FAR, np.float32)
        for tree, numbers in self._trees:
            hit = tree.run(origins, directions, ends.copy(), output=True)  # writes into the last array
            met = np.flatnonzero(hit["primID"] >= 0)
            found[met], ends[met] = numbers[hit["primID"][met]], hit["tfar"][met]
        nearer, _ = self._between_holes(origins, directions, ends)
        return np.where(nearer < 0, found, nearer)

    def _between_holes(self, origins: np.ndarray, directions: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (N,) int, the first cut-out triangle that each ray hits outside of its holes, -1: none; and (N,) float32, where
        it does: at its end for none.

        ends: (N,) float32, of the rays, in lengths of the directions.
        """
        found, at = np.full(len(origins), -1), ends.copy()
        if self._cut_out is None or self._holes is None:
            return found, at
        left = np.flatnonzero(self._cut_out.run(origins, directions, ends.copy()) >= 0)
        origin, way, far = origins[left], directions[left], ends[left]
        for _ in range(_LAYERS):
            if not len(left):
                break
            hit = self._cut_out.run(*(np.array(values, np.float32) for values in (origin, way, far)), output=True)
            met = np.flatnonzero(hit["primID"] >= 0)
            number, u, v = hit["primID"][met] + self._holes.first, hit["u"][met], hit["v"][met]
            passed = self._holes.passed(number, np.stack([1.0 - u - v, u, v], axis=1))
            there = met[~passed]
            found[left[there]], at[left[there]] = number[~passed], ends[left[there]] - far[there] + hit["tfar"][there]
            on = met[passed]
            gone = hit["tfar"][on] + self._behind / np.maximum(np.linalg.norm(way[on], axis=1), 1e-30)
            left = left[on]
            origin, way, far = origin[on] + gone[:, None] * way[on], way[on], far[on] - gone
        return found, at

    def free(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return (N,) bool: True if nothing occludes the segments from `starts` to `ends`, (N, 3) metres each."""
        found = np.ones(len(starts), bool)
        starts, ends = (np.asarray(points, np.float32) for points in (starts, ends))

        def test(some: slice) -> None:
            """Trace some of the segments."""
            start, away, free = starts[some], ends[some] - starts[some], found[some]
            for tree, _ in self._trees:
                free &= tree.run(start, away, np.ones(len(away), np.float32), query="OCCLUDED") < 0  # up to the ends
            if self._cut_out is not None:
                free[free] = self._between_holes(start[free], away[free], np.ones(int(free.sum()), np.float32))[0] < 0

        _in_parts(len(starts), _rays_per_call(len(starts)), test)
        return found

    def reach(self, starts: np.ndarray, ends: np.ndarray, cut_outs: bool = True) -> np.ndarray:
        """Return (N,) float32, the share of segments from `starts` to `ends`, (N, 3) metres each, to the first hit; 1: none.

        cut_outs: False if rays pass all cut-out triangles.
        """
        found = np.ones(len(starts), np.float32)
        starts, ends = (np.asarray(points, np.float32) for points in (starts, ends))

        def trace(some: slice) -> None:
            """Trace some of the segments."""
            start, away = starts[some], ends[some] - starts[some]
            for tree, _ in self._trees:
                found[some] = tree.run(start, away, found[some].copy(), query="DISTANCE")
            if cut_outs and self._cut_out is not None:
                found[some] = self._between_holes(start, away, found[some])[1]

        _in_parts(len(starts), _rays_per_call(len(starts)), trace)
        return found


def _in_parts(count: int, step: int, trace: Callable[[slice], None]) -> None:
    """Call `trace` in several threads, each time for `step` of `count` items."""
    for _ in _threads().map(trace, (slice(first, first + step) for first in range(0, count, step))):
        pass


def _tree(positions: np.ndarray, faces: np.ndarray) -> Any:
    """Return Embree's scene of some triangles; None for no triangle."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore import EmbreeDevice
    from embreex.rtcore_scene import EmbreeScene

    if not len(faces):
        return None
    scene = EmbreeScene(EmbreeDevice(), robust=True)  # robust: no ray passes between two triangles that share an edge
    TriangleMesh(scene, positions, faces)
    scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds the tree
    return scene
