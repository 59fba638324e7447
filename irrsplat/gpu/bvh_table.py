"""The tree that rays go through, as tables that shaders read."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import COLUMNS, listed, table_texture
from irrsplat.scene.bvh import build


class Tree(Owner):
    """The scene's triangles on the GPU as rays find them.

    vertices: (V, 12) float32 rows of position, normal, albedo, emission; faces: (F, 3) int, as scene.flat.flatten gives them.
    order: (F,) the triangles' numbers in the order in which shaders count them.
    Raises InputError for more triangles than the GPU's textures hold.
    """

    def __init__(self, ctx: moderngl.Context, vertices: np.ndarray, faces: np.ndarray) -> None:
        corners = vertices[faces, :3]
        bvh = build(corners)
        limit = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
        if max(bvh.nodes[..., 0].size, len(vertices), len(faces)) > COLUMNS * limit or limit < 3 * COLUMNS:
            raise InputError(f"{len(faces)} triangles are too many to trace here: use --gather raster")
        self.corners = corners
        self.order = bvh.order
        self.count = bvh.nodes.shape[1]
        self.grid = bvh.grid
        nodes = listed(bvh.nodes.reshape(-1, 1, 4))
        self.nodes = ctx.texture((nodes.shape[1], nodes.shape[0]), 4, np.ascontiguousarray(nodes).tobytes(), dtype="u4")
        self.nodes.filter = moderngl.NEAREST, moderngl.NEAREST
        leaves = np.concatenate([corners[bvh.order], faces[bvh.order, :, None]], axis=-1, dtype="f4")
        self.triangles = table_texture(ctx, listed(leaves))
        looks = np.zeros((len(vertices), 3, 4), "f4")
        looks[..., :3] = vertices[:, 3:].reshape(-1, 3, 3)
        self.looks = table_texture(ctx, listed(looks))

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.nodes, self.triangles, self.looks)

    @property
    def rays(self) -> dict[str, Any]:
        """The uniforms of shaders/lib/bvh.glsl."""
        return {
            "bvh_nodes": self.nodes,
            "bvh_triangles": self.triangles,
            "bvh_count": self.count,
            "bvh_start": self.grid[0],
            "bvh_step": self.grid[1],
        }

    @property
    def uniforms(self) -> dict[str, Any]:
        """The same, and the vertices' table."""
        return self.rays | {"looks": self.looks}
