"""Records that a view needs, whose spheres of influence touch its frustum, and records to drop when there are too many."""

from __future__ import annotations

import numpy as np

from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings

# pixels around the view: more than the offset of antialiasing samples from pixel centres, and than the least reach of a record
# within a closed mesh, see shaders/indirect/splat.vert
_MARGIN = 1.6
_LEFT = 0.75  # share of max_records that stays, so that evictions are rare


def reaching(cache: RecordCache, first: int, camera: Camera, size: tuple[int, int], settings: Settings) -> np.ndarray:
    """Return the numbers, from `first` on and ascending, of records that may reach a pixel of the view of `size` (width, height).

    The greatest radius on screen (`radius_max`) bounds their spheres, or else R.
    """
    offset = np.ascontiguousarray(cache.positions[first:].T) - np.asarray(camera.eye, "f4")[:, None]  # (3, N) from the eye
    distance = np.sqrt((offset * offset).sum(0))
    percent = camera.measure(size) / 100.0 * distance  # of the picture's measure, in metres
    if settings.radius_max > 0.0:
        radius = settings.radius_max * percent
    else:
        radius = np.maximum(settings.a * settings.widest * cache.values[first:, 3], settings.radius_min * percent)
    radius = np.maximum(radius, _MARGIN * camera.pixel(size) * distance)
    # a thousandth of the radius and 1e-5 of all distances are far more than rounding, here and on the GPU
    radius = (1.0 + 1e-3) * radius + 1e-5 * (distance + max(map(abs, camera.eye)))
    return first + np.flatnonzero(_outside(offset, camera, size) <= radius)


def kept(cache: RecordCache, requested: int, camera: Camera, size: tuple[int, int], settings: Settings) -> np.ndarray | None:
    """Return the numbers of the records to keep, so that so many more fit within `max_records`; None: keep all.

    Records unseen for the most views go first, the farthest of them foremost. Records that this view needs always stay, even
    beyond the limit.
    """
    most = settings.max_records
    if cache.count + requested <= most:
        return None
    unneeded = np.ones(cache.count, bool)
    unneeded[reaching(cache, 0, camera, size, settings)] = False
    numbers = np.flatnonzero(unneeded)
    goal = max(min(int(_LEFT * most), most - requested), 0)
    distance = np.linalg.norm(cache.positions[numbers] - np.asarray(camera.eye, "f4"), axis=1)
    going = numbers[np.lexsort((-distance, cache.column("last_view")[numbers]))][: cache.count - goal]
    return np.delete(np.arange(cache.count), going) if len(going) else None


def _outside(offset: np.ndarray, camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """Return (N,) metres: the greatest distance of points outside a side of the view frustum; below 0 inside.

    offset: (3, N) from the eye. The frustum is wider by _MARGIN on each side.
    """
    x, y, z = (np.asarray(sum(float(share) * one for share, one in zip(axis, offset, strict=True))) for axis in camera.axes)
    pixel, whole, corner = camera.pixel(size), camera.whole(size), camera.corner()
    outside: np.ndarray = z
    for v, side, of_all, first in zip((x, y), size, whole, corner, strict=True):
        centre = 0.5 * of_all - first  # pixel of the view axis; in a part of a picture it may lie outside
        after, before = ((length + _MARGIN) * pixel for length in (side - centre, centre))  # tangents of the half angles
        for apart, tangent in (v, after), (-v, before):
            outside = np.maximum(outside, (apart + tangent * z) * float(1.0 / np.hypot(1.0, tangent)))
    return outside
