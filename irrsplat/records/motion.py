"""Records and moved meshes: records on a mesh move with it; records inside it are dropped."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from irrsplat.core.buffers import Sites
from irrsplat.core.vectors import unit
from irrsplat.scene.appearance import in_order
from irrsplat.scene.change import SceneChange
from irrsplat.scene.model import Mesh
from irrsplat.scene.spatial.solids import enclosed, in_box

_LIFT = 1e-3  # of a mesh's diagonal: height above its surface of the tested point
_ON_IT = 0.3  # for points on a moved mesh: all their surroundings move relative to them, though most are far away
_LEAST_CONCERN = 0.01  # for points that do not see a moved mesh, but may see its shadow
_RIGID = 1e-3  # greatest deviation from a rotation that rounding of triangles gives the map of a rigid motion


def of_meshes(
    triangle: np.ndarray, change: SceneChange, chosen: Sequence[int]
) -> Iterator[tuple[Mesh, Mesh, np.ndarray, np.ndarray]]:
    """Yield each of the `chosen` meshes before and after, a mask (N,) of the `triangle` numbers on it, and these numbers within
    the mesh."""
    start, first = 0, {}
    for mesh in in_order(change.old):
        first[id(mesh)] = start
        start += len(mesh.faces)
    for old, new in ((change.old.meshes[i], change.new.meshes[i]) for i in chosen):
        if len(old.faces):
            inside = triangle - first[id(old)]
            yield old, new, (inside >= 0) & (inside < len(old.faces)), inside


def swallowed(position: np.ndarray, normal: np.ndarray, triangle: np.ndarray, change: SceneChange) -> np.ndarray:
    """Return (N,) True for points with normals (N, 3) that a moved mesh encloses, but that are not on it, or on a vanished mesh.

    triangle: (N,) numbers of the points' triangles; -1: not known. Points without triangle count if they lie in the former
    bounding box of a moved mesh.
    """
    found = np.zeros(len(position), bool)
    for old, new, own, _ in of_meshes(triangle, change, change.moved):
        found |= (triangle < 0) & in_box(position, old)
        lift = _LIFT * float(np.linalg.norm(np.ptp(new.positions, axis=0)))
        found |= own & new.is_point
        near = np.flatnonzero(~own & ~found & in_box(position, new, lift))
        found[near] = enclosed(position[near] + lift * normal[near], normal[near], new)
    return found


def concerned(position: np.ndarray, normal: np.ndarray, triangle: np.ndarray, change: SceneChange) -> np.ndarray:
    """Return (N,) an estimate of the changed share of the view of points with normals (N, 3).

    The cosine-weighted shares of their hemispheres within the bounding spheres of moved meshes, before and after; _ON_IT for
    points on such a mesh; _LEAST_CONCERN is added everywhere.
    """
    found = np.full(len(position), _LEAST_CONCERN)
    for old, new, own, _ in of_meshes(triangle, change, change.moved):
        found += np.where(own, _ON_IT, _covered(position, normal, old) + _covered(position, normal, new))
    return found


def _covered(position: np.ndarray, normal: np.ndarray, mesh: Mesh) -> np.ndarray:
    """Return (N,) an estimate of the share of points' hemispheres within a mesh's bounding sphere."""
    low, high = mesh.bounds.astype(float)
    way, radius = 0.5 * (low + high) - position, 0.5 * float(np.linalg.norm(high - low))
    far = np.maximum(np.linalg.norm(way, axis=1), 1e-30)
    height = np.clip(((way * normal).sum(1) + radius) / (far + radius), 0.0, 1.0)  # 0 for a sphere below the horizon
    return np.asarray(height * np.minimum(radius / far, 1.0) ** 2)


@dataclass(frozen=True)
class Carried:
    """Points on moved meshes: numbers (K,), new positions (K, 3), linear maps (K, 3, 3) of vectors at them.

    rigid: (K,) True for rotations, which change directions only.
    """

    numbers: np.ndarray
    position: np.ndarray
    linear_map: np.ndarray
    rigid: np.ndarray

    def normals(self, normals: np.ndarray) -> np.ndarray:
        """Return the unit normals (K, 3) after the move: mapped by the inverse transpose, which equals a rotation."""
        inverse = np.swapaxes(self.linear_map, 1, 2).copy()
        inverse[~self.rigid] = np.linalg.pinv(self.linear_map[~self.rigid])
        return unit(np.einsum("nji,nj->ni", inverse, normals))

    def write(self, columns: Mapping[str, np.ndarray]) -> None:
        """Overwrite `position`, `normal` and `geometric` of the moved points in these columns of all points, (N, 3) or (N, 4)."""
        columns["position"][self.numbers, :3] = self.position
        for name in ("normal", "geometric"):
            columns[name][self.numbers, :3] = self.normals(columns[name][self.numbers, :3])


def carried(position: np.ndarray, triangle: np.ndarray, change: SceneChange) -> Carried:
    """Return the points (N, 3), on triangles of these numbers (N,), that move with a mesh, mapped by their triangles' corners."""
    parts = [Carried(np.zeros(0, np.intp), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, bool))]
    for old, new, own, inside in of_meshes(triangle, change, change.moved):
        numbers = np.flatnonzero(own)
        triangles, which = np.unique(inside[numbers], return_inverse=True)  # many points share a triangle
        faces = old.faces[triangles]
        was, now = (mesh.positions[faces].astype(float) for mesh in (old, new))
        frames = [_frame(was), _frame(now)]
        if np.array_equal(old.faces, new.faces[:, ::-1]):  # mirrored: reversed winding of the triangles
            frames[1][:, :, 2] *= -1.0
        linear_map = frames[1] @ np.linalg.pinv(frames[0])  # pinv: rounding may have flattened a triangle
        rigid = np.abs(np.swapaxes(linear_map, 1, 2) @ linear_map - np.eye(3)).max((1, 2)) < _RIGID
        rigid &= np.linalg.det(linear_map) > 0.0
        place = now[which, 0] + np.einsum("nij,nj->ni", linear_map[which], position[numbers] - was[which, 0])
        parts.append(Carried(numbers, place, linear_map[which], rigid[which]))
    return Carried(*(np.concatenate([getattr(part, name.name) for part in parts]) for name in fields(Carried)))


def moved_sites(sites: Sites, change: SceneChange) -> Sites:
    """Return `sites`, whose triangles are known, with those on moved meshes carried along."""
    assert sites.triangle is not None
    columns = {name: getattr(sites, name).copy() for name in ("position", "normal", "geometric")}
    carried(sites.position, sites.triangle, change).write(columns)
    return replace(sites, **columns)


def _frame(corners: np.ndarray) -> np.ndarray:
    """Return (N, 3, 3) with the columns of two edges and the unit normal of triangles (N, 3, 3)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.stack([first, second, unit(np.cross(first, second))], axis=-1)
