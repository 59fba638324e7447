"""Ray casting with Embree, by the optional package embreex, on all processors.

The package is imported by RayCaster, so that other ways of gathering work without it.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib.util import find_spec

import numpy as np

INSTALL = "pip install 'irrsplat[embree]'"
_MOST_RAYS = 1 << 16  # rays per call of a thread, about: small enough to share them out evenly
_LEAST_RAYS = 1 << 12  # rays below which the overhead of a call dominates


def available() -> bool:
    """True if embreex is installed."""
    return find_spec("embreex") is not None


@cache
def _threads() -> ThreadPoolExecutor:
    """Return the threads of all casters; embreex releases the interpreter lock while it traces."""
    return ThreadPoolExecutor(_processors(), "irrsplat-rays")


@cache
def _processors() -> int:
    """Return the number of processors; the system takes 30 µs to count them."""
    return os.cpu_count() or 1


def _rays_per_call(rays: int) -> int:
    """Return the number of rays per call of a thread, of `rays` in all."""
    return min(max(-(-rays // _processors()), _LEAST_RAYS), _MOST_RAYS)


class RayCaster:
    """A set of triangles in Embree.

    positions: (V, 3) float32, metres; faces: (T, 3) int, their corners. Results are deterministic. Raises ImportError where
    embreex is missing.
    """

    def __init__(self, positions: np.ndarray, faces: np.ndarray) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore import EmbreeDevice
        from embreex.rtcore_scene import EmbreeScene

        # robust: no ray passes between two triangles that share an edge
        self._scene = EmbreeScene(EmbreeDevice(), robust=True) if len(faces) else None
        if self._scene is not None:
            TriangleMesh(self._scene, positions, faces)
            self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds the tree

    def first_hits(self, origins: np.ndarray, frames: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Return (N, R) int32, the first triangle that each of R rays from N places hits, from either side; -1: none.

        origins: (N, 3) metres. frames: (N, 3, 3), rows tangent, bitangent, normal: the space of the `directions` (R, 3), or
        (P, R, 3) that places use in turn.
        """
        directions = np.asarray(directions, np.float32).reshape(-1, *np.shape(directions)[-2:])
        sets, rays_each = directions.shape[:2]
        hits = np.full((len(origins), rays_each), -1, np.int32)
        scene, step = self._scene, max(sets, _rays_per_call(hits.size) // rays_each // sets * sets)
        if scene is None:
            return hits
        origins, frames = (np.asarray(array, np.float32) for array in (origins, frames))

        def trace(first: int) -> None:
            """Trace the rays of `step` places from `first` on."""
            chunk = slice(first, first + step)
            rays = (directions @ frames[chunk].reshape(-1, sets, 3, 3)).reshape(-1, 3)
            hits[chunk] = scene.run(np.repeat(origins[chunk], rays_each, axis=0), rays).reshape(-1, rays_each)

        for _ in _threads().map(trace, range(0, len(origins), step)):
            pass
        return hits

    def run(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Return (N,) int, the first triangle that each ray hits, -1: none, on the present thread; origins, directions: (N, 3)
        float32."""
        none = np.full(len(origins), -1)
        return none if self._scene is None else np.asarray(self._scene.run(origins, directions))

    def free(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return (N,) bool: True if nothing occludes the segments from `starts` to `ends`, (N, 3) metres each."""
        scene, found, step = self._scene, np.ones(len(starts), bool), _rays_per_call(len(starts))
        if scene is None:
            return found
        starts, ends = (np.asarray(points, np.float32) for points in (starts, ends))

        def test(first: int) -> None:
            """Trace `step` segments from `first` on."""
            chunk = slice(first, first + step)
            away = ends[chunk] - starts[chunk]
            hits = scene.run(starts[chunk], away, np.ones(len(away), np.float32), query="OCCLUDED")  # up to the ends
            found[chunk] = hits < 0

        for _ in _threads().map(test, range(0, len(starts), step)):
            pass
        return found
