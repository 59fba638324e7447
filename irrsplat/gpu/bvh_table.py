"""Triangles and their bounding volume hierarchy as tables that shaders read."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.core.errors import InputError
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.core.vertex_layout import TEXELS, vertex_column
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import integer_texture, table_texture
from irrsplat.gpu.texel_table import chosen_rows, row_count, table_rows, write
from irrsplat.scene.seen_by_light import FaceCounts
from irrsplat.scene.spatial.bvh import Bvh


class TriangleTable(Owner):
    """The triangles that light meets, by their numbers in the scene, with their vertices (shaders/lib/rays/triangles.glsl).

    vertices: (V, WIDTH) float32, columns of core/vertex_layout.py. faces: (F, 3) int, from `flatten`. counts: number of faces
    of each sort (default: all open). Raises InputError for more than the GPU's textures hold.
    """

    def __init__(self, ctx: moderngl.Context, vertices: np.ndarray, faces: np.ndarray, counts: FaceCounts | None = None) -> None:
        self.ctx, self.counts = ctx, counts or FaceCounts(0, len(faces))
        limit = _largest_table(ctx)
        if max(len(vertices), len(faces)) > limit or limit < max(TEXELS, 3) * TABLE_COLUMNS**2:
            raise _too_many(len(faces))
        self.corners = self.own(table_texture(ctx, self._corner_rows(vertices, faces)))
        self.vertices = self.own(table_texture(ctx, table_rows(vertices)))

    def _corner_rows(self, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """Return the rows of the corner table."""
        points = np.empty((len(vertices), 4), "f4")
        points[:, :3], points[:, 3] = vertex_column(vertices, "position"), np.arange(len(vertices))
        corners = chosen_rows(points, faces[: self.counts.lit])
        marks = corners.reshape(-1, 3, 4)[self.counts.solid : self.counts.lit, 0]
        marks[:, 3] = -1.0 - marks[:, 3]  # marks cut-out triangles
        return corners

    def update(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        """Move the triangles in place, so that every user of this table gets the new positions."""
        corners = self._corner_rows(vertices, faces)
        self.repaint(vertices)
        self.corners.write(corners)

    def repaint(self, vertices: np.ndarray) -> None:
        """Replace the vertices' materials."""
        self.vertices.write(table_rows(vertices))

    @property
    def corner_uniforms(self) -> Uniforms:
        """Uniforms of shaders/lib/rays/triangles.glsl."""
        return {"triangle_corners": self.corners}

    @property
    def uniforms(self) -> Uniforms:
        """Corner uniforms and the vertex table (generated/vertex_table.glsl)."""
        return self.corner_uniforms | {"vertex_table": self.vertices}


class BvhTable(Owner):
    """A bounding volume hierarchy on the GPU, traversed by shaders/lib/rays/bvh.glsl.

    Raises InputError for more nodes than the GPU's textures hold.
    """

    def __init__(self, ctx: moderngl.Context, bvh: Bvh) -> None:
        nodes, triangles = bvh.nodes.reshape(-1, 4), len(bvh.order)
        if max(len(nodes), triangles) > _largest_table(ctx):
            raise _too_many(triangles)
        self.nodes = self.own(integer_texture(ctx, (TABLE_COLUMNS, row_count(len(nodes))), 4, "u4"))
        write(self.nodes, 0, nodes)
        self.leaves = self.own(integer_texture(ctx, (TABLE_COLUMNS, row_count(triangles))))
        write(self.leaves, 0, bvh.order[:, None])
        self.uniforms: Uniforms = {
            "bvh_nodes": self.nodes,
            "bvh_leaves": self.leaves,
            "bvh_count": bvh.nodes.shape[1],
            "bvh_start": bvh.grid[0],
            "bvh_step": bvh.grid[1],
        }


def _largest_table(ctx: moderngl.Context) -> int:
    """Return the largest number of one-texel items in a table."""
    return TABLE_COLUMNS * int(ctx.info["GL_MAX_TEXTURE_SIZE"])


def _too_many(triangles: int) -> InputError:
    """Return the error for tables that exceed the GPU's limits."""
    return InputError(f"{triangles} triangles are too many for rays in shaders here: use --gather embree")
