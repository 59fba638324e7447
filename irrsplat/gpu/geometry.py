"""Triangles on the GPU: one vertex buffer and one index buffer for a whole scene, made from plain arrays."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np

from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import listed, table_texture
from irrsplat.scene.meshlets import Meshlets, cut


class Pieces(Owner):
    """The same triangles, meshlet by meshlet, to be drawn as a Geometry is.

    corners: RGBA32F texture, a texel a triangle in that order: its vertices' numbers, and its own in the Geometry.
    looks: RGBA32F texture, three texels a vertex, its row of numbers.
    """

    def __init__(self, ctx: moderngl.Context, vertices: moderngl.Buffer, rows: np.ndarray, faces: np.ndarray) -> None:
        self.vertices = vertices
        self.indices = ctx.buffer(reserve=max(faces.size, 3) * 4)
        self.corners = table_texture(ctx, listed(np.zeros((len(faces), 1, 4))))
        self.looks = table_texture(ctx, listed(rows.reshape(-1, 3, 4)))
        self._cut(rows, faces)

    def update(self, rows: np.ndarray, faces: np.ndarray) -> None:
        """The same triangles elsewhere, as in the Geometry."""
        self.looks.write(listed(rows.reshape(-1, 3, 4)).astype("f4").tobytes())
        self._cut(rows, faces)

    def _cut(self, rows: np.ndarray, faces: np.ndarray) -> None:
        self.meshlets: Meshlets = cut(rows[faces, :3])
        order = self.meshlets.order
        self.indices.write(np.ascontiguousarray(faces[order], "i4").tobytes())
        self.corners.write(listed(np.column_stack([faces[order], order])[:, None].astype("f4")).tobytes())

    @property
    def uniforms(self) -> dict[str, Any]:
        """The uniforms with which shaders/gather/raster_shade.frag finds what is seen."""
        return {"triangle_table": self.corners, "vertex_table": self.looks}

    def owned(self) -> tuple[Resource, ...]:
        """What this frees: all but the vertices, which are the Geometry's."""
        return (self.indices, self.corners, self.looks)


class Geometry(Owner):
    """An indexed triangle list.

    vertices: (V, 12) float32 rows of position, normal, albedo, emission. faces: (F, 3) int32.
    The first `closed` faces belong to closed, outward wound meshes: `parts` names the ranges "all", "closed" and "open"
    as (first index, number of indices). planes: RGBA32F texture of the faces' planes, unit normal n and n·p, row by row.
    corners: (F, 3, 3) float32 of the faces, kept on the CPU.
    """

    FORMAT = "3f 3f 3f 3f"
    ATTRIBUTES = ("in_position", "in_normal", "in_albedo", "in_emission")

    def __init__(self, ctx: moderngl.Context, vertices: np.ndarray, faces: np.ndarray, closed: int = 0) -> None:
        # OpenGL has no empty buffers: no geometry is one vertex and one index that no draw reaches
        self.vertices = ctx.buffer(np.ascontiguousarray(vertices if len(vertices) else np.zeros((1, 12)), "f4").tobytes())
        self.indices = ctx.buffer(np.ascontiguousarray(faces if len(faces) else np.zeros((1, 3)), "i4").tobytes())
        self.ctx = ctx
        self.corners = vertices[faces, :3]
        self.planes = table_texture(ctx, _planes(self.corners.astype(float)))
        self._pieces: Pieces | None = None
        total, split = 3 * len(faces), 3 * closed
        self.parts = {"all": (0, total), "closed": (0, split), "open": (split, total - split)}

    @property
    def uniforms(self) -> dict[str, Any]:
        """The uniforms with which shaders/lib/surface.glsl finds a triangle's normal."""
        return {"face_planes": self.planes}

    @property
    def triangles(self) -> int:
        """The number of triangles."""
        return self.parts["all"][1] // 3

    @property
    def pieces(self) -> Pieces:
        """The triangles in meshlets; made when a gather first draws them."""
        if self._pieces is None:
            rows, faces = (np.frombuffer(buffer.read(), kind) for buffer, kind in ((self.vertices, "f4"), (self.indices, "i4")))
            self._pieces = Pieces(self.ctx, self.vertices, rows.reshape(-1, 12), faces.reshape(-1, 3)[: self.triangles])
        return self._pieces

    def update(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        """The same triangles elsewhere: as many vertices and faces as before, in the same order."""
        if not len(faces):
            return
        self.vertices.write(np.ascontiguousarray(vertices, "f4").tobytes())
        self.indices.write(np.ascontiguousarray(faces, "i4").tobytes())
        self.corners = vertices[faces, :3]
        self.planes.write(_planes(self.corners.astype(float)).astype("f4").tobytes())
        if self._pieces is not None:
            self._pieces.update(vertices, faces)

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self._pieces, self.vertices, self.indices, self.planes)


def _planes(corners: np.ndarray) -> np.ndarray:
    """(R, C, 4): planes of triangles (F, 3, 3), unit normal by their winding and distance from the origin, by TABLE_COLUMNS."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    rows = max(-(-len(corners) // TABLE_COLUMNS), 1)
    table = np.zeros((rows * TABLE_COLUMNS, 4))
    table[: len(corners)] = np.column_stack([normals, (normals * corners.mean(1)).sum(1)])
    return table.reshape(rows, TABLE_COLUMNS, 4)
