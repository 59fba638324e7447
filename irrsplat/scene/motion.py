"""Meshes that move: the scene with one of them elsewhere, what moves with it, and which points that leaves as they were."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.scene.flatten import in_order
from irrsplat.scene.io.lines import quote
from irrsplat.scene.io.mesh_builder import times, unit
from irrsplat.scene.model import Mesh, Scene

COVERED = 0.25  # of what a point sees, by the cosine: where more is, records would no longer stand where they are wanted
_SAMPLES = 128  # points on a mesh that stand for its surface
_TURN = np.array([0.7548776662466927, 0.5698402909980532])  # Roberts's R2 sequence: even in the square, whatever the number
_RIGID = 1e-3  # by how much a turn of rounded triangles is none
_FLAT = 1e-12  # of the longest edge of its unit cube, cubed: a matrix that leaves less volume collapses a mesh


def moved(scene: Scene, loaded: Sequence[Mesh], mesh: int | str, transform: Any) -> Scene:
    """The scene with `mesh`, an index or the name of one mesh, where the matrix takes it from where it was `loaded`.

    transform: (4, 4) or (3, 4) affine, world_from_world. Triangles keep their numbers; a mirrored mesh is wound anew, so that a
    closed one stays so. Raises InputError for a mesh that is not there and a matrix that is none.
    """
    number, matrix = find(scene, mesh), affine(transform)
    meshes = list(scene.meshes)
    meshes[number] = transformed(loaded[number], matrix)
    return replace(scene, meshes=tuple(meshes))


def find(scene: Scene, mesh: int | str) -> int:
    """The index of the mesh; raises InputError, with those there are, where there is no such one or several have the name."""
    count = len(scene.meshes)
    if isinstance(mesh, str):
        found = [i for i, one in enumerate(scene.meshes) if one.name == mesh]
        if len(found) == 1:
            return found[0]
        if found:
            raise InputError(f"{len(found)} meshes are called {quote(mesh)}; give an index: {', '.join(map(str, found))}")
        names = ", ".join(dict.fromkeys(quote(one.name) for one in scene.meshes if one.name)) or "none"
        raise InputError(f"there is no mesh {quote(mesh)}; the named meshes here: {names}")
    if not isinstance(mesh, (int, np.integer)) or isinstance(mesh, bool):
        raise InputError(f"a mesh is given by its index or its name, not by {type(mesh).__name__}")
    if not 0 <= mesh < count:
        raise InputError(f"there is no mesh {mesh}; the scene has {count}, counted from 0")
    return int(mesh)


def affine(transform: Any) -> np.ndarray:
    """(4, 4) float64 of a 4×4 or 3×4 matrix; raises InputError where it is none, is not affine, or cannot be undone."""
    try:
        given = np.asarray(transform, float)
    except (TypeError, ValueError):
        raise InputError("a transform is a 4x4 or 3x4 matrix of numbers") from None
    if given.shape not in ((4, 4), (3, 4)):
        raise InputError(f"a transform is a 4x4 or 3x4 matrix, not one of shape {'x'.join(map(str, given.shape)) or 'a number'}")
    if not np.isfinite(given).all():
        raise InputError("every number of a transform must be finite")
    matrix = np.eye(4)
    matrix[: len(given)] = given
    if (matrix[3] != (0.0, 0.0, 0.0, 1.0)).any():
        raise InputError("the last row of a transform is 0 0 0 1: points are columns, and the last column says how far it moves")
    if not abs(np.linalg.det(matrix[:3, :3])) > _FLAT * np.abs(matrix[:3, :3]).max() ** 3:
        raise InputError("the transform is singular: it would flatten the mesh")
    return matrix


def transformed(mesh: Mesh, matrix: np.ndarray) -> Mesh:
    """The mesh where an affine matrix (4, 4) takes it; raises InputError beyond what float32 holds."""
    with np.errstate(over="ignore"):
        positions = (times(mesh.positions.astype(float), matrix[:3, :3]) + matrix[:3, 3]).astype(np.float32)
    if not np.isfinite(positions).all():
        raise InputError("the transform takes the mesh beyond what 32-bit floats hold")
    normals = unit(times(mesh.normals.astype(float), np.linalg.inv(matrix[:3, :3]).T)).astype(np.float32)
    mirrored = np.linalg.det(matrix[:3, :3]) < 0.0
    return replace(mesh, positions=positions, normals=normals, faces=mesh.faces[:, ::-1].copy() if mirrored else mesh.faces)


# ---- what a move leaves as it was -------------------------------------------------------------------------------------


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
