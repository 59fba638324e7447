"""Triangles on the GPU: one vertex buffer and one index buffer for a whole scene."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.core.vectors import triangle_normals
from irrsplat.core.vertex_layout import WIDTH, vertex_column
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import table_texture
from irrsplat.gpu.texel_table import table_rows
from irrsplat.scene.seen_by_light import FaceCounts


class Geometry(Owner):
    """An indexed triangle list.

    vertices: (V, WIDTH) float32, columns of core/vertex_layout.py. faces: (F, 3) int32. counts: number of faces of each sort
    (default: all open). `parts` maps "all", "closed", "open", "cut_out" and "lit" (all but faces that light passes) to (first
    index, number of indices). planes: RGBA32F table with one texel per face, its unit normal n and n·p. corners: (F, 3, 3)
    float32, kept on the CPU.
    """

    def __init__(self, ctx: moderngl.Context, vertices: np.ndarray, faces: np.ndarray, counts: FaceCounts | None = None) -> None:
        # OpenGL has no empty buffers: an empty scene gets one vertex and one triangle that no draw uses
        self.vertices = self.own(ctx.buffer(np.ascontiguousarray(vertices if len(vertices) else np.zeros((1, WIDTH)), "f4")))
        self.indices = self.own(ctx.buffer(np.ascontiguousarray(faces if len(faces) else np.zeros((1, 3)), "i4")))
        self.ctx = ctx
        self.corners = vertex_column(vertices, "position")[faces]
        self.planes = self.own(table_texture(ctx, _planes(self.corners)))
        self.counts = counts or FaceCounts(0, len(faces))
        self.parts = {
            "all": (0, 3 * len(faces)),
            "closed": (0, 3 * self.counts.closed),
            "open": (3 * self.counts.closed, 3 * self.counts.open),
            "cut_out": (3 * self.counts.solid, 3 * self.counts.cut_out),
            "lit": (0, 3 * self.counts.lit),
        }

    @property
    def uniforms(self) -> Uniforms:
        """Uniforms of shaders/lib/surface.glsl, for the triangles' normals."""
        return {"face_planes": self.planes}

    @property
    def triangles(self) -> int:
        """The number of triangles."""
        return self.parts["all"][1] // 3

    def update(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        """Move the triangles; the numbers of vertices and faces, and their order, stay."""
        if not len(faces):
            return
        self.repaint(vertices)
        self.indices.write(np.ascontiguousarray(faces, "i4").tobytes())
        self.corners = vertex_column(vertices, "position")[faces]
        self.planes.write(_planes(self.corners).tobytes())

    def repaint(self, vertices: np.ndarray) -> None:
        """Replace the vertices' materials; their number and positions stay."""
        if len(vertices):
            self.vertices.write(np.ascontiguousarray(vertices, "f4").tobytes())


def _planes(corners: np.ndarray) -> np.ndarray:
    """Return a table (R, C, 4) of the planes of triangles (F, 3, 3): unit normal by winding, and distance from the origin."""
    normals, _ = triangle_normals(corners)
    rows = np.empty((len(corners), 1, 4), np.float32)
    rows[:, 0, :3] = normals.T
    rows[:, 0, 3] = sum(normals[i] * (corners[..., i].astype(float) @ np.full(3, 1.0 / 3.0)) for i in range(3))
    return table_rows(rows)
