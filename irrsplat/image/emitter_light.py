"""The light of emitters at every pixel, by shadow rays; records leave it out then."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl

from irrsplat.core.buffers import GBuffer
from irrsplat.gather.record_frame import offset_of
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target
from irrsplat.gpu.world import World
from irrsplat.lighting.emitter_table import emitter_table
from irrsplat.settings import Settings

_AT_ONCE = 16  # samples that a draw takes: llvmpipe ends all loops of a fragment together after 65 thousand turns
_CANDIDATES = 8  # emitters, at most, of which a sample takes one: with 4 a bulb of many triangles makes 1.7 times as much noise


class EmitterLightPass(Owner):
    """Draws the light of emitters in a view of `size` (width, height). materials: World.material_defines."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], materials: Mapping[str, int]) -> None:
        self.program = Program(ctx, "lighting/emitter_light", "lib/fullscreen", materials)
        self.target = Target(ctx, size, (4,))

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.program, self.target)

    def __call__(
        self,
        gbuffer: GBuffer,
        world: World,
        settings: Settings,
        number: int = 0,
        target: Target | None = None,
    ) -> moderngl.Texture:
        """The irradiance that comes straight from the emitters of the world's table, which has some, in W/m²: the texture of the
        target (default: this pass's own).

        number: of the subpixel sample; each has shadow rays of its own, and those of all together share the emitters evenly.
        """
        target, table, samples = target or self.target, emitter_table(world), settings.pixel_light_samples
        assert table is not None
        for before in range(0, samples, _AT_ONCE):
            self.program(
                target,
                state=DrawState(blend="add") if before else DrawState(),
                position=gbuffer.position,
                normal=gbuffer.normal,
                picture_corner=gbuffer.corner,
                lit_normal=gbuffer.lit_normal,
                albedo=gbuffer.albedo,
                offset=offset_of(world.scene),
                first=number * samples + before,
                count=min(_AT_ONCE, samples - before),
                candidates=min(_CANDIDATES, 2 * table.count),
                seed=settings.seed,
                **table.sample_uniforms(samples),
                **world.trace_uniforms,
            )
        return target.textures[0]
