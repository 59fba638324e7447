"""What a moved mesh does to points on it and near it: which ride along, and which are covered."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from irrsplat.core.vectors import unit
from irrsplat.scene.flatten import in_order
from irrsplat.scene.model import Mesh, Scene

COVERED = 0.25  # of what a point sees, by the cosine: where more is, records would no longer stand where they are wanted
_SAMPLES = 128  # points on a mesh that stand for its surface
_TURN = np.array([0.7548776662466927, 0.5698402909980532])  # Roberts's R2 sequence: even in the square, whatever the number
_RIGID = 1e-3  # by how much a turn of rounded triangles is none


def _of_moved(triangle: np.ndarray, before: Scene, after: Scene) -> Iterator[tuple[Mesh, Mesh, np.ndarray, np.ndarray]]:
    """Of each mesh that has moved: what it was, what it is, which of the triangles' numbers (N,) are its own, and as what number
    in the mesh."""
    start, first = 0, {}
    for mesh in in_order(before):
        first[id(mesh)] = start
        start += len(mesh.faces)
    for old, new in zip(before.meshes, after.meshes, strict=True):
        if old is not new and len(old.faces):
            inside = triangle - first[id(old)]
            yield old, new, (inside >= 0) & (inside < len(old.faces)), inside


def untouched(position: np.ndarray, normal: np.ndarray, triangle: np.ndarray, before: Scene, after: Scene) -> np.ndarray:
    """(N,) True for points on surfaces, with their normals (N, 3) and triangles' numbers (N,), that see no more than COVERED of
    what they see taken by what has moved, where it was or where it is; points on that itself always do.

    triangle: -1 where it is not known; such a point is not left where it lay in the bounding box of what has moved.
    """
    kept = np.ones(len(position), bool)
    for old, new, own, _ in _of_moved(triangle, before, after):
        within = ((position >= old.positions.min(0)) & (position <= old.positions.max(0))).all(1)
        kept &= ~((triangle < 0) & within)
        asked = kept & ~own
        kept[asked] = np.maximum(*(covered(position[asked], normal[asked], mesh) for mesh in (old, new))) <= COVERED
    return kept


@dataclass(frozen=True)
class Ride:
    """How points on meshes move with them: the numbers (K,) of those that do, their new places (K, 3), the linear maps (K, 3, 3)
    that take vectors along, and whether (K,) these are turns, by which nothing else changes."""

    numbers: np.ndarray
    position: np.ndarray
    turn: np.ndarray
    rigid: np.ndarray

    def normals(self, normals: np.ndarray) -> np.ndarray:
        """Unit normals (K, 3) there, of those before."""
        return unit(np.einsum("nji,nj->ni", np.linalg.pinv(self.turn), normals))


def ride(position: np.ndarray, triangle: np.ndarray, before: Scene, after: Scene) -> Ride:
    """Of points (N, 3) on triangles of these numbers (N,) those that have moved with a mesh: by their triangle's corners."""
    parts = [Ride(np.zeros(0, np.intp), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, bool))]
    for old, new, own, inside in _of_moved(triangle, before, after):
        numbers = np.flatnonzero(own)
        faces = old.faces[inside[numbers]]
        was, now = (mesh.positions[faces].astype(float) for mesh in (old, new))
        frames = [_frame(was), _frame(now)]
        if np.array_equal(old.faces, new.faces[:, ::-1]):  # mirrored, and wound anew
            frames[1][:, :, 2] *= -1.0
        turn = frames[1] @ np.linalg.pinv(frames[0])  # which takes triangles that rounding has flattened, too
        place = now[:, 0] + np.einsum("nij,nj->ni", turn, position[numbers] - was[:, 0])
        rigid = np.abs(np.swapaxes(turn, 1, 2) @ turn - np.eye(3)).max((1, 2)) < _RIGID
        parts.append(Ride(numbers, place, turn, rigid & (np.linalg.det(turn) > 0.0)))
    return Ride(*(np.concatenate([getattr(part, name.name) for part in parts]) for name in fields(Ride)))


def _frame(corners: np.ndarray) -> np.ndarray:
    """(N, 3, 3) with the columns of two edges and the unit normal of triangles (N, 3, 3)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.stack([first, second, unit(np.cross(first, second))], axis=-1)


def covered(position: np.ndarray, normal: np.ndarray, mesh: Mesh) -> np.ndarray:
    """(N,) at most how much a mesh covers of what points with these normals (N, 3) see, weighted by the cosine; 1 is all of it.

    The form factors of discs about samples of its surface, A·cosθ·cosθ'/(π·d² + A); those of its far side count as well, so that
    a closed mesh has up to twice what it covers.
    """
    centre = 0.5 * (mesh.positions.min(0) + mesh.positions.max(0)).astype(float)
    place, facing, area = _samples(mesh)
    # about its centre, in float32: sums of squares hold no more than they need
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
    u, v = np.modf((np.arange(_SAMPLES)[:, None] + 0.5) * _TURN)[0].T
    u, v = np.where(u + v > 1.0, (1.0 - u, 1.0 - v), (u, v))
    place = a[chosen] + u[:, None] * (b - a)[chosen] + v[:, None] * (c - a)[chosen]
    return place, cross[chosen] / np.maximum(size[chosen], 1e-300)[:, None], 0.5 * float(sums[-1]) / _SAMPLES
