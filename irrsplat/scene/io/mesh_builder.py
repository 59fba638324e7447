"""Makes a `Mesh` of raw triangles: transform, normals, no degenerate triangles, and whether it is closed."""

from __future__ import annotations

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.vectors import cross as cross_product
from irrsplat.core.vectors import times, unit
from irrsplat.scene.model import Material, Mesh

_FLAT = 1e-12  # twice the area over the longest edge squared; less is rounding, no triangle


def build_mesh(
    positions: np.ndarray,
    corners: np.ndarray,
    normals: np.ndarray,
    corner_normals: np.ndarray | None,
    matrix: np.ndarray,
    material: Material,
    colors: np.ndarray | None = None,
    name: str = "",
    *,
    uvs: np.ndarray | None = None,
    corner_uvs: np.ndarray | None = None,
    opacities: np.ndarray | None = None,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[Mesh, int]:
    """A Mesh in world space, relative to `origin`, and how many degenerate triangles were dropped on the way.

    positions: (V, 3) object space. corners: (F, 3) into positions. normals: (N, 3) object space, of any length.
    corner_normals: (F, 3) into normals, -1 for none; a triangle with a corner of none (or a zero normal) gets its face
    normal and vertices of its own. None: normals are (V, 3), one for each position. matrix: (4, 4) world_from_object, affine.
    colors: (V, 3) or None. opacities: (V,) or None. uvs: (T, 4), two sets u v u v, or None. corner_uvs: (F, 3) into uvs, -1 for
    none (0 0 0 0); None: uvs are (V, 4), one for each position.
    Raises InputError (without a place) where the transform can't be inverted or leaves the range of float32.
    """
    with np.errstate(all="ignore"):
        world = times(positions, matrix[:3, :3]) + (matrix[:3, 3] - origin)
        determinant = np.linalg.det(matrix[:3, :3])
        usable = np.isfinite(determinant) and determinant != 0.0 and np.isfinite(world.astype(np.float32)).all()
    if not usable:
        raise InputError("the transformed coordinates are beyond what 32-bit floats hold, or all collapse; scale less")
    if normals.any():
        normals = unit(times(normals, np.linalg.inv(matrix[:3, :3]).T))

    a, b, c = (world[corners[:, i]] for i in range(3))
    cross = cross_product(b - a, c - a)
    double_area = np.linalg.norm(cross, axis=1)
    longest = np.max([((b - a) ** 2).sum(1), ((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)], axis=0)
    good = double_area > _FLAT * longest
    dropped = int((~good).sum())
    if dropped:
        corners, cross = corners[good], cross[good]
        corner_normals = None if corner_normals is None else corner_normals[good]
        corner_uvs = None if corner_uvs is None else corner_uvs[good]

    nonzero = np.append(normals.any(axis=1), False)  # the last one is what an index of -1 finds
    given: np.ndarray = nonzero[corners if corner_normals is None else corner_normals].all(axis=1)
    smooth, flat = np.flatnonzero(given), np.flatnonzero(~given)
    faces = np.empty((len(corners), 3), np.int32)
    columns = [array[smooth] for array in (corners, corner_normals, corner_uvs) if array is not None]
    vertices, faces[smooth] = _vertices(columns)
    faces[flat] = len(vertices[0]) + np.arange(3 * len(flat)).reshape(-1, 3)
    source = np.concatenate([vertices[0], corners[flat].reshape(-1)])
    source_normal = vertices[0] if corner_normals is None else vertices[1]
    out_normals = np.concatenate([normals[source_normal], np.repeat(unit(cross[flat]), 3, axis=0)])
    out_uvs = None
    if uvs is not None:
        source_uv = source if corner_uvs is None else np.concatenate([vertices[-1], corner_uvs[flat].reshape(-1)])
        out_uvs = uvs[source_uv].astype(np.float32)
        out_uvs[source_uv < 0] = 0.0
    out = world[source].astype(np.float32)
    mesh = Mesh(
        positions=out,
        normals=out_normals.astype(np.float32),
        faces=faces,
        material=material,
        colors=None if colors is None else colors[source].astype(np.float32),
        closed=is_closed(out, faces),
        name=name,
        uvs=out_uvs,
        opacities=None if opacities is None else opacities[source].astype(np.float32),
    )
    return mesh, dropped


def _vertices(columns: list[np.ndarray]) -> tuple[list[np.ndarray], np.ndarray]:
    """The different tuples that corners (F, 3) of several indices make, as (M,) each, in ascending order, and (F, 3) into them.

    Indices from -1 on.
    """
    if len(columns) == 1:  # no need to sort
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
    """Whether the triangles (F, 3) over positions (V, 3) bound solids and are wound outward, counter-clockwise seen from outside.

    Vertices at exactly the same place count as one. True where each edge belongs to exactly two triangles that run through it
    in opposite directions, and each connected part has a positive signed volume.
    """
    if len(faces) < 4 or len(faces) % 2:
        return False
    points = positions.astype(float)
    points -= points.mean(0)
    a, b, c = (points[faces[:, i]] for i in range(3))
    total = np.abs(cross_product(b - a, c - a).sum(0)).max()  # a closed surface's normals cancel out: most open ones end here
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
    """One vertex of each place (M,), and the number of each vertex's place (V,); positions (V, 3) float32."""
    bits = np.ascontiguousarray(positions + np.float32(0.0)).view(np.uint32).astype(np.uint64)  # + 0: no -0
    hashed = bits @ np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)  # a number for each place
    hashed ^= hashed >> np.uint64(29)
    _, first, weld = np.unique(hashed, return_index=True, return_inverse=True)
    if not np.array_equal(positions[first][weld], positions):  # two places with one number: the slow way
        _, first, weld = np.unique(positions + np.float32(0.0), axis=0, return_index=True, return_inverse=True)
    return first, weld.reshape(-1).astype(np.int64)


def _parts(edges: np.ndarray, count: int) -> np.ndarray:
    """(count,) the least vertex that each vertex is connected with, by hooking and pointer jumping (Shiloach & Vishkin 1982)."""
    label = np.arange(count)
    while len(edges):
        a, b = label[edges[:, 0]], label[edges[:, 1]]
        edges = np.stack([a, b], 1)[a != b]  # what is joined already needs no more looks
        least = np.minimum(edges[:, 0], edges[:, 1])
        np.minimum.at(label, edges[:, 0], least)
        np.minimum.at(label, edges[:, 1], least)
        while True:
            jumped = label[label]
            if np.array_equal(jumped, label):
                break
            label = jumped
    return label
