"""The subject of a scene: all of it, or the part in front of a far larger ground or backdrop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irrsplat.scene.model import Mesh, Scene

_MOST_VERTICES = 200_000  # vertices that are examined
_OUTLIERS = 0.005  # of the vertices, at either end of each axis: those of a ground or backdrop
_SUBJECT_SIZE = 0.25  # of the scene's diagonal: a smaller part with nearly all vertices is the subject
_MARGIN = 0.5  # of the subject's diagonal: margin for objects that belong to it, such as walls around furniture
_SPLITS = 16  # at most; each halves the edges of a triangle that extends beyond the subject


def subject(scene: Scene) -> Scene:
    """Return the scene cut to its subject: a small part with nearly all vertices, if there is one, else all of it."""
    count = sum(len(mesh.positions) for mesh in scene.meshes)
    if not count:
        return scene
    step = -(-count // _MOST_VERTICES)
    vertices = np.concatenate([mesh.positions[::step] for mesh in scene.meshes]).astype(float)
    low, high = np.quantile(vertices, (_OUTLIERS, 1.0 - _OUTLIERS), axis=0)
    size = float(np.linalg.norm(high - low))
    if size >= _SUBJECT_SIZE * scene.diagonal or size == 0.0:
        return scene
    vertices = np.concatenate([mesh.positions for mesh in scene.meshes])
    near = vertices[((vertices >= low - _MARGIN * size) & (vertices <= high + _MARGIN * size)).all(1)]
    meshes = tuple(_cut(mesh, near.min(0), near.max(0)) for mesh in scene.meshes)
    return replace(scene, meshes=tuple(mesh for mesh in meshes if len(mesh.faces)))


def _cut(mesh: Mesh, low: np.ndarray, high: np.ndarray) -> Mesh:
    """Return the mesh's triangles with their centre in a box, without vertex attributes; large triangles are split first."""
    corners = mesh.positions[mesh.faces]
    if ((corners >= low) & (corners <= high)).all():
        return mesh
    largest = 0.1 * float(np.linalg.norm(high - low))
    done = []
    for _ in range(_SPLITS):
        corners = corners[((corners.max(1) >= low) & (corners.min(1) <= high)).all(1)]
        out = ((corners < low) | (corners > high)).any((1, 2)) & (np.ptp(corners, axis=1).max(1) > largest)
        done.append(corners[~out])
        a, b, c = np.moveaxis(corners[out], 1, 0)
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        corners = np.concatenate([np.stack(three, 1) for three in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    corners = np.concatenate(done)
    middle = corners.mean(1)
    corners = corners[((middle >= low) & (middle <= high)).all(1)].reshape(-1, 3)
    faces = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    return Mesh(corners, np.zeros_like(corners), faces, mesh.material, name=mesh.name)
