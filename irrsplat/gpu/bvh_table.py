"""The bounding volume hierarchy that rays go through, as tables that shaders read."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.core.errors import InputError
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.core.vertex_layout import TEXELS, vertex_column, vertex_texels
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import table_texture
from irrsplat.gpu.texel_table import chosen_rows, row_count, table_rows, write
from irrsplat.scene.bvh import Bvh, build
from irrsplat.scene.seen_by_light import FaceCounts


@dataclass(frozen=True)
class _Tables(Owner):
    """The tables of one set of triangles, replaced as a whole when these move."""

    corners: np.ndarray
    order: np.ndarray
    places: np.ndarray
    count: int  # nodes for each octant of ray directions
    grid: np.ndarray
    nodes: moderngl.Texture
    triangles: moderngl.Texture
    vertices: moderngl.Texture

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.nodes, self.triangles, self.vertices)


class BvhTable(Owner):
    """A scene's triangles on the GPU as rays find them (shaders/lib/bvh.glsl).

    vertices: (V, WIDTH) float32, rows as core/vertex_layout.py has them; faces: (F, 3) int, as scene.flatten gives them.
    counts: of which sort the faces are (default: all open); those that light passes are not in the tree. bvh: what `tree_of` has
    of these, where that is already made. Raises InputError for more triangles than the GPU's textures hold.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        vertices: np.ndarray,
        faces: np.ndarray,
        counts: FaceCounts | None = None,
        bvh: Bvh | None = None,
    ) -> None:
        self.ctx = ctx
        self.counts = counts or FaceCounts(0, len(faces))
        self._tables = _tables(ctx, vertices, faces, self.counts, bvh)

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self._tables,)

    def update(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        """The same triangles elsewhere; whoever holds this table sees them there."""
        before, self._tables = self._tables, _tables(self.ctx, vertices, faces, self.counts, None)
        before.release()

    def repaint(self, vertices: np.ndarray) -> None:
        """The same triangles with other materials."""
        self._tables.vertices.write(table_rows(vertex_texels(vertices)).astype("f4").tobytes())

    @property
    def corners(self) -> np.ndarray:
        """(F, 3, 3) float32: the triangles' corners in metres, in the scene's order."""
        return self._tables.corners

    @property
    def order(self) -> np.ndarray:
        """(T,) the scene's numbers of the triangles that light sees, in the order in which the tree counts them."""
        return self._tables.order

    @property
    def places(self) -> np.ndarray:
        """(T + 1,) int32 the other way: the tree's number of each triangle that light sees, by the scene's; at the end, where -1
        finds it, -1."""
        return self._tables.places

    @property
    def ray_uniforms(self) -> Uniforms:
        """The uniforms of shaders/lib/bvh.glsl."""
        tables = self._tables
        return {
            "bvh_nodes": tables.nodes,
            "bvh_triangles": tables.triangles,
            "bvh_count": tables.count,
            "bvh_start": tables.grid[0],
            "bvh_step": tables.grid[1],
        }

    @property
    def uniforms(self) -> Uniforms:
        """The same, and the table of the vertices (generated/vertex_table.glsl)."""
        return self.ray_uniforms | {"vertex_table": self._tables.vertices}


def tree_of(vertices: np.ndarray, faces: np.ndarray, counts: FaceCounts) -> Bvh:
    """The tree of the triangles that light sees, as BvhTable takes them; without OpenGL, so that a thread can make it."""
    return build(vertex_column(vertices, "position")[faces[: counts.lit]])


def _tables(ctx: moderngl.Context, vertices: np.ndarray, faces: np.ndarray, counts: FaceCounts, bvh: Bvh | None) -> _Tables:
    corners = vertex_column(vertices, "position")[faces]
    if bvh is None:
        bvh = build(corners[: counts.lit])
    limit = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
    if max(bvh.nodes[..., 0].size, len(vertices), len(faces)) > TABLE_COLUMNS * limit or limit < max(TEXELS, 3) * TABLE_COLUMNS:
        raise InputError(f"{len(faces)} triangles are too many to trace here: use --gather raster")
    texels = bvh.nodes.reshape(-1, 4)
    nodes = ctx.texture((TABLE_COLUMNS, row_count(len(texels))), 4, dtype="u4")
    nodes.filter = moderngl.NEAREST, moderngl.NEAREST
    write(nodes, 0, texels)
    points = np.empty((len(vertices), 4), "f4")
    points[:, :3], points[:, 3] = vertex_column(vertices, "position"), np.arange(len(vertices))
    leaves = chosen_rows(points, faces[bvh.order])
    if counts.cut_out:
        first_corners = leaves.reshape(-1, 3, 4)[: len(bvh.order), 0]
        cut_out = bvh.order >= counts.solid
        first_corners[cut_out, 3] = -1.0 - first_corners[cut_out, 3]  # marks them
    triangles, table = table_texture(ctx, leaves), table_texture(ctx, table_rows(vertex_texels(vertices)))
    places = np.full(counts.lit + 1, -1, np.int32)
    places[bvh.order] = np.arange(counts.lit)
    return _Tables(corners, bvh.order, places, bvh.nodes.shape[1], bvh.grid, nodes, triangles, table)
