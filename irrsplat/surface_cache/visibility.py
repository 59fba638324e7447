"""The sight test: whether two points see each other by way of a third, for many pairs at once, by rays through the tree."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import moderngl
import numpy as np

from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target, float_texture, listed

_LINES = 16  # of pairs in a batch


class VisibilityPass(Owner):
    """Tests `capacity` ways at once."""

    capacity = TABLE_COLUMNS * _LINES

    def __init__(self, ctx: moderngl.Context) -> None:
        self.program = Program(ctx, "surface_cache/visibility", "lib/fullscreen")
        self.ways = float_texture(ctx, (3 * TABLE_COLUMNS, _LINES))
        self.target = Target(ctx, (TABLE_COLUMNS, _LINES), (1,))

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.program, self.ways, self.target)

    def __call__(self, rays: Mapping[str, Any], ways: np.ndarray) -> np.ndarray:
        """(N,) True where nothing stands in the way from ways[:, 0] by ways[:, 1] to ways[:, 2], (N, 3, 3) in metres.

        rays: the uniforms of shaders/lib/bvh.glsl, as BvhTable.ray_uniforms has them.
        """
        rows = listed(np.concatenate([ways, np.zeros((*ways.shape[:2], 1))], axis=-1, dtype="f4"))
        self.ways.write(rows.tobytes(), viewport=(0, 0, 3 * TABLE_COLUMNS, len(rows)))
        self.program(self.target, scissor=(0, 0, TABLE_COLUMNS, len(rows)), ways=self.ways, **rays)
        seen: np.ndarray = np.frombuffer(self.target.textures[0].read(), "f4")[: len(ways)] > 0.5
        return seen
