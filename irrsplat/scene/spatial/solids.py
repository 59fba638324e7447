"""Points within solids, where no light is measured: in closed meshes, and in meshes that lack only their bottom."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from irrsplat.core.vectors import as_float32, pairs, sphere
from irrsplat.scene.appearance import in_order
from irrsplat.scene.io.mesh_builder import is_closed
from irrsplat.scene.model import Mesh, Scene
from irrsplat.scene.seen_by_light import CLOSED, OPEN, sort_of

_AT_ONCE = 1 << 20  # pairs of a point and a triangle
_DIRECTIONS = 64  # of the whole sphere; a point tests about half of them
_ENOUGH = 3  # directions for a closed mesh
_LARGE = 200_000  # triangles of a mesh, beyond which a test takes more than about 0.06 s, in every frame of a flight
_RISE = 0.1  # least cosine between a direction and a point's normal, since flatter rays hit coplanar surfaces


def inside_solids(scene: Scene, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return (N,) True for points (N, 3) within a solid; points lie just above their surface, with unit normals (N, 3).

    A solid is a mesh whose triangles face away from the point in all tested directions; all triangles of a closed mesh may face
    inward. A mesh that contains a light, a camera or an emitter by the same test counts as a room.
    """
    found = np.zeros(len(points), bool)
    lamps = [light.position for light in scene.lights if not light.directional]
    glowing = [mesh.positions.mean(0) for mesh in scene.meshes if len(mesh.faces) and any(mesh.material.emission)]
    free = np.array([*lamps, *(camera.eye for camera in scene.cameras), *glowing], float).reshape(-1, 3)
    for mesh in scene.meshes:
        if len(mesh.faces) and sort_of(mesh) in (CLOSED, OPEN):
            near = np.flatnonzero(~found & in_box(points, mesh))
            reverse = mesh.faces[:, ::-1]
            if len(near) and not mesh.closed and is_closed(as_float32(mesh.positions), reverse):
                mesh = replace(mesh, faces=reverse, closed=True)
            near = near[enclosed(points[near], normals[near], mesh)]
            held = free[in_box(free, mesh)]
            if len(near) and not enclosed(held, np.broadcast_to(normals[near[0]], held.shape), mesh).any():
                found[near] = True
    return found


def in_the_dark(scene: Scene, unlit: Sequence[bool], eye: tuple[float, float, float]) -> bool:
    """Return True if `eye` lies within a closed mesh whose inner side no light reaches. unlit: from `unlit_interiors`.

    Meshes of more than _LARGE triangles are not tested.
    """
    place, up = np.array([eye], float), np.array([[0.0, 0.0, 1.0]])
    meshes = (mesh for mesh, dark in zip(in_order(scene), unlit, strict=True) if dark and len(mesh.faces) <= _LARGE)
    return any(in_box(place, mesh)[0] and bool(enclosed(place, up, mesh)[0]) for mesh in meshes)


def in_box(points: np.ndarray, mesh: Mesh, margin: float = 0.0) -> np.ndarray:
    """Return (N,) True for points in the mesh's bounding box, enlarged by `margin` metres."""
    return np.asarray(((points >= mesh.bounds[0] - margin) & (points <= mesh.bounds[1] + margin)).all(1))


def enclosed(points: np.ndarray, normals: np.ndarray, mesh: Mesh) -> np.ndarray:
    """Return (N,) True if every ray from points (N, 3), over the hemispheres about their normals (N, 3), leaves the mesh once
    more than it enters it."""
    tried = np.zeros(len(points), np.intp)
    left = np.arange(len(points))  # points without an escaping ray so far
    for direction in sphere(_DIRECTIONS)[(np.arange(_DIRECTIONS) * 23) % _DIRECTIONS]:  # successive ones are far apart
        asked = normals[left] @ direction > _RISE
        if mesh.closed:
            asked &= tried[left] < _ENOUGH
        some = left[asked]
        if len(some):
            tried[some] += 1
            freed = some[_exits(points[some], direction, mesh) < 1.0]
            left = np.setdiff1d(left, freed, assume_unique=True)
    return np.isin(np.arange(len(points)), left)


def _exits(points: np.ndarray, direction: np.ndarray, mesh: Mesh) -> np.ndarray:
    """Return (N,) exits minus entries of rays from points (N, 3) in a unit direction (3,) through the mesh."""
    across = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    across /= np.linalg.norm(across)
    frame = np.stack([across, np.cross(direction, across), direction])  # right-handed; rays along the last axis
    x, y, z = (points @ frame.T).T
    order = np.argsort(x)
    x, y, z = x[order], y[order], z[order]
    corners = mesh.positions.astype(float) @ frame.T
    along_x = np.stack([corners[:, 0][mesh.faces[:, k]] for k in range(3)])  # reductions over a short last axis are slow
    first = np.searchsorted(x, along_x.min(0), "right")
    count = np.searchsorted(x, along_x.max(0), "left") - first
    exits = np.zeros(len(points))
    for _, which, place in pairs(first, count, _AT_ONCE):
        a, b, c = (corners[mesh.faces[which, k]] - np.stack([x[place], y[place], z[place]], 1) for k in range(3))
        shares = np.stack([p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((b, c), (c, a), (a, b))])  # twice the areas
        sign = np.where((shares > 0.0).all(0), 1.0, np.where((shares < 0.0).all(0), -1.0, 0.0))  # +1: back-facing
        height = (shares * np.stack([a[:, 2], b[:, 2], c[:, 2]])).sum(0) * sign
        exits += np.bincount(place, np.where(height > 0.0, sign, 0.0), len(points))
    return exits[np.argsort(order)]
