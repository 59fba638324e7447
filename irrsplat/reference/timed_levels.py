"""Time and error of irradiance by rising sample counts, with and without Open Image Denoise, for the benchmark."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from irrsplat.scene.model import Camera

if TYPE_CHECKING:
    from irrsplat.reference.fine_gather import Truth

FILTERS = ("fast", "high")  # qualities of Open Image Denoise (pyoidn)
ENOUGH = 0.02  # relative RMSE below which refinement ends
SECONDS = 120.0  # time limit for starting a finer measurement; a quarter of it where further views take as long


class TimedLevels(TypedDict):
    """load: seconds until the scene can be traced. levels: for each filter ("": none) samples per point, processor
    time in seconds and relative RMSE, without compilation."""

    load: float
    threads: int
    levels: dict[str, list[tuple[int, float, float]]]


@dataclass(frozen=True)
class JudgedView:
    """Visible points of a camera with reference irradiance.

    Points (N, 3) with shading and geometric normals; indices (M,) of the compared points; the reference there (M, 3) in W/m²,
    with pixels as in `fine_gather.Truth`. mask: (H, W) bool, the pixels of the points, row by row.
    """

    camera: Camera
    position: np.ndarray
    normal: np.ndarray
    geometric: np.ndarray
    judged: np.ndarray
    truth: Truth
    mask: np.ndarray

    def error(self, E: np.ndarray) -> float:
        """Return the relative RMSE of irradiance (N, 3) at the compared points."""
        off = E[self.judged] - self.truth.irradiance
        return float(np.sqrt(np.mean(off**2)) / self.truth.irradiance.mean(dtype=float))


def levels(
    irradiance: Callable[[int], np.ndarray],
    counts: Sequence[int],
    view: JudgedView,
    report: Callable[[float], object],
    prepare: Callable[[int], object] | None = None,
) -> dict[str, list[tuple[int, float, float]]]:
    """Return the levels of an `irradiance` (N, 3) by sample counts, see TimedLevels, unfiltered and with each filter.

    report: called with the share done, 0..1. prepare: called with each count before its time begins.
    """
    filters = FILTERS if importlib.util.find_spec("pyoidn") is not None else ()
    filtered = {"": lambda E: E} | {quality: partial(denoised, view.mask, view.normal, quality) for quality in filters}
    for smooth in filtered.values():
        smooth(np.zeros((len(view.normal), 3)))  # loads its weights
    found: dict[str, list[tuple[int, float, float]]] = {name: [] for name in filtered}
    for count in counts:
        if prepare is not None:
            prepare(count)
        start = time.process_time()
        E = irradiance(count)
        traced = time.process_time() - start
        for name, smooth in filtered.items():
            begun = time.process_time()
            filtered_E = smooth(E)
            took = traced + time.process_time() - begun
            found[name].append((count, took, view.error(filtered_E)))
        report(min(4.0 * traced / SECONDS, 1.0))
        if found[""][-1][2] <= ENOUGH or 4.0 * traced >= SECONDS:
            break
    return found


def denoised(mask: np.ndarray, normal: np.ndarray, quality: str, E: np.ndarray) -> np.ndarray:
    """Return irradiance (N, 3) at the N pixels of the mask (H, W), filtered by Open Image Denoise with the normals (N, 3)."""
    import pyoidn

    pictures = np.zeros((3, *mask.shape, 3), np.float32)
    for picture, values in zip(pictures, (np.maximum(E, 0.0), np.ones_like(normal), normal), strict=True):
        picture[mask] = values
    color, albedo, normals = pictures
    return np.asarray(pyoidn.denoise(color, albedo, normals, hdr=True, clean_aux=True, quality=quality)[mask].astype(float))
