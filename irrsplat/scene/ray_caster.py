"""Embree by the package embreex, where that is installed: which triangle a ray hits first, found on all processors.

It is imported where a caster is made: without it all other ways of gathering go on.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib.util import find_spec

import numpy as np

INSTALL = "pip install 'irrsplat[embree]'"
_MOST = 1 << 16  # rays that a thread traces in one go, about: few enough to share them out evenly
_LEAST = 1 << 12  # below that, going about it takes as long


def available() -> bool:
    """Whether embreex is installed."""
    return find_spec("embreex") is not None


@cache
def _threads() -> ThreadPoolExecutor:
    """Threads for all casters; embreex lets go of the interpreter while it traces."""
    return ThreadPoolExecutor(os.cpu_count(), "irrsplat-rays")


def _task(rays: int) -> int:
    """How many of so many `rays` a thread traces in one go."""
    return min(max(-(-rays // (os.cpu_count() or 1)), _LEAST), _MOST)


class RayCaster:
    """A set of triangles as Embree keeps it.

    positions: (V, 3) float32, metres; faces: (T, 3) int, their corners. The same triangles make the same caster, and the same
    rays hit the same triangles. Raises ImportError where embreex is missing.
    """

    def __init__(self, positions: np.ndarray, faces: np.ndarray) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore import EmbreeDevice
        from embreex.rtcore_scene import EmbreeScene

        # robust: no ray passes between two triangles that share an edge
        self._scene = EmbreeScene(EmbreeDevice(), robust=True) if len(faces) else None
        if self._scene is not None:
            TriangleMesh(self._scene, positions, faces)
            self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds its tree

    def first_hits(self, origins: np.ndarray, frames: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(N, R) int32, the numbers of the triangles that R rays from each of N places hit first, from either side; -1: none.

        origins: (N, 3) metres. frames: (N, 3, 3), rows tangent, bitangent, normal, in which the `directions` (R, 3) are given.
        """
        hits = np.full((len(origins), len(directions)), -1, np.int32)
        scene, step = self._scene, max(1, _task(hits.size) // len(directions))
        if scene is None:
            return hits
        origins, frames, directions = (np.asarray(array, np.float32) for array in (origins, frames, directions))

        def trace(first: int) -> None:
            """The hits of the `step` places from there on."""
            some = slice(first, first + step)
            rays = (directions @ frames[some]).reshape(-1, 3)
            hits[some] = scene.run(np.repeat(origins[some], len(directions), axis=0), rays).reshape(-1, len(directions))

        for _ in _threads().map(trace, range(0, len(origins), step)):
            pass
        return hits

    def free(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """(N,) whether nothing stands between points (N, 3) and others (N, 3), metres."""
        scene, found, step = self._scene, np.ones(len(starts), bool), _task(len(starts))
        if scene is None:
            return found
        starts, ends = (np.asarray(points, np.float32) for points in (starts, ends))

        def look(first: int) -> None:
            """Along the lines from there on."""
            some = slice(first, first + step)
            away = ends[some] - starts[some]
            hits = scene.run(starts[some], away, np.ones(len(away), np.float32), query="OCCLUDED")  # up to their ends
            found[some] = hits < 0

        for _ in _threads().map(look, range(0, len(starts), step)):
            pass
        return found
