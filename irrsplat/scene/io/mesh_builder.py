"""Makes a `Mesh` of raw triangles: transform, normals, no degenerate triangles, and whether it is closed."""

from __future__ import annotations

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.vectors import times, unit
from irrsplat.scene.model import Material, Mesh

_FLAT = 1e-12  # twice the area over the longest edge squared; less is rounding, no triangle


def build_mesh(
    positions: np.ndarray,
    corners: np.ndarray,
    normals: np.ndarray,
    corner_normals: np.ndarray,
    matrix: np.ndarray,
    material: Material,
    colors: np.ndarray | None = None,
    name: str = "",
) -> tuple[Mesh, int]:
    """A world-space Mesh, and how many degenerate triangles were dropped on the way.

    positions: (V, 3) object space. corners: (F, 3) into positions. normals: (N, 3) object space, of any length.
    corner_normals: (F, 3) into normals, -1 for none; a triangle with a corner of none (or a zero normal) gets its face
    normal and vertices of its own. matrix: (4, 4) world_from_object, affine. colors: (V, 3) or None.
    Raises InputError (without a place) where the transform can't be inverted or leaves the range of float32.
    """
    with np.errstate(all="ignore"):
        world = times(positions, matrix[:3, :3]) + matrix[:3, 3]
        determinant = np.linalg.det(matrix[:3, :3])
        usable = np.isfinite(determinant) and determinant != 0.0 and np.isfinite(world.astype(np.float32)).all()
    if not usable:
        raise InputError("the transformed coordinates are beyond what 32-bit floats hold, or all collapse; scale less")
    normal_from_object = np.linalg.inv(matrix[:3, :3]).T
    normals = unit(times(normals, normal_from_object))

    a, b, c = (world[corners[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    double_area = np.linalg.norm(cross, axis=1)
    longest = np.max([((b - a) ** 2).sum(1), ((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)], axis=0)
    good = double_area > _FLAT * longest
    corners, corner_normals, cross = corners[good], corner_normals[good], cross[good]

    nonzero = np.append(normals.any(axis=1), False)  # the last one is what an index of -1 finds
    given: np.ndarray = nonzero[corner_normals].all(axis=1)
    smooth, flat = np.flatnonzero(given), np.flatnonzero(~given)
    pair, inverse = np.unique(corners[smooth] * (len(normals) + 1) + corner_normals[smooth], return_inverse=True)
    source, source_normal = pair // (len(normals) + 1), pair % (len(normals) + 1)
    faces = np.empty((len(corners), 3), np.int32)
    faces[smooth] = inverse.reshape(-1, 3)
    faces[flat] = len(pair) + np.arange(3 * len(flat)).reshape(-1, 3)
    source = np.concatenate([source, corners[flat].reshape(-1)])
    out_normals = np.concatenate([normals[source_normal], np.repeat(unit(cross[flat]), 3, axis=0)])
    out = world[source].astype(np.float32)
    mesh = Mesh(
        positions=out,
        normals=out_normals.astype(np.float32),
        faces=faces,
        material=material,
        colors=None if colors is None else colors[source].astype(np.float32),
        closed=is_closed(out, faces),
        name=name,
    )
    return mesh, int((~good).sum())


def is_closed(positions: np.ndarray, faces: np.ndarray) -> bool:
    """Whether the triangles (F, 3) over positions (V, 3) bound solids and are wound outward, counter-clockwise seen from outside.

    Vertices at exactly the same place count as one. True where each edge belongs to exactly two triangles that run through it
    in opposite directions, and each connected part has a positive signed volume.
    """
    if len(faces) < 4:
        return False
    rows = np.ascontiguousarray(positions + np.float32(0.0)).view([("", positions.dtype)] * 3).reshape(-1)  # + 0: no -0
    _, first, weld = np.unique(rows, return_index=True, return_inverse=True)
    welded = weld.reshape(-1)[faces].astype(np.int64)
    edges = np.concatenate([welded[:, [0, 1]], welded[:, [1, 2]], welded[:, [2, 0]]])
    count = len(first)
    forward = np.sort(edges[:, 0] * count + edges[:, 1])
    backward = np.sort(edges[:, 1] * count + edges[:, 0])
    if (forward[1:] == forward[:-1]).any() or not np.array_equal(forward, backward):
        return False
    part = _parts(edges, count)[welded[:, 0]]
    points = positions[first].astype(float)
    points -= points.mean(0)
    a, b, c = (points[welded[:, i]] for i in range(3))
    volume = np.bincount(part, (a * np.cross(b, c)).sum(1), minlength=count)
    return bool((volume[np.unique(part)] > 0.0).all())


def _parts(edges: np.ndarray, count: int) -> np.ndarray:
    """(count,) the least vertex that each vertex is connected with, by hooking and pointer jumping (Shiloach & Vishkin 1982)."""
    label = np.arange(count)
    while True:
        least = np.minimum(label[edges[:, 0]], label[edges[:, 1]])
        before = label.copy()
        np.minimum.at(label, before[edges[:, 0]], least)
        np.minimum.at(label, before[edges[:, 1]], least)
        label = label[label]
        if np.array_equal(label, before):
            return label
