"""Triangulation of polygons: fans for convex ones, ear clipping for concave ones and those with bridges."""

from __future__ import annotations

import numpy as np

_REFLEX = -1e-3  # sine of a corner's turn against the polygon's; above it is rounding, or a slightly bent plane


def triangulate(positions: np.ndarray, vertices: np.ndarray, sides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (F, 3) int64 into the corners, and (F,) the polygon of each triangle, ascending.

    positions: (V, 3). vertices: (C,) into positions, the corners of all polygons, concatenated. sides: (P,) the number of corners
    of each, at least 3. A convex polygon becomes a fan about its first corner. Self-intersecting outlines get some triangles.
    """
    if (sides == 3).all():
        return np.arange(len(vertices)).reshape(-1, 3), np.arange(len(sides))
    first = np.cumsum(sides) - sides
    triangles, owners = [], []
    for count in np.unique(sides).tolist():
        polygons = np.flatnonzero(sides == count)
        corners = first[polygons, None] + np.arange(count)
        fan = np.stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)], 1)
        local = np.broadcast_to(fan, (len(polygons), *fan.shape))
        if count > 3:
            local = _ears(positions[vertices[corners]], local)
        triangles.append(np.take_along_axis(corners, local.reshape(len(polygons), -1), 1).reshape(-1, 3))
        owners.append(np.repeat(polygons, count - 2))
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(triangles)[order], owner[order]


def _ears(points: np.ndarray, fan: np.ndarray) -> np.ndarray:
    """Return the triangles (P, K - 2, 3) of polygons (P, K, 3): `fan`, or ears for concave ones."""
    with np.errstate(all="ignore"):
        edges = np.roll(points, -1, axis=1) - points  # from each corner to the next
        from_first = points - points[:, :1]
        normal = np.cross(from_first, np.roll(from_first, -1, axis=1)).sum(1)  # Newell's normal: the mean of twice the area
        turn = (np.cross(np.roll(edges, 1, axis=1), edges) * normal[:, None]).sum(2)
        length = np.linalg.norm(edges, axis=2)
        scale = np.roll(length, 1, axis=1) * length * np.linalg.norm(normal, axis=1)[:, None]
        reflex = turn < _REFLEX * scale
    concave = np.flatnonzero(reflex.any(1))
    if not len(concave):
        return fan
    out = fan.copy()
    if points.shape[1] == 4:  # the diagonal starts at the reflex corner
        other = concave[reflex[concave][:, 1::2].any(1)]
        out[other] = (1, 2, 3), (1, 3, 0)
        return out
    import mapbox_earcut  # only for such polygons

    axis = normal[concave] / np.linalg.norm(normal[concave], axis=1, keepdims=True)
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin(1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    plane = np.stack([across, np.cross(axis, across)], 2)  # (P, 3, 2): counter-clockwise about the normal
    flat = from_first[concave] @ plane
    ends = np.array([points.shape[1]], np.uint32)
    for polygon, outline in zip(concave.tolist(), flat, strict=True):
        ears = mapbox_earcut.triangulate_float64(np.ascontiguousarray(outline), ends).astype(np.int64).reshape(-1, 3)
        if not 0 < len(ears) <= len(out[polygon]):
            continue
        a, b, c = (outline[ears[:, i]] for i in range(3))
        clockwise = (b - a)[:, 0] * (c - a)[:, 1] < (b - a)[:, 1] * (c - a)[:, 0]
        ears[clockwise] = ears[clockwise][:, ::-1]
        out[polygon] = 0  # collinear corners need no triangle: the remaining triangles have no area
        out[polygon, : len(ears)] = ears
    return out
