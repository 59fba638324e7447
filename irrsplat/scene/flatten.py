"""All meshes of a scene as one table of vertices and one of triangles, as a GPU takes them."""

from __future__ import annotations

import numpy as np

from irrsplat.core.vertex_layout import COLUMNS, PARTS, WIDTH, VertexColumn
from irrsplat.scene.model import Mesh, Scene


def in_order(scene: Scene) -> list[Mesh]:
    """The scene's meshes as their triangles are numbered: the closed ones first."""
    return sorted(scene.meshes, key=lambda mesh: not mesh.closed)


def flatten(scene: Scene) -> tuple[np.ndarray, np.ndarray, int]:
    """Vertices (V, WIDTH) float32, rows as core/vertex_layout.py has them; faces (F, 3) int32; how many faces are closed.

    The faces of closed meshes come first.
    """
    meshes = in_order(scene)
    vertices, faces, start = [np.zeros((0, WIDTH), "f4")], [np.zeros((0, 3), "i4")], 0
    for mesh in meshes:
        rows = np.empty((len(mesh.positions), WIDTH), "f4")
        for column in COLUMNS:
            rows[:, PARTS[column.name]] = _values(mesh, column)
        vertices.append(rows)
        faces.append(mesh.faces + start)
        start += len(rows)
    closed = sum(len(mesh.faces) for mesh in meshes if mesh.closed)
    return np.concatenate(vertices), np.concatenate(faces), closed


def _values(mesh: Mesh, column: VertexColumn) -> np.ndarray:
    """(V, components) or (components,): the column's values at the mesh's vertices, or the one of all of them."""
    if column.material:
        replaced = mesh.colors if column.name == "albedo" else None
        return np.asarray(getattr(mesh.material, column.name)) if replaced is None else replaced
    return {"position": mesh.positions, "normal": mesh.normals}[column.name]
