"""All hits of a camera's rays on triangles, per pixel and front to back, by NumPy alone.

Every triangle is tested at every pixel of its projection's bounding rectangle, without OpenGL or a hierarchy. Suitable for
pictures of about 100 thousand pixels and scenes of a million triangles.
"""

from __future__ import annotations

import numpy as np

from irrsplat.scene.model import Camera

_PAIRS = 1 << 21  # pairs of a triangle and a pixel tested at once; limits the memory
_NEAR = 1e-6  # of the distance to the camera's target: triangles nearer to the eye's plane are not projected


def camera_rays(camera: Camera, size: tuple[int, int], dx: float | np.ndarray = 0.5, dy: float | np.ndarray = 0.5) -> np.ndarray:
    """Return (W·H, 3) unit directions, row by row from the top, through the point (dx, dy) of every pixel (0.5: its centre).

    size: (W, H). dx, dy: 0..1 to the right and downward, one number or (H, W).
    """
    width, height = size
    row, column = np.indices((height, width))
    slope = np.tan(np.radians(camera.fov) / 2.0)
    x = ((column + dx) / width * 2.0 - 1.0) * slope * (width / height)
    y = (1.0 - (row + dy) / height * 2.0) * slope
    world = np.stack([x, y, -np.ones_like(x)], axis=-1).reshape(-1, 3) @ camera.axes
    directions: np.ndarray = world / np.linalg.norm(world, axis=1, keepdims=True)
    return directions


class Hits:
    """All hits of a camera's rays, sorted by pixel and distance; `nearest` returns them front to back."""

    def __init__(self, positions: np.ndarray, faces: np.ndarray, camera: Camera, size: tuple[int, int], directions: np.ndarray):
        """positions: (V, 3). faces: (F, 3). directions: (W·H, 3) unit, through any point of each pixel."""
        found = [np.zeros((5, 0))]
        corners = positions.astype(np.float64)[faces] - np.asarray(camera.eye)
        low, span = _rectangles(corners @ camera.axes.T, camera, size)
        pairs = np.cumsum(span.prod(axis=1))
        start = 0
        while start < len(faces):
            done = pairs[start - 1] if start else 0
            stop = max(int(np.searchsorted(pairs, done + _PAIRS, side="right")), start + 1)
            found.append(_meet(corners, np.arange(start, stop), low, span, size[0], directions))
            start = stop
        pixel, triangle, u, v, t = np.concatenate(found, axis=1)
        order = np.lexsort((t, pixel))
        self.triangle = triangle[order].astype(np.int64)
        self.u, self.v, self.t = u[order], v[order], t[order]
        counts = np.bincount(pixel.astype(np.int64), minlength=len(directions))
        self.end = np.cumsum(counts)
        self.next = self.end - counts

    def nearest(self, pixel: np.ndarray, beyond: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return (found, triangle, u, v, distance), (N,) each, of the nearest hits of pixels (N,) beyond the distances `beyond`
        (N,).

        A pixel's `beyond` must not decrease between calls.
        """
        at, end = self.next[pixel], self.end[pixel]
        behind = np.arange(len(pixel))
        while len(behind):
            behind = behind[at[behind] < end[behind]]
            behind = behind[self.t[at[behind]] <= beyond[behind]]
            at[behind] += 1
        self.next[pixel] = at
        found = at < end
        safe = np.where(found, at, 0)
        if not len(self.t):
            nothing = np.zeros(len(pixel))
            return found, nothing.astype(np.int64), nothing, nothing, nothing
        return found, self.triangle[safe], self.u[safe], self.v[safe], self.t[safe]


def _rectangles(corners: np.ndarray, camera: Camera, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the first pixel (F, 2) and extent (F, 2), column and row, of the rectangles that triangles (F, 3, 3) in view space
    may cover; extent 0 for invisible triangles."""
    near = _NEAR * float(np.linalg.norm(np.subtract(camera.target, camera.eye)))
    slope = np.tan(np.radians(camera.fov) / 2.0)
    depth = -corners[..., 2]
    following = np.roll(corners, -1, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (near - depth) / (-following[..., 2] - depth)
        crossing = corners + share[..., None] * (following - corners)
        points = np.concatenate([corners, crossing], axis=1)
        usable = np.concatenate([depth > near, (share > 0.0) & (share < 1.0)], axis=1)
        z = np.concatenate([depth, np.full_like(depth, near)], axis=1)
        x = (points[..., 0] / (z * slope * size[0] / size[1]) + 1.0) * 0.5 * size[0]
        y = (1.0 - points[..., 1] / (z * slope)) * 0.5 * size[1]
    low, high = np.zeros((2, len(corners), 2), np.int64)
    for axis, values in enumerate((x, y)):
        first = np.where(usable, values, np.inf).min(axis=1, initial=np.inf)
        last = np.where(usable, values, -np.inf).max(axis=1, initial=-np.inf)
        # one more pixel on every side: rays may pass through any point of a pixel, and rounding must not lose one
        low[:, axis] = np.clip(np.floor(first) - 1, 0, size[axis])
        high[:, axis] = np.clip(np.floor(last) + 2, 0, size[axis])
    span = np.maximum(high - low, 0)
    span[~usable.any(axis=1)] = 0
    return low, span


def _meet(
    corners: np.ndarray, triangles: np.ndarray, low: np.ndarray, span: np.ndarray, width: int, directions: np.ndarray
) -> np.ndarray:
    """Return (5, N): pixel, triangle, u, v, distance of all hits of these triangles (Möller and Trumbore 1997)."""
    counts = span[triangles].prod(axis=1)
    triangle = np.repeat(triangles, counts)
    within = np.arange(len(triangle)) - np.repeat(np.cumsum(counts) - counts, counts)
    columns = np.maximum(span[triangle, 0], 1)
    pixel = (low[triangle, 1] + within // columns) * width + low[triangle, 0] + within % columns
    a = corners[triangle, 0]
    e1, e2 = corners[triangle, 1] - a, corners[triangle, 2] - a
    direction = directions[pixel]
    across = np.cross(direction, e2)
    determinant = (e1 * across).sum(1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = -(a * across).sum(1) / determinant
        along = np.cross(-a, e1)
        v = (direction * along).sum(1) / determinant
        t = (e2 * along).sum(1) / determinant
        hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0) & np.isfinite(t)
    return np.stack([pixel[hit], triangle[hit], u[hit], v[hit], t[hit]])
