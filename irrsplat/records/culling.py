"""Which records a view may need: those whose spheres of influence touch what it sees. What is left out would add nothing."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings

TILE = 16  # pixels: a side of the tiles for whose farthest surface a view is asked
_SLACK = 1e-3, 1e-5  # of a sphere's radius, and of all distances: far more than rounding, here and on the GPU
_BESIDE = 1.6  # pixels: more than samples lie beside the centres
_MANY = 1000  # records in the pyramid: with fewer it does not pay to look for those that are hidden


def reaching(
    cache: RecordCache,
    first: int,
    camera: Camera,
    size: tuple[int, int],
    settings: Settings,
    sight: Callable[[], np.ndarray] | None = None,
) -> np.ndarray:
    """The numbers, from `first` on and ascending, of records that may speak for a pixel of the view of `size` (width, height).

    Their spheres are bounded by the greatest radius on screen where there is one (`radius_max`), else by R. sight: how far the
    view sees, as SplatPass.farthest has it; asked where there are many, since a scene's far side is mostly behind its near one.
    """
    offset = _offset(cache.positions[first:], camera)
    distance = np.sqrt((offset * offset).sum(0))
    percent = camera.screen / 100.0 * distance  # of the image height, in metres
    if settings.radius_max > 0.0:
        radius = settings.radius_max * percent
    else:
        radius = np.maximum(settings.a * settings.widest * cache.values[first:, 3], settings.radius_min * percent)
    more, rounding = _SLACK
    radius = (1.0 + more) * radius + rounding * (distance + max(map(abs, camera.eye)))
    numbers = np.flatnonzero(_outside(offset, camera, size, _BESIDE) <= radius)
    if sight is not None and len(numbers) > _MANY:
        near = distance[numbers] - radius[numbers]
        numbers = numbers[near <= _seen(offset[:, numbers], radius[numbers], camera, size, sight())]
    return first + numbers


def within(points: np.ndarray, camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """(N,) bool: which of the points (N, 3) lie in the pyramid of the view of `size`."""
    return _outside(_offset(points, camera), camera, size) <= 0.0


def _offset(points: np.ndarray, camera: Camera) -> np.ndarray:
    """(3, N) float32: the way from the eye to points (N, 3), so that numpy runs along them."""
    return np.ascontiguousarray(points.T, "f4") - np.asarray(camera.eye, "f4")[:, None]


def _outside(offset: np.ndarray, camera: Camera, size: tuple[int, int], more: float = 0.0) -> np.ndarray:
    """(N,) how far outside the view's pyramid points lie, at `offset` (3, N) from the eye: metres from the plane that is farthest
    off, below 0 inside. more: by so many pixels to each side it is wider."""
    x, y, z = _in_view(offset, camera)
    pixel = camera.screen / size[1]
    wide, half = ((0.5 * side + more) * pixel for side in size)
    across, up = ((abs(v) + t * z) * float(1.0 / np.hypot(1.0, t)) for v, t in ((x, wide), (y, half)))
    return np.maximum(np.maximum(across, up), z)


def _in_view(offset: np.ndarray, camera: Camera) -> tuple[np.ndarray, ...]:
    """x, y and z (N,) in view space of what lies at `offset` (3, N) from the eye."""
    return tuple(sum(float(share) * one for share, one in zip(axis, offset, strict=True)) for axis in camera.axes)


def _seen(offset: np.ndarray, radius: np.ndarray, camera: Camera, size: tuple[int, int], tiles: np.ndarray) -> np.ndarray:
    """(N,) how far the view sees, at most, where spheres lie on screen; tiles: (h, w), how far each tile does."""
    x, y, z = _in_view(offset, camera)
    near, far = -z - radius, -z + radius
    around = near <= 1e-3 * far  # the eye, or nearly: such a sphere may lie anywhere on screen
    near = np.where(around, far, near)
    spans = []
    for side, length, count in ((x, size[0], tiles.shape[1]), (y, size[1], tiles.shape[0])):
        scale = size[1] / camera.screen / TILE
        low, high = side - radius, side + radius
        low, high = low / np.where(low < 0.0, near, far), high / np.where(high > 0.0, near, far)
        low, high = (scale * edge + 0.5 * length / TILE for edge in (low - _BESIDE / TILE / scale, high + _BESIDE / TILE / scale))
        low, high = np.where(around, 0.0, low), np.where(around, count, high)
        spans.append([np.clip(edge, 0, count - 1).astype(np.intp) for edge in (low, high)])
    (left, right), (bottom, top) = spans
    levels, starts = _pyramid(tiles)
    level = np.ceil(np.log2(np.maximum(np.maximum(right - left, top - bottom), 1))).astype(np.intp)
    width = (1 << (len(starts) - 1)) >> level

    def at(column: np.ndarray, row: np.ndarray) -> np.ndarray:
        return levels[starts[level] + (row >> level) * width + (column >> level)]

    return np.maximum(np.maximum(at(left, bottom), at(right, bottom)), np.maximum(at(left, top), at(right, top)))


def _pyramid(tiles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The greatest of (h, w) values in squares of 1, 2, 4 … of them to a side, row by row, and where each level starts."""
    most = int(np.ceil(np.log2(max(*tiles.shape, 2))))
    whole = np.zeros((1 << most, 1 << most), np.float32)
    whole[: tiles.shape[0], : tiles.shape[1]] = tiles
    levels = [whole]
    for _ in range(most):
        halved = levels[-1].reshape(len(levels[-1]) // 2, 2, -1, 2)
        levels.append(halved.max((1, 3)))
    return np.concatenate([level.ravel() for level in levels]), np.cumsum([0, *(level.size for level in levels[:-1])])
