"""What a moved mesh does to records: those on it are carried along, those near it are dropped."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from irrsplat.core.vectors import unit
from irrsplat.scene.looks import in_order
from irrsplat.scene.model import Mesh, Scene

COVERED = 0.25  # share of a point's hemisphere, weighted by the cosine: where a moved mesh covers more, new records are wanted
_SAMPLES = 128  # points on a mesh that stand for its surface
_R2 = np.array([0.7548776662466927, 0.5698402909980532])  # Roberts's R2 sequence (2018): even in the square for any length
_RIGID = 1e-3  # how far, by rounding of its triangles, the map of a rigid motion may be from a rotation


def _of_moved(triangle: np.ndarray, before: Scene, after: Scene) -> Iterator[tuple[Mesh, Mesh, np.ndarray, np.ndarray]]:
    """Of each mesh that has moved: the mesh before and after, a mask (N,) of the `triangle` numbers that are its own, and these
    numbers counted within the mesh."""
    start, first = 0, {}
    for mesh in in_order(before):
        first[id(mesh)] = start
        start += len(mesh.faces)
    for old, new in zip(before.meshes, after.meshes, strict=True):
        if old is not new and len(old.faces):
            inside = triangle - first[id(old)]
            yield old, new, (inside >= 0) & (inside < len(old.faces)), inside


def untouched(position: np.ndarray, normal: np.ndarray, triangle: np.ndarray, before: Scene, after: Scene) -> np.ndarray:
    """(N,) True for points of whose hemisphere no moved mesh covers more than COVERED, where it was or where it is.

    position, normal: (N, 3). triangle: (N,) numbers of the points' triangles; points on a moved mesh itself are always True.
    -1: not known; such a point is False if it lies in the bounding box of where a moved mesh was.
    """
    kept = np.ones(len(position), bool)
    for old, new, own, _ in _of_moved(triangle, before, after):
        within = ((position >= old.positions.min(0)) & (position <= old.positions.max(0))).all(1)
        kept &= ~((triangle < 0) & within)
        near = kept & ~own
        kept[near] = np.maximum(*(covered(position[near], normal[near], mesh) for mesh in (old, new))) <= COVERED
    return kept


@dataclass(frozen=True)
class Carried:
    """Points that a moved mesh carries along: their numbers (K,), new positions (K, 3), the linear maps (K, 3, 3) of vectors at
    them, and whether (K,) these are rotations, which change nothing but directions."""

    numbers: np.ndarray
    position: np.ndarray
    linear_map: np.ndarray
    rigid: np.ndarray

    def normals(self, normals: np.ndarray) -> np.ndarray:
        """Unit normals (K, 3) after the move, of those before: they go by the inverse transpose."""
        return unit(np.einsum("nji,nj->ni", np.linalg.pinv(self.linear_map), normals))


def carried(position: np.ndarray, triangle: np.ndarray, before: Scene, after: Scene) -> Carried:
    """Those of the points (N, 3), on triangles of these numbers (N,), that move with a mesh, as their triangles' corners do."""
    parts = [Carried(np.zeros(0, np.intp), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, bool))]
    for old, new, own, inside in _of_moved(triangle, before, after):
        numbers = np.flatnonzero(own)
        faces = old.faces[inside[numbers]]
        was, now = (mesh.positions[faces].astype(float) for mesh in (old, new))
        frames = [_frame(was), _frame(now)]
        if np.array_equal(old.faces, new.faces[:, ::-1]):  # mirrored: its triangles are wound the other way
            frames[1][:, :, 2] *= -1.0
        linear_map = frames[1] @ np.linalg.pinv(frames[0])  # pinv: rounding may have flattened a triangle
        place = now[:, 0] + np.einsum("nij,nj->ni", linear_map, position[numbers] - was[:, 0])
        rigid = np.abs(np.swapaxes(linear_map, 1, 2) @ linear_map - np.eye(3)).max((1, 2)) < _RIGID
        parts.append(Carried(numbers, place, linear_map, rigid & (np.linalg.det(linear_map) > 0.0)))
    return Carried(*(np.concatenate([getattr(part, name.name) for part in parts]) for name in fields(Carried)))


def _frame(corners: np.ndarray) -> np.ndarray:
    """(N, 3, 3) with the columns of two edges and the unit normal of triangles (N, 3, 3)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.stack([first, second, unit(np.cross(first, second))], axis=-1)


def covered(position: np.ndarray, normal: np.ndarray, mesh: Mesh) -> np.ndarray:
    """(N,) an upper bound of the share of the hemispheres of points with these normals (N, 3) that a mesh covers, by the cosine.

    Sums the form factors of discs about samples of its surface, A·cosθ·cosθ'/(π·d² + A). Its far side counts as well, so that the
    sum is up to twice what a closed mesh covers.
    """
    centre = 0.5 * (mesh.positions.min(0) + mesh.positions.max(0)).astype(float)
    place, facing, area = _samples(mesh)
    # relative to its centre, so that float32 is exact enough for the squares
    p, q = (position - centre).astype("f4"), (place - centre).astype("f4")
    n, m = normal.astype("f4"), facing.astype("f4")
    square = np.maximum((p * p).sum(1)[:, None] + (q * q).sum(1) - 2.0 * (p @ q.T), np.float32(1e-12))
    here = np.maximum(n @ q.T - (n * p).sum(1)[:, None], 0.0)
    there = np.abs(p @ m.T - (q * m).sum(1))
    share: np.ndarray = (here * there / (square * (np.pi * square / np.float32(area) + 1.0))).sum(1)
    return share


def _samples(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, float]:
    """_SAMPLES points (S, 3) spread evenly over a mesh, the normals of their triangles (S, 3), and the area of each, m²."""
    a, b, c = mesh.positions[mesh.faces].astype(float).swapaxes(0, 1)
    cross = np.cross(b - a, c - a)
    size = np.linalg.norm(cross, axis=1)
    sums = np.cumsum(size)
    chosen = np.minimum(np.searchsorted(sums, (np.arange(_SAMPLES) + 0.5) / _SAMPLES * sums[-1]), len(sums) - 1)
    u, v = np.modf((np.arange(_SAMPLES)[:, None] + 0.5) * _R2)[0].T
    u, v = np.where(u + v > 1.0, (1.0 - u, 1.0 - v), (u, v))
    place = a[chosen] + u[:, None] * (b - a)[chosen] + v[:, None] * (c - a)[chosen]
    return place, cross[chosen] / np.maximum(size[chosen], 1e-300)[:, None], 0.5 * float(sums[-1]) / _SAMPLES
