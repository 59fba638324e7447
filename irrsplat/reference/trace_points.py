"""Irradiance at given points by path tracing, timed with increasing sample counts, for the benchmark.

Importing this needs the extra `reference`; the benchmark calls `timed` in another process.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypedDict

import drjit as dr
import numpy as np

from irrsplat.reference.path_tracer import Tracer
from irrsplat.scene.model import Scene

_SIDES = (1, 2, 3, 4, 6, 8, 11, 16, 23, 32)  # sides of the stratified grids of a point's samples


class TimedLevels(TypedDict):
    """load: seconds until the scene can be traced. levels: for each filter ("": none) samples per point, processor
    time in seconds and relative RMSE, without compilation."""

    load: float
    threads: int
    levels: dict[str, list[tuple[int, float, float]]]


def timed(
    scene: Scene,
    points: tuple[np.ndarray, np.ndarray, np.ndarray],
    judged: np.ndarray,
    truth: np.ndarray,
    bounces: int,
    enough: float,
    seconds: float,
    mask: np.ndarray,
    filters: Sequence[str],
    report: Callable[[float], object],
) -> TimedLevels:
    """Return times and errors of irradiance with `bounces` at `points`, (N, 3) each: positions, shading and geometric normals.

    judged: (M,) numbers of the points with reference irradiance `truth` (M, 3). Ends at a relative RMSE of at most `enough`, or
    after `seconds` of processor time. mask: (H, W) bool, the N pixels of the points. filters: qualities of Open Image Denoise
    ("fast", "high"), each of which filters the picture of every level as well.
    """
    start = time.perf_counter()
    tracer, (p, n, g), few = Tracer(scene), points, slice(0, 256)
    filtered = {"": lambda E: E} | {quality: partial(_denoised, mask, points[1], quality) for quality in filters}
    for smooth in filtered.values():
        smooth(np.zeros((len(points[0]), 3)))  # loads its weights
    load = time.perf_counter() - start
    found: dict[str, list[tuple[int, float, float]]] = {name: [] for name in filtered}
    for side in _SIDES:
        tracer.irradiance(p[few], n[few], g[few], side, 1, bounces)  # compiles
        start = time.process_time()
        E = tracer.irradiance(p, n, g, side, 1 + side, bounces)  # with new strata
        traced = time.process_time() - start
        for name, smooth in filtered.items():
            begun = time.process_time()
            off = smooth(E)[judged] - truth
            took = traced + time.process_time() - begun
            found[name].append((side * side, took, float(np.sqrt(np.mean(off**2)) / truth.mean())))
        report(min(traced / seconds, 1.0))
        if found[""][-1][2] <= enough or traced >= seconds:
            break
    return {"load": load, "threads": dr.thread_count(), "levels": found}


def _denoised(mask: np.ndarray, normal: np.ndarray, quality: str, E: np.ndarray) -> np.ndarray:
    """Return irradiance (N, 3) at the N pixels of the mask (H, W), filtered by Open Image Denoise with the normals (N, 3)."""
    import pyoidn

    pictures = np.zeros((3, *mask.shape, 3), np.float32)
    for picture, values in zip(pictures, (np.maximum(E, 0.0), np.ones_like(normal), normal), strict=True):
        picture[mask] = values
    color, albedo, normals = pictures
    found: np.ndarray = pyoidn.denoise(color, albedo, normals, hdr=True, clean_aux=True, quality=quality)[mask].astype(float)
    return found
