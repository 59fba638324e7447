"""Adaptive radii: a record reaches less far where it contradicts another (after Krivanek et al. 2006, "adaptive caching").

What a record says of another's place, by its derivatives, is held against what was gathered there. Their difference, relative to
the brighter of the two, is taken to grow with the square of the distance, so that a·R is limited to where it comes to `adapt`.
"""

from __future__ import annotations

import moderngl

from irrsplat.buffers import Records
from irrsplat.gpu.holder import Holder
from irrsplat.gpu.program import Program, State
from irrsplat.gpu.target import Target
from irrsplat.settings import Settings, record_uniforms, weight_defines

_NEVER = 1e30  # a difference that no two records have


class AdaptPass(Holder):
    """Writes the limits of records' radii into the cache; neighbours: they may not differ by more than the records' distance."""

    def __init__(self, ctx: moderngl.Context, gradients: bool, neighbours: bool) -> None:
        self.ctx = ctx
        self.program = Program(ctx, "adapt", "lib/fullscreen", weight_defines(gradients) | {"NEIGHBOURS": int(neighbours)})
        self.out: Target | None = None  # the cache's own texture

    def __call__(self, records: Records, first: int, settings: Settings, old: bool = True) -> None:
        """Limit the records from number `first` on by all others, and, where `old` ones are wanted, those before it by them."""
        if self.out is None or self.out.textures[0] is not records.limit:
            self.out = Target(self.ctx, records.limit.size, textures=[records.limit])
        everything, new, old_ones = (0, records.count), (first, records.count), (0, first)
        for targets, others, state in ((new, everything, State()), (old_ones, new, State(blend="min"))):
            if targets[0] == targets[1] or (targets is old_ones and not old):
                continue
            row = targets[0] // records.columns
            rows = (targets[1] - 1) // records.columns + 1 - row
            left = targets[0] % records.columns if rows == 1 else 0
            right = (targets[1] - 1) % records.columns + 1 if rows == 1 else records.columns
            self.program(
                self.out,
                state=state,
                scissor=(left, row, right - left, rows),
                **{name: value for name, value in records.uniforms.items() if name in self.program.uniforms},
                **record_uniforms(settings),
                adapt=settings.adapt or _NEVER,
                targets=targets,
                others=others,
            )
