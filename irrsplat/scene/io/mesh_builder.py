"""Build meshes from raw triangles: transform, normals, removal of degenerate triangles, and the test for closed surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from irrsplat.core.vectors import Vector, as_float32, near_origin, pairs, times, unit
from irrsplat.core.vectors import cross as cross_product
from irrsplat.scene.model import Material, Mesh, Scene

_FLAT = 1e-12  # twice the area over the longest edge squared; smaller values are rounding errors
_HASH = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93], np.uint64)  # odd factors
_CHUNK_PAIRS = 1 << 21  # pairs of corners that are compared together; bounds the temporary memory
_MOST_COMPARED = 256  # corners at one place above which they are not compared in pairs; those at a crease stay flat


@dataclass(frozen=True)
class Part:
    """Triangles of one material in object space, as a file has them.

    positions: (V, 3), finite. corners: (F, 3) into positions. normals: (N, 3), of any length, or None. corner_normals: (F, 3)
    into normals, -1 for none; None: one normal a position. matrix: (4, 4) world_from_object, affine; None: identity. colors:
    (V, 3) or None. uvs: (T, 4), two sets u v u v, or None. corner_uvs: (F, 3) into uvs, -1 for none (0 0 0 0); None: one row a
    position. opacities: (V,) or None. files: read for it, apart from the main one. source: place in the file, for messages.
    """

    positions: np.ndarray
    corners: np.ndarray
    normals: np.ndarray | None = None
    corner_normals: np.ndarray | None = None
    matrix: np.ndarray | None = None
    material: Material = Material()
    colors: np.ndarray | None = None
    name: str = ""
    files: tuple[Path, ...] = ()
    uvs: np.ndarray | None = None
    corner_uvs: np.ndarray | None = None
    opacities: np.ndarray | None = None
    source: Any = None


@dataclass(frozen=True)
class Built:
    """The mesh of a part, or the problem that prevents it. dropped: number of degenerate triangles that are left out."""

    part: Part
    mesh: Mesh | None = None
    dropped: int = 0
    problem: str = ""


def build_meshes(parts: Sequence[Part]) -> tuple[list[Built], Vector]:
    """Return the mesh of each part in world space, and the origin that their positions are relative to.

    The origin is 0 0 0, or near the meshes if these lie far from there. A triangle with a missing or zero normal gets its face
    normal and vertices of its own. The problem is a transform that cannot be inverted or exceeds the range of float32.
    """
    built = [build_mesh(part) for part in parts]
    meshes = tuple(one.mesh for one in built if one.mesh is not None)
    origin = near_origin(*Scene(meshes, (), ()).bounds)
    return ([build_mesh(part, origin) for part in parts] if any(origin) else built), origin


def build_mesh(part: Part, origin: Vector = (0.0, 0.0, 0.0)) -> Built:
    """Return the mesh of a part, relative to `origin`."""
    corners, matrix = part.corners.astype(np.int64), np.eye(4) if part.matrix is None else part.matrix
    turn = matrix[:3, :3]
    with np.errstate(all="ignore"):
        world = times(part.positions.astype(float), turn) + (matrix[:3, 3] - origin)
        positions, determinant = world.astype(np.float32), np.linalg.det(turn)
        if not np.isfinite(positions).all() or not np.isfinite(determinant) or determinant == 0.0:
            problem = "the transformed coordinates exceed the range of 32-bit floats, or all collapse; change the scale"
            return Built(part, problem=problem)
        normals = np.zeros((0, 3))
        if part.normals is not None:
            normals = np.nan_to_num(part.normals.astype(float), posinf=0.0, neginf=0.0)
            normals = unit(times(normals, np.linalg.inv(turn).T)) if normals.any() else normals

    a, b, c = (world[corners[:, i]] for i in range(3))
    cross = cross_product(b - a, c - a)
    longest = np.maximum(np.maximum(((b - a) ** 2).sum(1), ((c - b) ** 2).sum(1)), ((a - c) ** 2).sum(1))
    good = np.linalg.norm(cross, axis=1) > _FLAT * longest
    columns, normal_column = [corners], 0 if part.corner_normals is None and part.normals is not None else 1
    if normal_column:
        columns.append(np.full_like(corners, -1) if part.corner_normals is None else part.corner_normals)
    if part.corner_uvs is not None:
        columns.append(part.corner_uvs)
    if not good.all():
        columns, cross = [column[good] for column in columns], cross[good]
    nonzero = np.append(normals.any(axis=1), False)  # the last row is that of index -1
    shaded = np.asarray(nonzero[columns[normal_column]].all(axis=1))
    vertices, inverse = _vertices([column[shaded] for column in columns])
    faces = np.empty((len(cross), 3), np.int32)
    faces[shaded] = inverse
    faces[~shaded] = len(vertices[0]) + np.arange(3 * np.count_nonzero(~shaded)).reshape(-1, 3)
    sources = [np.concatenate([v, column[~shaded].reshape(-1)]) for v, column in zip(vertices, columns, strict=True)]
    smooth, flat = normals[vertices[normal_column]], np.repeat(unit(cross[~shaded]), 3, axis=0)
    uvs = None
    if part.uvs is not None:
        source = sources[0] if part.corner_uvs is None else sources[-1]
        uvs = part.uvs[source].astype(np.float32)
        uvs[source < 0] = 0.0
    positions = positions[sources[0]]
    colors, opacities = (
        None if values is None else values[sources[0]].astype(np.float32) for values in (part.colors, part.opacities)
    )
    mesh = Mesh(
        positions,
        np.concatenate([smooth, flat]).astype(np.float32),
        faces,
        part.material,
        colors,
        is_closed(positions, faces),
        part.name,
        uvs,
        opacities,
    )
    return Built(part, mesh, int(np.count_nonzero(~good)))


def _vertices(columns: list[np.ndarray]) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the distinct tuples of indices of corners (F, 3), ascending, as one (M,) a column, and (F, 3) indices into them.

    Indices are -1 or more.
    """
    if len(columns) == 1:  # no sort needed
        used = np.zeros(int(columns[0].max(initial=-1)) + 1, bool)
        used[columns[0]] = True
        return [np.flatnonzero(used)], (np.cumsum(used) - 1)[columns[0]]
    tuples, inverse = np.unique(columns[0], return_inverse=True)
    parts = [tuples]
    for column in columns[1:]:
        span = int(column.max(initial=-1)) + 2
        tuples, inverse = np.unique(inverse.reshape(-1, 3) * span + column + 1, return_inverse=True)
        parts = [part[tuples // span] for part in parts] + [tuples % span - 1]
    return parts, inverse.reshape(-1, 3)


def is_closed(positions: np.ndarray, faces: np.ndarray) -> bool:
    """True if the triangles (F, 3) over positions (V, 3) bound solids and are wound counter-clockwise seen from outside.

    Vertices at exactly the same place count as one. Each edge must belong to exactly two triangles of opposite directions, and
    each connected component must have a positive signed volume.
    """
    if len(faces) < 4 or len(faces) % 2:
        return False
    points = positions.astype(float)
    points -= points.mean(0)
    a, b, c = (points[faces[:, i]] for i in range(3))
    total = np.abs(cross_product(b - a, c - a).sum(0)).max()  # 0 for a closed surface: early exit for most open ones
    if total > 1e-12 * len(faces) * np.abs(points).max() ** 2:
        return False
    first, weld = welded(positions)
    joined = weld[faces]
    edges = np.concatenate([joined[:, [0, 1]], joined[:, [1, 2]], joined[:, [2, 0]]])
    count = len(first)
    forward = np.sort(edges[:, 0] * count + edges[:, 1])
    if (forward[1:] == forward[:-1]).any():
        return False
    backward = np.sort(edges[:, 1] * count + edges[:, 0])
    if not np.array_equal(forward, backward):
        return False
    part = _parts(edges[edges[:, 0] < edges[:, 1]], count)[joined[:, 0]]
    volume = np.bincount(part, (a * cross_product(b, c)).sum(1), minlength=count)
    return bool((volume[np.unique(part)] > 0.0).all())


def welded(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return one vertex of each distinct place (M,), and the number of each vertex's place (V,); positions (V, 3) float32."""
    return distinct_rows(np.ascontiguousarray(positions + np.float32(0.0)).view(np.uint32))  # + 0: no -0


def distinct_rows(bits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return one index of each distinct row (M,), and the number of each row's kind (N,), int64; bits: (N, C) unsigned, C ≤ 4."""
    with np.errstate(over="ignore"):
        hashed = bits.astype(np.uint64) @ _HASH[: bits.shape[1]]
    hashed ^= hashed >> np.uint64(29)
    _, first, number = np.unique(hashed, return_index=True, return_inverse=True)
    if not np.array_equal(bits[first][number.reshape(-1)], bits):  # two rows with one hash: the slow way
        _, first, number = np.unique(bits, axis=0, return_index=True, return_inverse=True)
    return first, number.reshape(-1).astype(np.int64)


def _parts(edges: np.ndarray, count: int) -> np.ndarray:
    """Return (count,) the least vertex of each vertex's component, by hooking and pointer jumping (Shiloach & Vishkin 1982)."""
    label = np.arange(count)
    while True:
        a, b = label[edges[:, 0]], label[edges[:, 1]]
        if np.array_equal(a, b):
            return label
        least = np.minimum(a, b)
        np.minimum.at(label, a, least)
        np.minimum.at(label, b, least)
        label = label[label]


# ---- missing normals --------------------------------------------------------------------------------------------------


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
