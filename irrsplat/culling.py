"""Which records a view may need: those whose spheres of influence touch its pyramid. What is left out would add nothing."""

from __future__ import annotations

import numpy as np

from irrsplat.cache import RecordCache
from irrsplat.scene.model import Camera
from irrsplat.settings import WIDE, Settings

_SLACK = 1e-3, 1e-5  # of a sphere's radius, and of all distances: far more than rounding, here and on the GPU


def reaching(cache: RecordCache, first: int, camera: Camera, size: tuple[int, int], settings: Settings) -> np.ndarray:
    """The numbers, from `first` on and ascending, of records that may speak for a pixel of the view of `size` (width, height).

    Their spheres are bounded by the greatest radius on screen where there is one (`radius_max`), else by R.
    """
    offset = _offset(cache.positions[first:], camera)
    distance = np.sqrt((offset * offset).sum(0))
    percent = camera.screen / 100.0 * distance  # of the image height, in metres
    if settings.radius_max > 0.0:
        radius = settings.radius_max * percent
    else:
        farthest = WIDE if settings.gradients and settings.radius == "hessian" else 1.0
        radius = np.maximum(settings.a * farthest * cache.values[first:, 3], settings.radius_min * percent)
    more, rounding = _SLACK
    radius = (1.0 + more) * radius + rounding * (distance + max(map(abs, camera.eye)))
    return first + np.flatnonzero(_outside(offset, camera, size) <= radius)


def within(points: np.ndarray, camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """(N,) bool: which of the points (N, 3) lie in the pyramid of the view of `size`."""
    return _outside(_offset(points, camera), camera, size) <= 0.0


def _offset(points: np.ndarray, camera: Camera) -> np.ndarray:
    """(3, N) float32: the way from the eye to points (N, 3), so that numpy runs along them."""
    return np.ascontiguousarray(points.T, "f4") - np.asarray(camera.eye, "f4")[:, None]


def _outside(offset: np.ndarray, camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """(N,) how far outside the view's pyramid points lie, at `offset` (3, N) from the eye: metres from the plane that is farthest
    off, below 0 inside."""
    x, y, z = (sum(float(share) * one for share, one in zip(axis, offset, strict=True)) for axis in camera.axes)
    half = 0.5 * camera.screen
    wide = half * size[0] / size[1]
    across, up = ((abs(v) + t * z) * float(1.0 / np.hypot(1.0, t)) for v, t in ((x, wide), (y, half)))
    return np.maximum(np.maximum(across, up), z)
