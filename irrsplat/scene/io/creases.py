"""Vertex normals for triangles without normals: smooth across edges below a crease angle, sharp elsewhere."""

from __future__ import annotations

import numpy as np

from irrsplat.core.vectors import as_float32, pairs, unit
from irrsplat.scene.io.mesh_builder import distinct_rows, welded

_CHUNK_PAIRS = 1 << 21  # pairs of corners that are compared together; bounds the temporary memory
_MOST_COMPARED = 256  # corners at one place above which they are not compared in pairs; those at a crease stay flat


def crease_normals(positions: np.ndarray, corners: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, 3) unit normals and (F, 3) indices into them, for triangles `corners` (F, 3) into positions (V, 3).

    A corner's normal is the mean over the triangles at its place, weighted by their angle there (Thürmer & Wüthrich 1998). Only
    triangles count whose normals deviate from its own triangle's by less than `angle`, in degrees. Vertices at the same place
    count as one.
    """
    _, place = welded(as_float32(positions))
    at = place[corners]
    points = positions[corners]
    with np.errstate(all="ignore"):
        face = unit(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]))
        weighted = face[:, None] * _angles(points)[..., None]
    flat_at = at.reshape(-1)
    count = int(flat_at.max(initial=-1)) + 1
    spread = weighted.reshape(-1, 3)
    mean = unit(np.stack([np.bincount(flat_at, spread[:, i], minlength=count) for i in range(3)], 1))
    if angle >= 180.0:
        return mean, at
    with np.errstate(all="ignore"):
        off: np.ndarray = (face[:, None] * mean[at]).sum(2) < np.cos(np.radians(0.5 * angle)) + 1e-6
    # elsewhere, normals lie within half the angle of the mean, hence within the angle of each other
    creased = np.zeros(count, bool)
    real = np.abs(face).max(axis=1, initial=0.0) > 0.0
    creased[at[off & real[:, None]]] = True
    sharp = np.flatnonzero(creased[flat_at])
    sharp = sharp[np.argsort(flat_at[sharp], kind="stable")]
    own = _normal_sums(flat_at[sharp], face[sharp // 3], spread[sharp], float(np.cos(np.radians(angle))) + 1e-6)
    number = at.reshape(-1).copy()
    pairs = np.column_stack([flat_at[sharp].astype(float), own + 0.0])  # of a place and a normal
    kept, number_of = distinct_rows(pairs.view(np.uint64))
    number[sharp] = count + number_of
    return np.concatenate([mean, own[kept]]), number.reshape(-1, 3)


def _angles(points: np.ndarray) -> np.ndarray:
    """Return (F, 3) radians: the angle at each corner of triangles (F, 3, 3)."""
    forward = np.roll(points, -1, axis=1) - points
    backward = np.roll(points, 1, axis=1) - points
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(forward, backward), axis=2), (forward * backward).sum(2)))


def _normal_sums(place: np.ndarray, face: np.ndarray, weighted: np.ndarray, least: float) -> np.ndarray:
    """Return (R, 3) unit sums of `weighted` over the corners at the same place with a cosine above `least` between `face`
    normals.

    place: (R,) ascending.
    """
    first = np.flatnonzero(np.diff(place, prepend=-1))
    size = np.diff(first, append=len(place))
    begin, count = np.repeat(first, size), np.repeat(size, size)
    crowded = count > _MOST_COMPARED
    begin[crowded], count[crowded] = np.flatnonzero(crowded), 1
    sums = np.empty_like(weighted)
    x, y, z = (np.ascontiguousarray(face[:, i]) for i in range(3))
    columns = [np.ascontiguousarray(weighted[:, i]) for i in range(3)]
    for rows, one, other in pairs(begin, count, _CHUNK_PAIRS):
        close = (x[one] * x[other] + y[one] * y[other] + z[one] * z[other] > least) | (one == other)
        one, other = one[close] - rows.start, other[close]
        for i, column in enumerate(columns):
            sums[rows, i] = np.bincount(one, column[other], minlength=rows.stop - rows.start)
    return unit(sums)
