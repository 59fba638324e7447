"""Splatting: every record adds its weighted irradiance to the pixels within its reach (Jones 2010, sections 2.2 and 3.5)."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Records, SplatBuffer, Uniforms
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target, float_texture
from irrsplat.records.culling import TILE
from irrsplat.records.weight import record_defines, view_radius_uniforms
from irrsplat.scene.model import Camera
from irrsplat.settings import BORROW_REACH, Settings


class SplatPass(Owner):
    """Adds records to a splat buffer of `size` (width, height), with their gradients or without.

    It has a second, smaller buffer for every other pixel in both directions: pixel_stride = 2 below; 1 is all of them.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], gradients: bool) -> None:
        self.ctx = ctx
        self.whole = whole_reach(ctx)
        self.numbers = ctx.buffer(reserve=4)  # of the records that are drawn
        defines = record_defines(gradients)
        self.program = Program(ctx, "indirect/splat", defines={**defines, "NORMAL_MAPS": 0})
        # without gradients nothing is known of other normals
        self.bent = Program(ctx, "indirect/splat", defines={**defines, "NORMAL_MAPS": 1}) if gradients else None
        self.empty = Program(ctx, "indirect/splat_clear", "lib/fullscreen")
        self.target = Target(ctx, size, (4, 2))
        self.small: Target | None = None  # made when it is first wanted
        self.tiles = Program(ctx, "indirect/splat_farthest", "lib/fullscreen", {"TILE": TILE})
        self.distances = Target(ctx, (-(-size[0] // TILE), -(-size[1] // TILE)), (1,))

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (
            self.whole,
            self.numbers,
            self.program,
            self.bent,
            self.empty,
            self.target,
            self.small,
            self.tiles,
            self.distances,
        )

    def _of(self, pixel_stride: int) -> Target:
        if pixel_stride == 1:
            return self.target
        width, height = self.target.size
        self.small = self.small or Target(self.ctx, ((width + 1) // 2, (height + 1) // 2), (4, 2))
        return self.small

    def clear(self, gbuffer: GBuffer, pixel_stride: int = 1, target: Target | None = None) -> None:
        """Start again from no records; the weight is NOTHING_SEEN where the g-buffer sees nothing."""
        self.empty(target or self._of(pixel_stride), position=gbuffer.position, pixel_stride=pixel_stride)

    def farthest(self, gbuffer: GBuffer, camera: Camera) -> np.ndarray:
        """(h, w) float32, bottom row first: how far each tile of TILE² pixels sees, in metres from the eye; 0: nowhere."""
        self.tiles(self.distances, position=gbuffer.position, eye=camera.eye)
        return self.distances.read()[::-1, :, 0]

    def __call__(
        self,
        records: Records,
        numbers: np.ndarray,
        gbuffer: GBuffer,
        camera: Camera,
        settings: Settings,
        pixel_stride: int = 1,
        target: Target | None = None,
        reach: moderngl.Texture | None = None,
    ) -> None:
        """Add the records of these numbers (N,), in their order, to what `target` holds (default: this pass's own buffer).
        reach: as in SplatBuffer."""
        width, height = self.target.size
        if not len(numbers):
            return
        program = self.program
        bent: Uniforms = {}
        if self.bent is not None and gbuffer.mapped_normal is not None:
            program, bent = self.bent, {"lit_normal": gbuffer.mapped_normal}
        data = numbers.astype("i4").tobytes()
        self.numbers.orphan(max(len(data), self.numbers.size))  # a draw before this may still read the old ones
        self.numbers.write(data)
        program(
            target or self._of(pixel_stride),
            vertices=4,
            mode=moderngl.TRIANGLE_STRIP,
            instances=len(numbers),
            numbers=self.numbers,
            state=DrawState(blend="add", depth_clamp=True),
            **records.uniforms,
            clip_from_world=camera.clip_from_view(width / height, 1e-3, 1e3) @ camera.view_from_world,
            **view_radius_uniforms(camera, settings),
            pixel=camera.screen / height * pixel_stride,
            borrow_reach=BORROW_REACH if settings.borrow else 0.0,
            position=gbuffer.position,
            normal=gbuffer.normal,
            **bent,
            pixel_stride=pixel_stride,
            reach=reach or self.whole,
            cut=settings.kernel == "cut",
            in_front=settings.in_front,
        )

    def sums(self, luminance_floor: float, pixel_stride: int = 1, reach: moderngl.Texture | None = None) -> SplatBuffer:
        """What has been added up so far, this pass's own textures; luminance_floor: as in Records; reach: that it was done
        with."""
        sums, weight = self._of(pixel_stride).textures
        return SplatBuffer(sums, weight, luminance_floor, pixel_stride, reach)


def whole_reach(ctx: moderngl.Context) -> moderngl.Texture:
    """The texture in place of SplatBuffer.reach where all of the records' reach counts everywhere."""
    texture = float_texture(ctx, (1, 1), 1)
    texture.write(np.ones(1, "f4").tobytes())
    return texture
