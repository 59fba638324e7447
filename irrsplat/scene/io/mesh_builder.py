"""Build meshes from raw triangles: transform, normals, removal of degenerate triangles, and the test for closed surfaces."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.vectors import cross as cross_product
from irrsplat.core.vectors import times, unit
from irrsplat.scene.io.part import Part, corner_problem
from irrsplat.scene.model import Mesh

_FLAT = 1e-12  # twice the area over the longest edge squared; smaller values are rounding errors
_HASH = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93], np.uint64)  # odd factors
_BATCH = 1 << 16  # vertices and corners that are processed together; bounds the temporary memory


@dataclass(frozen=True)
class Built:
    """The mesh of a part, or the problem that prevents it. dropped: number of degenerate triangles that are left out."""

    part: Part
    mesh: Mesh | None = None
    dropped: int = 0
    problem: str = ""

    def mesh_or_error(self, path: Path) -> Mesh:
        """Return the mesh; raise InputError with `path` where there is none."""
        if self.mesh is None:
            raise InputError(self.problem, path)
        return self.mesh


def build_meshes(parts: Iterable[Part], origin: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Iterator[Built]:
    """Yield the mesh of each part in world space, relative to `origin`, in order.

    Parts are read ahead in batches, because numpy's cost for a call exceeds that for a small part. A triangle with a missing or
    zero normal gets its face normal and vertices of its own. Problems are indices and coordinates out of range, and transforms
    that cannot be inverted or exceed the range of float32.
    """
    batch: list[Part] = []
    size = 0
    for part in parts:
        more = len(part.positions) + part.corners.size
        if batch and size + more > _BATCH:
            yield from _build_batch(batch, origin)
            batch, size = [], 0
        batch.append(part)
        size += more
    yield from _build_batch(batch, origin)


def _build_batch(parts: Sequence[Part], origin: tuple[float, float, float]) -> list[Built]:
    """Return the meshes of parts that may differ in which arrays they have."""
    layouts: dict[tuple[bool, ...], list[int]] = defaultdict(list)
    for i, part in enumerate(parts):
        arrays = part.normals, part.corner_normals, part.colors, part.uvs, part.corner_uvs, part.opacities
        layouts[tuple([array is None for array in arrays])].append(i)
    found: dict[int, Built] = {}
    for which in layouts.values():
        found |= zip(which, _build_alike([parts[i] for i in which], origin), strict=True)
    return [found[i] for i in range(len(parts))]


def _build_alike(parts: Sequence[Part], origin: tuple[float, float, float]) -> list[Built]:
    """Return the meshes of parts that have the same kinds of arrays, from their concatenation."""
    vertex_part, face_part = (_row_parts(parts, name) for name in ("positions", "corners"))
    matrices = np.stack([np.eye(4) if part.matrix is None else part.matrix for part in parts])
    turns = matrices[:, :3, :3]
    corners = _joined(parts, "corners").astype(np.int64)
    with np.errstate(all="ignore"):
        world = times(_joined(parts, "positions").astype(float), _per_row(turns, vertex_part))
        world += _per_row(matrices[:, :3, 3] - origin, vertex_part)
        determinants = np.linalg.det(turns)
        usable = np.isfinite(determinants) & (determinants != 0.0)
        usable[vertex_part[~np.isfinite(world.astype(np.float32)).all(1)]] = False
    counts = np.array([[len(part.positions)] for part in parts])
    usable[face_part[((corners < 0) | (corners >= _per_row(counts, face_part))).any(1)]] = False
    if not usable.all():
        kept = [part for part, good in zip(parts, usable, strict=True) if good]
        rest = iter(_build_alike(kept, origin) if kept else ())
        return [next(rest) if good else Built(part, problem=_problem(part)) for part, good in zip(parts, usable, strict=True)]

    normals = np.zeros((0, 3))
    if parts[0].normals is not None:
        normals = np.nan_to_num(_joined(parts, "normals").astype(float), posinf=0.0, neginf=0.0)
    if normals.any():
        with np.errstate(all="ignore"):
            inverses = np.linalg.inv(turns).transpose(0, 2, 1)
            normals = unit(times(normals, _per_row(inverses, _row_parts(parts, "normals"))))
    corners = _global(corners, parts, "positions", face_part)
    columns = [corners]  # the indices that a corner consists of
    if parts[0].corner_normals is not None:
        columns.append(_global(_joined(parts, "corner_normals"), parts, "normals", face_part))
    elif parts[0].normals is None:
        columns.append(np.full_like(corners, -1))
    if parts[0].corner_uvs is not None:
        columns.append(_global(_joined(parts, "corner_uvs"), parts, "uvs", face_part))
    return _assembled(parts, world, normals, columns, vertex_part, face_part)


def _assembled(
    parts: Sequence[Part],
    world: np.ndarray,
    normals: np.ndarray,
    columns: list[np.ndarray],
    vertex_part: np.ndarray,
    face_part: np.ndarray,
) -> list[Built]:
    """Return the meshes of concatenated triangles.

    world: (V, 3). normals: (N, 3), unit or 0. columns: (F, 3) each, indices of positions, then of normals if there are others
    than one a position, then of texture coordinates if likewise. vertex_part: (V,), face_part: (F,) numbers of parts.
    """
    a, b, c = (world[columns[0][:, i]] for i in range(3))
    cross = cross_product(b - a, c - a)
    double_area = np.linalg.norm(cross, axis=1)
    longest = np.max([((b - a) ** 2).sum(1), ((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)], axis=0)
    good = double_area > _FLAT * longest
    dropped = np.bincount(face_part[~good], minlength=len(parts))
    if dropped.any():
        columns, cross, face_part = [column[good] for column in columns], cross[good], face_part[good]

    normal_column = 0 if parts[0].corner_normals is None and parts[0].normals is not None else 1
    nonzero = np.append(normals.any(axis=1), False)  # the last row is that of index -1
    shaded: np.ndarray = nonzero[columns[normal_column]].all(axis=1)
    smooth, flat = np.flatnonzero(shaded), np.flatnonzero(~shaded)
    vertices, inverse = _vertices([column[smooth] for column in columns])
    smooth_part, flat_part = vertex_part[vertices[0]], np.repeat(face_part[flat], 3)
    smooth_counts, flat_counts = (np.bincount(which, minlength=len(parts)) for which in (smooth_part, flat_part))
    faces = np.empty((len(face_part), 3), np.int32)
    faces[smooth] = inverse - _per_row(_starts(smooth_counts)[:, None], face_part[smooth])
    flat_starts = smooth_counts - _starts(flat_counts)
    faces[flat] = np.arange(3 * len(flat)).reshape(-1, 3) + _per_row(flat_starts[:, None], face_part[flat])

    order = slice(None) if len(parts) == 1 else np.argsort(np.concatenate([smooth_part, flat_part]), kind="stable")
    sources = [np.concatenate([v, column[flat].reshape(-1)])[order] for v, column in zip(vertices, columns, strict=True)]
    out_normals = np.concatenate([normals[vertices[normal_column]], np.repeat(unit(cross[flat]), 3, axis=0)])[order]
    arrays: dict[str, np.ndarray] = {
        "positions": world[sources[0]].astype(np.float32),
        "normals": out_normals.astype(np.float32),
    }
    for name in ("colors", "opacities"):
        if getattr(parts[0], name) is not None:
            arrays[name] = _joined(parts, name)[sources[0]].astype(np.float32)
    if parts[0].uvs is not None:
        source = sources[0] if parts[0].corner_uvs is None else sources[-1]
        arrays["uvs"] = _joined(parts, "uvs")[source].astype(np.float32)
        arrays["uvs"][source < 0] = 0.0
    found = []
    vertex_ends = np.cumsum(smooth_counts + flat_counts).tolist()
    face_ends = np.cumsum(np.bincount(face_part, minlength=len(parts))).tolist()
    low = first = 0
    for part, lost, high, last in zip(parts, dropped.tolist(), vertex_ends, face_ends, strict=True):
        own = {name: array[low:high] for name, array in arrays.items()}
        own_faces = faces[first:last]
        try:
            closed = is_closed(own["positions"], own_faces)
            mesh = Mesh(faces=own_faces, material=part.material, closed=closed, name=part.name, **own)
            found.append(Built(part, mesh, lost))
        except InputError as error:
            found.append(Built(part, problem=str(error)))
        low, first = high, last
    return found


def _problem(part: Part) -> str:
    """Return the reason why a part cannot be built."""
    if problem := corner_problem(part.corners, len(part.positions)):
        return problem
    if not np.isfinite(part.positions).all():
        return "a vertex is not finite (NaN or infinity); expected finite coordinates"
    return "the transformed coordinates exceed the range of 32-bit floats, or all collapse; change the scale"


def _joined(parts: Sequence[Part], name: str) -> np.ndarray:
    """Return the parts' arrays of this name, one after another."""
    arrays: list[np.ndarray] = [getattr(part, name) for part in parts]
    return np.asarray(np.concatenate(arrays)) if len(arrays) > 1 else arrays[0]


def _row_parts(parts: Sequence[Part], name: str) -> np.ndarray:
    """Return (N,) the number of the part that each row of the joined arrays of this name belongs to."""
    return np.repeat(np.arange(len(parts)), [len(getattr(part, name)) for part in parts])


def _per_row(values: np.ndarray, row_parts: np.ndarray) -> np.ndarray:
    """Return the values (P, …) of parts for each row (N, …); those of a single part (1, …) are broadcast."""
    return values[row_parts] if len(values) > 1 else values


def _starts(counts: np.ndarray) -> np.ndarray:
    """Return the first row of each part for so many rows a part."""
    starts: np.ndarray = np.cumsum(counts) - counts
    return starts


def _global(indices: np.ndarray, parts: Sequence[Part], name: str, face_part: np.ndarray) -> np.ndarray:
    """Return indices (F, 3) into the parts' own arrays as indices into the joined ones; -1 stays."""
    if len(parts) == 1:
        return indices
    starts = _starts(np.array([len(getattr(part, name)) for part in parts]))
    return np.where(indices < 0, indices, indices + starts[face_part][:, None])


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
    total = np.abs(
        cross_product(b - a, c - a).sum(0)
    ).max()  # a closed surface's area vectors sum to 0: early exit for most open ones
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
    while len(edges):
        a, b = label[edges[:, 0]], label[edges[:, 1]]
        edges = np.stack([a, b], 1)[a != b]  # edges within a component are done
        least = np.minimum(edges[:, 0], edges[:, 1])
        np.minimum.at(label, edges[:, 0], least)
        np.minimum.at(label, edges[:, 1], least)
        while True:
            jumped = label[label]
            if np.array_equal(jumped, label):
                break
            label = jumped
    return label
