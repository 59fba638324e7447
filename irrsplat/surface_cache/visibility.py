"""The visibility test: whether two points see each other by way of a third, for many pairs at once, by rays through the tree.

In a shader, or by Embree on the CPU, where that is faster.
"""

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
from irrsplat.scene.ray_caster import RayCaster

_ROWS = 16  # of pairs in a batch
_BEYOND = 1.001  # as far as the point between: the first part of a line ends behind a surface on which that lies


def seen_by_embree(caster: RayCaster, lines: np.ndarray) -> np.ndarray:
    """(N,) as VisibilityPass has it."""
    a, between, b = lines.swapaxes(0, 1)
    seen = caster.free(a, a + _BEYOND * (between - a))
    seen[seen] = caster.free(between[seen], b[seen])
    return seen


class VisibilityPass(Owner):
    """Tests up to `capacity` sight lines at once. materials: World.material_defines (default: nothing is cut out)."""

    capacity = TABLE_COLUMNS * _ROWS

    def __init__(self, ctx: moderngl.Context, materials: Mapping[str, int] | None = None) -> None:
        self.program = Program(ctx, "surface_cache/visibility", "lib/fullscreen", {**(materials or {}), "BEYOND": _BEYOND})
        self.lines = float_texture(ctx, (3 * TABLE_COLUMNS, _ROWS))
        self.target = Target(ctx, (TABLE_COLUMNS, _ROWS), (1,))

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (self.program, self.lines, self.target)

    def __call__(self, rays: Uniforms, lines: np.ndarray) -> np.ndarray:
        """(N,) True where nothing is in the way from lines[:, 0] by lines[:, 1] to lines[:, 2], (N, 3, 3) in metres.

        rays: the uniforms of shaders/lib/rays/bvh.glsl, as World.ray_uniforms has them.
        """
        rows = table_rows(np.concatenate([lines, np.zeros((*lines.shape[:2], 1))], axis=-1, dtype="f4"))
        self.lines.write(rows.tobytes(), viewport=(0, 0, 3 * TABLE_COLUMNS, len(rows)))
        self.program(self.target, scissor=(0, 0, TABLE_COLUMNS, len(rows)), lines=self.lines, **rays)
        seen: np.ndarray = np.frombuffer(self.target.textures[0].read(), "f4")[: len(lines)] > 0.5
        return seen
