"""What a moved mesh does to records: those on it are carried along, those near it, or carried through a surface, are dropped."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from irrsplat.core.vectors import unit
from irrsplat.scene.change import SceneChange
from irrsplat.scene.looks import in_order
from irrsplat.scene.model import Mesh

_INSIDE = 0.3  # a point about which a mesh winds more often than that is taken to be within
_LIFT = 1e-3  # of a mesh's diagonal: how far above its surface a point is held against the mesh
_AT_ONCE = 1 << 18  # pairs of a point and a triangle
_ON_IT = 0.3  # for points on what has moved: all around them is elsewhere, though most of it is far away
_LEAST_CONCERN = 0.01  # for points that see nothing of what has moved, but perhaps its shadow
_SHORTEST = 1e-4  # of a way: parts of it are not cut further
_ROUNDING = 1e-6  # of the coordinates: a point that is nearer to a plane has not passed through it
_RIGID = 1e-3  # how far, by rounding of its triangles, the map of a rigid motion may be from a rotation


def _of_moved(triangle: np.ndarray, change: SceneChange) -> Iterator[tuple[Mesh, Mesh, np.ndarray, np.ndarray]]:
    """Of each mesh that has moved: the mesh before and after, a mask (N,) of the `triangle` numbers that are its own, and these
    numbers counted within the mesh."""
    start, first = 0, {}
    for mesh in in_order(change.old):
        first[id(mesh)] = start
        start += len(mesh.faces)
    for old, new in change.moved_pairs:
        if len(old.faces):
            inside = triangle - first[id(old)]
            yield old, new, (inside >= 0) & (inside < len(old.faces)), inside


def swallowed(position: np.ndarray, normal: np.ndarray, triangle: np.ndarray, change: SceneChange) -> np.ndarray:
    """(N,) True for points, with these normals (N, 3), that lie within a moved mesh where it is now, but not on it, and for those
    on one that has vanished.

    triangle: (N,) numbers of the points' triangles; -1: not known, and then a point counts that lies in the bounding box of where
    a moved mesh was.
    """
    found = np.zeros(len(position), bool)
    for old, new, own, _ in _of_moved(triangle, change):
        found |= (triangle < 0) & _within(position, old)
        lift = _LIFT * float(np.linalg.norm(np.ptp(new.positions, axis=0)))
        found |= own & new.is_point
        near = np.flatnonzero(~own & ~found & _within(position, new, lift))
        found[near] = np.abs(winding(position[near] + lift * normal[near], new)) > _INSIDE
    return found


def _within(position: np.ndarray, mesh: Mesh, margin: float = 0.0) -> np.ndarray:
    """(N,) whether points lie in the bounding box of a mesh, or `margin` metres beside it."""
    low, high = mesh.positions.min(0) - margin, mesh.positions.max(0) + margin
    within: np.ndarray = ((position >= low) & (position <= high)).all(1)
    return within


def winding(position: np.ndarray, mesh: Mesh) -> np.ndarray:
    """(N,) how often a mesh winds about points (N, 3): 1 within a closed one, 0 beside it; less where it is open.

    The sum of its triangles' solid angles (van Oosterom and Strackee 1983) over 4π.
    """
    sums = np.zeros(len(position))
    step = max(1, _AT_ONCE // max(len(position), 1))
    for start in range(0, len(mesh.faces), step):
        a, b, c = (mesh.positions[mesh.faces[start : start + step]].astype(float)[:, k] - position[:, None] for k in range(3))
        x, y, z = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
        volume = (a * np.cross(b, c)).sum(-1)
        sums += np.arctan2(volume, x * y * z + (a * b).sum(-1) * z + (b * c).sum(-1) * x + (c * a).sum(-1) * y).sum(1)
    return sums / (2.0 * np.pi)


def passed_through(start: np.ndarray, end: np.ndarray, change: SceneChange) -> np.ndarray:
    """(N,) whether a triangle that has not moved stands between points (N, 3) and others (N, 3), metres.

    What a mesh has carried through a floor sees other light than what is above, and may be near enough to speak for it.
    """
    found = np.zeros(len(start), bool)
    if not len(start):
        return found
    low, high = np.minimum(start, end).min(0), np.maximum(start, end).max(0)
    for number, mesh in enumerate(change.old.meshes):
        beside = number in change.moved or not len(mesh.faces)
        if not beside and (mesh.positions.min(0) <= high).all() and (mesh.positions.max(0) >= low).all():
            found |= _blocked(start, end, mesh.positions[mesh.faces])
    return found


def _blocked(start: np.ndarray, end: np.ndarray, corners: np.ndarray, part: tuple[float, float] = (0.0, 1.0)) -> np.ndarray:
    """(N,) the same of triangles (T, 3, 3) in the box about a `part` of the ways. Where these are many, ways that are longer than
    the points lie apart are cut in halves, and else the points are parted, so that each has its own few."""
    begins, ends = (start + share * (end - start) for share in part)
    low, high = np.minimum(begins, ends).min(0), np.maximum(begins, ends).max(0)
    corners = corners[((corners.min(1) <= high) & (corners.max(1) >= low)).all(1)]
    found = np.zeros(len(start), bool)
    if len(start) * len(corners) <= _AT_ONCE:
        return _crosses(start, end, corners)
    apart = np.ptp(begins, axis=0)
    if np.abs(ends - begins).max() > apart.max() and part[1] - part[0] > _SHORTEST:
        middle = 0.5 * (part[0] + part[1])
        for half in ((part[0], middle), (middle, part[1])):
            left = np.flatnonzero(~found)
            if len(left):
                found[left] = _blocked(start[left], end[left], corners, half)
        return found
    if len(start) > 1:
        order = np.argsort(begins[:, np.argmax(apart)], kind="stable")
        for some in (order[: len(start) // 2], order[len(start) // 2 :]):
            found[some] = _blocked(start[some], end[some], corners, part)
        return found
    return _crosses(start, end, corners)


def _crosses(start: np.ndarray, end: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(N,) whether the whole ways cross one of the triangles (T, 3, 3)."""
    found = np.zeros(len(start), bool)
    a, b, c = corners.astype(float).swapaxes(0, 1)
    normal = unit(np.cross(b - a, c - a))
    before, after = (points @ normal.T - (a * normal).sum(1) for points in (start, end))
    rounding = _ROUNDING * max(float(np.abs(start).max()), float(np.abs(end).max()))
    points, triangles = np.nonzero((before * after < 0.0) & (np.abs(after) > rounding))
    height = before[points, triangles]
    share = height / (height - after[points, triangles])
    at = start[points] + share[:, None] * (end[points] - start[points])
    three = corners[triangles].astype(float)
    sides = np.cross(np.roll(three, -1, axis=1) - three, at[:, None] - three)
    found[points[((sides * normal[triangles, None]).sum(-1) >= 0.0).all(1)]] = True
    return found


def concerned(position: np.ndarray, normal: np.ndarray, triangle: np.ndarray, change: SceneChange) -> np.ndarray:
    """(N,) about how much of what points with these normals (N, 3) see has changed: the shares of their hemispheres, weighted by
    the cosine, that the bounding spheres of moved meshes covered and cover; on these _ON_IT. _LEAST_CONCERN more everywhere."""
    found = np.full(len(position), _LEAST_CONCERN)
    for old, new, own, _ in _of_moved(triangle, change):
        found += np.where(own, _ON_IT, _covered(position, normal, old) + _covered(position, normal, new))
    return found


def _covered(position: np.ndarray, normal: np.ndarray, mesh: Mesh) -> np.ndarray:
    """(N,) about the share of points' hemispheres that a mesh's bounding sphere covers."""
    low, high = mesh.positions.min(0).astype(float), mesh.positions.max(0).astype(float)
    way, radius = 0.5 * (low + high) - position, 0.5 * float(np.linalg.norm(high - low))
    far = np.maximum(np.linalg.norm(way, axis=1), 1e-30)
    height = np.clip(((way * normal).sum(1) + radius) / (far + radius), 0.0, 1.0)  # 0 where it is below the horizon
    share: np.ndarray = height * np.minimum(radius / far, 1.0) ** 2
    return share


@dataclass(frozen=True)
class Carried:
    """Points that a moved mesh carries along: their numbers (K,), new positions (K, 3), the linear maps (K, 3, 3) of vectors at
    them, and whether (K,) these are rotations, which change nothing but directions."""

    numbers: np.ndarray
    position: np.ndarray
    linear_map: np.ndarray
    rigid: np.ndarray

    def normals(self, normals: np.ndarray) -> np.ndarray:
        """Unit normals (K, 3) after the move, of those before: they go by the inverse transpose, which is a rotation itself."""
        inverse = np.swapaxes(self.linear_map, 1, 2).copy()
        inverse[~self.rigid] = np.linalg.pinv(self.linear_map[~self.rigid])
        return unit(np.einsum("nji,nj->ni", inverse, normals))


def carried(position: np.ndarray, triangle: np.ndarray, change: SceneChange) -> Carried:
    """Those of the points (N, 3), on triangles of these numbers (N,), that move with a mesh, as their triangles' corners do."""
    parts = [Carried(np.zeros(0, np.intp), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, bool))]
    for old, new, own, inside in _of_moved(triangle, change):
        numbers = np.flatnonzero(own)
        triangles, which = np.unique(inside[numbers], return_inverse=True)  # many points lie on one
        faces = old.faces[triangles]
        was, now = (mesh.positions[faces].astype(float) for mesh in (old, new))
        frames = [_frame(was), _frame(now)]
        if np.array_equal(old.faces, new.faces[:, ::-1]):  # mirrored: its triangles are wound the other way
            frames[1][:, :, 2] *= -1.0
        linear_map = frames[1] @ np.linalg.pinv(frames[0])  # pinv: rounding may have flattened a triangle
        rigid = np.abs(np.swapaxes(linear_map, 1, 2) @ linear_map - np.eye(3)).max((1, 2)) < _RIGID
        rigid &= np.linalg.det(linear_map) > 0.0
        place = now[which, 0] + np.einsum("nij,nj->ni", linear_map[which], position[numbers] - was[which, 0])
        parts.append(Carried(numbers, place, linear_map[which], rigid[which]))
    return Carried(*(np.concatenate([getattr(part, name.name) for part in parts]) for name in fields(Carried)))


def _frame(corners: np.ndarray) -> np.ndarray:
    """(N, 3, 3) with the columns of two edges and the unit normal of triangles (N, 3, 3)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.stack([first, second, unit(np.cross(first, second))], axis=-1)
