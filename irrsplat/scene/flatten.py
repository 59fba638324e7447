"""One table of vertices and one of triangles for all meshes of a scene, in the layout of the GPU."""

from __future__ import annotations

import numpy as np

from irrsplat.core.vertex_layout import WIDTH, vertex_column
from irrsplat.scene.appearance import in_order
from irrsplat.scene.model import Scene


def flatten(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (V, WIDTH) float32, rows as in core/vertex_layout.py, and faces (F, 3) int32.

    Faces are in the order of appearance.in_order, as in FaceCounts.
    """
    meshes, numbers = in_order(scene), scene.materials
    vertices = np.empty((sum(len(mesh.positions) for mesh in meshes), WIDTH), "f4")
    faces = np.empty((sum(len(mesh.faces) for mesh in meshes), 3), "i4")
    row = face = 0
    for mesh in meshes:
        rows = vertices[row : row + len(mesh.positions)]
        vertex_column(rows, "position")[:] = mesh.positions
        vertex_column(rows, "normal")[:] = mesh.normals
        vertex_column(rows, "material")[:] = numbers[mesh.material]
        colors = mesh.material.albedo if mesh.colors is None else -1.0 - mesh.colors if mesh.material.unlit else mesh.colors
        vertex_column(rows, "albedo")[:] = colors
        vertex_column(rows, "opacity")[:, 0] = mesh.material.opacity if mesh.opacities is None else mesh.opacities
        vertex_column(rows, "uv")[:] = 0.0 if mesh.uvs is None else mesh.uvs
        np.add(mesh.faces, row, out=faces[face : face + len(mesh.faces)], casting="same_kind")
        row, face = row + len(rows), face + len(mesh.faces)
    return vertices, faces
