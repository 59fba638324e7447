"""The gather by rays: what many records see along cosine-stratified directions, through a tree of the scene's triangles.

A fragment is a ray. What it brings goes into the same kind of atlas as a raster gather's, so that the same reduction sums it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import moderngl
import numpy as np

from irrsplat.buffers import Atlas, ShadowMaps, Sites
from irrsplat.errors import InputError
from irrsplat.gpu.holder import Holder
from irrsplat.gpu.program import Program
from irrsplat.gpu.target import Target, float_texture, table_texture
from irrsplat.hemisphere import frames
from irrsplat.scene.bvh import build
from irrsplat.strata import stratum_edges, stratum_table
from irrsplat.vantage import OFFSET, atlas_grid, eyes, frame_rows

_COLUMNS = 1024  # nodes, triangles or vertices per row of their tables, as the shaders have it


class Tree(Holder):
    """The scene's triangles on the GPU as rays find them.

    vertices: (V, 12) float32 rows of position, normal, albedo, emission; faces: (F, 3) int, as scene.flat.flatten gives them.
    Raises InputError for more triangles than the GPU's textures hold.
    """

    def __init__(self, ctx: moderngl.Context, vertices: np.ndarray, faces: np.ndarray) -> None:
        corners = vertices[faces, :3]
        bvh = build(corners)
        limit = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
        if max(bvh.nodes[..., 0].size, len(vertices), len(faces)) > _COLUMNS * limit or limit < 3 * _COLUMNS:
            raise InputError(f"{len(faces)} triangles are too many to trace here: use --gather raster")
        self.corners = corners
        self.count = bvh.nodes.shape[1]
        self.grid = bvh.grid
        nodes = _rows(bvh.nodes.reshape(-1, 1, 4))
        self.nodes = ctx.texture((nodes.shape[1], nodes.shape[0]), 4, np.ascontiguousarray(nodes).tobytes(), dtype="u4")
        self.nodes.filter = moderngl.NEAREST, moderngl.NEAREST
        leaves = np.concatenate([corners[bvh.order], faces[bvh.order, :, None]], axis=-1, dtype="f4")
        self.triangles = table_texture(ctx, _rows(leaves))
        looks = np.zeros((len(vertices), 3, 4), "f4")
        looks[..., :3] = vertices[:, 3:].reshape(-1, 3, 3)
        self.looks = table_texture(ctx, _rows(looks))

    @property
    def uniforms(self) -> dict[str, Any]:
        """The uniforms of shaders/lib/bvh.glsl and the vertices' table."""
        return {
            "bvh_nodes": self.nodes,
            "bvh_triangles": self.triangles,
            "bvh_count": self.count,
            "bvh_start": self.grid[0],
            "bvh_step": self.grid[1],
            "looks": self.looks,
        }


def _rows(things: np.ndarray) -> np.ndarray:
    """Things (N, T, 4) of T texels each as rows of _COLUMNS of them, at least one row: (R, _COLUMNS·T, 4)."""
    count, texels = things.shape[:2]
    lines = max(-(-count // _COLUMNS), 1)
    table = np.zeros((lines * _COLUMNS, texels, 4), things.dtype)
    table[:count] = things
    return table.reshape(lines, _COLUMNS * texels, 4)


class TracePass(Holder):
    """Traces side² rays a record, for a scene of the given `diagonal` in metres; called as GatherPass is, with a Tree.

    lights: light_defines of the scene. capacity: how many records one call takes at most (default: what a 48 MiB atlas holds).
    """

    def __init__(
        self, ctx: moderngl.Context, side: int, diagonal: float, lights: Mapping[str, int], capacity: int | None = None
    ) -> None:
        self.ctx = ctx
        self.side = max(4, side // 4 * 4)  # so that blocks fill a cell
        self.kind = "trace"
        self.offset = OFFSET * diagonal
        self.radii = (self.offset, diagonal)  # R_k in metres: nothing is nearer than the offset, a miss is a diagonal away
        table = stratum_table(self.side)
        self.cell = (table.shape[1], table.shape[0])
        self.share = table[..., 3]  # cosθ·dω of every texel of a cell
        self.table = table_texture(ctx, table)
        self.edges = table_texture(ctx, stratum_edges(self.side))
        self.program = Program(ctx, "trace", "lib/fullscreen", defines=lights)
        self.columns, self.capacity = atlas_grid(self.cell, capacity, int(ctx.info["GL_MAX_TEXTURE_SIZE"]))
        self.target: Target | None = None
        self.frames = float_texture(ctx, (self.capacity, 5))

    def __call__(self, tree: Tree, shadows: ShadowMaps, sites: Sites, numbers: np.ndarray, seed: int) -> Atlas:
        """What records at `sites` (at most `capacity`) see; `numbers` (N,) are theirs in the cache."""
        if self.target is None:
            down = self.capacity // self.columns
            self.target = Target(self.ctx, (self.columns * self.cell[0], down * self.cell[1]), (4, 4))
        count = len(sites)
        rows = np.zeros((5, count, 4), "f4")
        rows[:4] = frame_rows(frames(sites.normal, numbers, seed), sites, numbers)
        rows[4, :, :3] = eyes(sites, tree.corners, self.offset)
        self.frames.write(rows.tobytes(), viewport=(0, 0, count, 5))
        lines, rest = divmod(count, self.columns)
        width, height = self.cell
        for area in ((0, 0, self.columns * width, lines * height), (0, lines * height, rest * width, height)):
            if area[2] * area[3]:
                self.program(
                    self.target,
                    scissor=area,
                    frames=self.frames,
                    cell=self.cell,
                    columns=self.columns,
                    near=self.offset,
                    **tree.uniforms,
                    **shadows.uniforms,
                )
        block = (self.side // 4, self.side // 4)
        radiance, planes = self.target.textures
        return Atlas(radiance, planes, self.table, self.edges, self.frames, count, self.columns, self.cell, block)
