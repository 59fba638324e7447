"""The visibility test: whether two points see each other by way of a third, for many pairs at once, by rays through the tree."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target, float_texture
from irrsplat.gpu.texel_table import table_rows

_ROWS = 16  # of pairs in a batch


class VisibilityPass(Owner):
    """Tests up to `capacity` sight lines at once. materials: World.material_defines (default: nothing is cut out)."""

    capacity = TABLE_COLUMNS * _ROWS

    def __init__(self, ctx: moderngl.Context, materials: Mapping[str, int] | None = None) -> None:
        self.program = Program(ctx, "surface_cache/visibility", "lib/fullscreen", materials)
        self.lines = float_texture(ctx, (3 * TABLE_COLUMNS, _ROWS))
        self.target = Target(ctx, (TABLE_COLUMNS, _ROWS), (1,))

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.program, self.lines, self.target)

    def __call__(self, rays: Uniforms, lines: np.ndarray) -> np.ndarray:
        """(N,) True where nothing is in the way from lines[:, 0] by lines[:, 1] to lines[:, 2], (N, 3, 3) in metres.

        rays: the uniforms of shaders/lib/bvh.glsl, as World.ray_uniforms has them.
        """
        rows = table_rows(np.concatenate([lines, np.zeros((*lines.shape[:2], 1))], axis=-1, dtype="f4"))
        self.lines.write(rows.tobytes(), viewport=(0, 0, 3 * TABLE_COLUMNS, len(rows)))
        self.program(self.target, scissor=(0, 0, TABLE_COLUMNS, len(rows)), lines=self.lines, **rays)
        seen: np.ndarray = np.frombuffer(self.target.textures[0].read(), "f4")[: len(lines)] > 0.5
        return seen
