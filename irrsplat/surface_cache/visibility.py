"""Visibility test: the visible shares of many segments at once, by rays through the tree in a shader."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import Target, float_texture
from irrsplat.gpu.texel_table import table_rows


class VisibilityPass(Owner):
    """Pass that tests up to `capacity` segments at once. materials: World.material_defines (default: no holes)."""

    capacity = TABLE_COLUMNS * 16

    def __init__(self, ctx: moderngl.Context, materials: Mapping[str, int] | None = None) -> None:
        rows = self.capacity // TABLE_COLUMNS
        self.program = self.own(Program(ctx, "surface_cache/visibility", "lib/fullscreen", materials or {}))
        self.lines = self.own(float_texture(ctx, (2 * TABLE_COLUMNS, rows)))
        self.target = self.own(Target(ctx, (TABLE_COLUMNS, rows), (1,)))

    def __call__(self, rays: Uniforms, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return (N,) the visible share of the segments from `starts` to `ends`, (N, 3) metres each, see RayCaster.reach.

        rays: the uniforms of shaders/lib/rays/bvh.glsl, see World.ray_uniforms.
        """
        rows = table_rows(np.pad(np.stack([starts, ends], axis=1), ((0, 0), (0, 0), (0, 1))).astype("f4"))
        self.lines.write(rows.tobytes(), viewport=(0, 0, 2 * TABLE_COLUMNS, len(rows)))
        self.program(self.target, scissor=(0, 0, TABLE_COLUMNS, len(rows)), lines=self.lines, **rays)
        return np.frombuffer(self.target.textures[0].read(), "f4")[: len(starts)]
