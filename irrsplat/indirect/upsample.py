"""Upsampling of sums from every other pixel to all pixels, along surfaces: joint bilateral (Kopf et al. 2007)."""

from __future__ import annotations

import moderngl

from irrsplat.core.buffers import GBuffer, SplatBuffer
from irrsplat.core.timing.input_waits import stop_for_input
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import Target
from irrsplat.scene.model import Camera


class UpsamplePass(Owner):
    """Upsampling of sums from every other pixel of a view of `size` (width, height) to all pixels.

    Most pixels lie between four coarse pixels of one surface, and take their linear interpolation. The depth buffer marks all
    other pixels for a second draw, which searches sixteen coarse pixels for those on the pixel's surface.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.ctx, self.size = ctx, size
        self.squares = self.own(Program(ctx, "indirect/upsample_squares", "lib/fullscreen"))
        self.between = self.own(Program(ctx, "indirect/upsample", "lib/fullscreen"))
        self.search = self.own(Program(ctx, "indirect/upsample_search", "lib/fullscreen"))
        self.target = self.own(Target(ctx, ((size[0] + 1) // 2, (size[1] + 1) // 2), (4, 4)))
        self.target.textures[0].filter = moderngl.LINEAR, moderngl.LINEAR
        self.out = self.own(Target(ctx, size, (4, 2), depth=True))

    def __call__(self, splats: SplatBuffer, gbuffer: GBuffer, camera: Camera) -> SplatBuffer:
        """Return interpolated sums for every pixel: E, a weight of 1, and Σw. The textures belong to this pass.

        Raises InputWaits between two draws.
        """
        seen = gbuffer.surface_uniforms
        self.squares(self.target, **seen, sums=splats.sums, weight=splats.weight)
        stop_for_input(self.ctx)
        irradiance, planes = self.target.textures
        self.between(
            self.out,
            state=DrawState(depth="1"),
            position=gbuffer.position,
            irradiance=irradiance,
            planes=planes,
            pixel=camera.pixel(self.size),
        )
        stop_for_input(self.ctx)
        self.search(self.out, state=DrawState(depth="<", depth_write=False), **seen, sums=splats.sums, weight=splats.weight)
        sums, weight = self.out.textures
        return SplatBuffer(sums, weight, splats.luminance_floor)
