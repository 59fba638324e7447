"""All meshes of a scene as one table of vertices and one of triangles, as a GPU takes them."""

from __future__ import annotations

import numpy as np

from irrsplat.scene.model import Mesh, Scene


def in_order(scene: Scene) -> list[Mesh]:
    """The scene's meshes as their triangles are numbered: the closed ones first."""
    return sorted(scene.meshes, key=lambda mesh: not mesh.closed)


def flatten(scene: Scene) -> tuple[np.ndarray, np.ndarray, int]:
    """Vertices (V, 12) float32 rows of position, normal, albedo, emission; faces (F, 3) int32; how many faces are closed.

    The faces of closed meshes come first.
    """
    meshes = in_order(scene)
    vertices, faces, start = [np.zeros((0, 12), "f4")], [np.zeros((0, 3), "i4")], 0
    for mesh in meshes:
        rows = np.empty((len(mesh.positions), 12), "f4")
        rows[:, 0:3], rows[:, 3:6] = mesh.positions, mesh.normals
        rows[:, 6:9] = mesh.material.albedo if mesh.colors is None else mesh.colors
        rows[:, 9:12] = mesh.material.emission
        vertices.append(rows)
        faces.append(mesh.faces + start)
        start += len(rows)
    closed = sum(len(mesh.faces) for mesh in meshes if mesh.closed)
    return np.concatenate(vertices), np.concatenate(faces), closed
