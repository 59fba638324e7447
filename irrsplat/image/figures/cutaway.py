"""A cutaway of the seen surfaces: the picture's pixels at their world positions, in a parallel view from the side.

Back-facing walls are left out, so that the inside of a room stays visible.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.image.frame import Frame
from irrsplat.image.tonemap import tonemap

_MOST = 512  # pixels along a side of the picture that are used, at most
_FINEST = 128  # subdivisions along a side of a pixel, at most
_APART = 2.0  # pixel sizes: largest distance between a neighbour and the other's plane on one surface


@dataclass(frozen=True)
class Parallel:
    """A parallel view: rows of `axes` are right, up and towards the viewer; `centre` (3,) appears at `middle` (x, y) pixels.

    scale: pixels per metre.
    """

    axes: np.ndarray
    centre: np.ndarray
    middle: np.ndarray
    scale: float

    def at(self, points: np.ndarray) -> np.ndarray:
        """Return pixels (…, 2), y downwards, of world points (…, 3)."""
        pixels: np.ndarray = self.middle + ((points - self.centre) @ self.axes[:2].T) * (self.scale, -self.scale)
        return pixels

    def nearness(self, points: np.ndarray) -> np.ndarray:
        """Return the signed distances of points (…, 3) from the centre towards the viewer, in metres."""
        along: np.ndarray = (points - self.centre) @ self.axes[2]
        return along


@dataclass(frozen=True)
class Surface:
    """The seen surfaces as quads between neighbouring pixels.

    corners (N, 4, 3) in world space, colours (N, 4, 3) in display values 0..1, normals (N, 3), unit, facing the eye.
    """

    corners: np.ndarray
    colours: np.ndarray
    normals: np.ndarray


def surface(frame: Frame, pixel: float) -> Surface:
    """Return the surfaces of `frame`, cut at depth discontinuities; pixel: size of a pixel at distance 1, in metres."""
    stride = -(-max(frame.depth.shape) // _MOST)
    colours = tonemap(frame.image, frame.exposure).astype(np.float32)[::stride, ::stride]
    position, normal, depth = (b[::stride, ::stride] for b in (frame.position, frame.normal, frame.depth))

    def cells(values: np.ndarray) -> np.ndarray:
        # in the order of _bilinear
        return np.stack([values[:-1, :-1], values[:-1, 1:], values[1:, :-1], values[1:, 1:]], axis=2)

    corners, normals = cells(position), cells(normal)
    near = np.where(np.isfinite(depth), depth, 0.0)
    allowed = _APART * stride * pixel * cells(near).max(axis=2)
    whole = np.isfinite(cells(depth)).all(axis=2)
    for i, j in ((0, 1), (0, 2), (3, 1), (3, 2), (0, 3), (1, 2)):
        step = corners[:, :, j] - corners[:, :, i]
        off = [np.abs((step * normals[:, :, k]).sum(-1)) for k in (i, j)]
        whole &= np.minimum(*off) < allowed
    return Surface(corners[whole], cells(colours)[whole], normals[whole].mean(axis=1))


def paint(canvas: np.ndarray, view: Parallel, seen: Surface) -> None:
    """Draw the surfaces that face the viewer into `canvas` (H, W, 3), nearest on top."""
    height, width = canvas.shape[:2]
    facing = seen.normals @ view.axes[2] > 0.03
    corners, colours = seen.corners[facing], seen.colours[facing]
    flat = view.at(corners)
    low, high = flat.min(axis=1), flat.max(axis=1)
    inside = (high >= 0.0).all(axis=1) & (low < (width, height)).all(axis=1)
    if not inside.any():
        return
    places = np.concatenate([flat, view.nearness(corners)[..., None]], axis=-1)[inside].astype(np.float32)
    colours = colours[inside]
    long = [np.abs(places[:, a, :2] - places[:, b, :2]).max(axis=(1, 2)) for a, b in (((0, 2), (1, 3)), ((0, 1), (2, 3)))]
    # subdivisions across and down, in powers of two, so that few sizes occur
    parts = np.exp2(np.ceil(np.log2(np.clip(1.2 * np.stack(long, axis=1), 1.0, _FINEST)))).astype(int)
    points, tints = [], []
    for across, down in np.unique(parts, axis=0):
        weights, mine = _bilinear(across, down), (parts == (across, down)).all(axis=1)
        points.append((weights @ places[mine]).reshape(-1, 3))
        tints.append((weights @ colours[mine]).reshape(-1, 3))
    point, tint = np.concatenate(points), np.concatenate(tints)
    column, row = np.floor(point[:, 0]).astype(int), np.floor(point[:, 1]).astype(int)
    kept = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    order = np.flatnonzero(kept)[np.argsort(point[kept, 2], kind="stable")]
    canvas[row[order], column[order]] = tint[order]  # the last write to a pixel remains: the nearest


def _bilinear(across: int, down: int) -> np.ndarray:
    """Return (across·down, 4) weights of a cell's corners at the centres of its subdivisions."""
    x, y = (v.ravel().astype(np.float32) for v in np.meshgrid(*((np.arange(n) + 0.5) / n for n in (across, down))))
    return np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y], axis=1)
