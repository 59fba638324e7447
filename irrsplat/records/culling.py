"""Culling of records: a view needs only records whose spheres of influence touch visible surfaces."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings

TILE = 16  # pixels, side of the tiles with a farthest visible distance
# shares of a sphere's radius and of all distances: far more than rounding, here and on the GPU
_SLACK = 1e-3, 1e-5
_MARGIN = 1.6  # pixels around the view: more than the offset of antialiasing samples from pixel centres
_OWN_PIXELS = 1.5  # pixels, least reach of a record within a closed mesh, as in shaders/indirect/splat.vert
_MANY = 1000  # records in the view frustum: with fewer, occlusion culling costs more than it saves


def reaching(
    cache: RecordCache,
    first: int,
    camera: Camera,
    size: tuple[int, int],
    settings: Settings,
    farthest: Callable[[], np.ndarray] | None = None,
) -> np.ndarray:
    """Return the numbers, from `first` on and ascending, of records that may reach a pixel of the view of `size` (width, height).

    The greatest radius on screen (`radius_max`) bounds their spheres, or else R. farthest: returns the distances of
    SplatPass.farthest; called only for many records, for occlusion culling.
    """
    offset = _offset(cache.positions[first:], camera)
    distance = np.sqrt((offset * offset).sum(0))
    percent = camera.measure(size) / 100.0 * distance  # of the picture's measure, in metres
    if settings.radius_max > 0.0:
        radius = settings.radius_max * percent
    else:
        radius = np.maximum(settings.a * settings.widest * cache.values[first:, 3], settings.radius_min * percent)
    radius = np.maximum(radius, _OWN_PIXELS * camera.pixel(size) * distance)
    relative, rounding = _SLACK
    radius = (1.0 + relative) * radius + rounding * (distance + max(map(abs, camera.eye)))
    numbers = np.flatnonzero(_outside(offset, camera, size, _MARGIN) <= radius)
    if farthest is not None and len(numbers) > _MANY:
        near = distance[numbers] - radius[numbers]
        numbers = numbers[near <= _visible_distance(offset[:, numbers], radius[numbers], camera, size, farthest())]
    return first + numbers


def within(points: np.ndarray, camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """Return (N,) bool, True for points (N, 3) in the frustum of the view of `size`."""
    inside: np.ndarray = _outside(_offset(points, camera), camera, size) <= 0.0
    return inside


def _offset(points: np.ndarray, camera: Camera) -> np.ndarray:
    """Return (3, N) float32: points (N, 3) relative to the eye, a row for each axis."""
    offset: np.ndarray = np.ascontiguousarray(points.T, "f4") - np.asarray(camera.eye, "f4")[:, None]
    return offset


def _outside(offset: np.ndarray, camera: Camera, size: tuple[int, int], margin: float = 0.0) -> np.ndarray:
    """Return (N,) metres: the greatest distance of points outside a side of the view frustum; below 0 inside.

    offset: (3, N) from the eye. margin: pixels by which the frustum is wider on each side.
    """
    x, y, z = _in_view(offset, camera)
    pixel = camera.pixel(size)
    outside: np.ndarray = z
    for v, side, centre in zip((x, y), size, _centre(camera, size), strict=True):
        after, before = ((length + margin) * pixel for length in (side - centre, centre))  # tangents of the half angles
        for apart, tangent in ((abs(v), after),) if after == before else ((v, after), (-v, before)):
            outside = np.maximum(outside, (apart + tangent * z) * float(1.0 / np.hypot(1.0, tangent)))
    return outside


def _centre(camera: Camera, size: tuple[int, int]) -> tuple[float, float]:
    """Return the pixel of the view axis, from the lower left corner; in a part of a picture it may lie outside."""
    whole, corner = camera.whole(size), camera.corner()
    return 0.5 * whole[0] - corner[0], 0.5 * whole[1] - corner[1]


def _in_view(offset: np.ndarray, camera: Camera) -> tuple[np.ndarray, ...]:
    """Return x, y and z (N,) in view space of points at `offset` (3, N) from the eye."""
    return tuple(np.asarray(sum(float(share) * one for share, one in zip(axis, offset, strict=True))) for axis in camera.axes)


def _visible_distance(
    offset: np.ndarray, radius: np.ndarray, camera: Camera, size: tuple[int, int], tiles: np.ndarray
) -> np.ndarray:
    """Return (N,) metres: an upper bound of the visible distance within the screen extent of spheres.

    tiles: (h, w) the farthest visible distance of each tile.
    """
    x, y, z = _in_view(offset, camera)
    near, far = -z - radius, -z + radius
    around = near <= 1e-3 * far  # the eye is within the sphere, or nearly: its extent is the whole screen
    near = np.where(around, far, near)
    spans = []
    for side, centre, count in zip((x, y), _centre(camera, size), tiles.shape[::-1], strict=True):
        scale = 1.0 / camera.pixel(size) / TILE
        low, high = side - radius, side + radius
        low, high = low / np.where(low < 0.0, near, far), high / np.where(high > 0.0, near, far)
        low, high = (scale * edge + centre / TILE for edge in (low - _MARGIN / TILE / scale, high + _MARGIN / TILE / scale))
        low, high = np.where(around, 0.0, low), np.where(around, count, high)
        spans.append([np.clip(edge, 0, count - 1).astype(np.intp) for edge in (low, high)])
    (left, right), (bottom, top) = spans
    levels, starts = _pyramid(tiles)
    level = np.ceil(np.log2(np.maximum(np.maximum(right - left, top - bottom), 1))).astype(np.intp)
    width = (1 << (len(starts) - 1)) >> level

    def at(column: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Return the greatest value in the square of that level that holds this tile."""
        greatest: np.ndarray = levels[starts[level] + (row >> level) * width + (column >> level)]
        return greatest

    # a square of that level is at least as wide as the sphere: the squares at its four corners cover it
    visible: np.ndarray = np.maximum(np.maximum(at(left, bottom), at(right, bottom)), np.maximum(at(left, top), at(right, top)))
    return visible


def _pyramid(tiles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a maximum pyramid of (h, w) values and the start of each level.

    The levels of squares 1, 2, 4 … values wide follow each other, each row by row.
    """
    most = int(np.ceil(np.log2(max(*tiles.shape, 2))))
    padded = np.zeros((1 << most, 1 << most), np.float32)
    padded[: tiles.shape[0], : tiles.shape[1]] = tiles
    levels = [padded]
    for _ in range(most):
        halved = levels[-1].reshape(len(levels[-1]) // 2, 2, -1, 2)
        levels.append(halved.max((1, 3)))
    return np.concatenate([level.ravel() for level in levels]), np.cumsum([0, *(level.size for level in levels[:-1])])
