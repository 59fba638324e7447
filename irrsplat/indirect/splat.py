"""Splatting: every record adds its weighted irradiance to the pixels within its reach (Jones 2010, sections 2.2 and 3.5)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Records, Uniforms
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target
from irrsplat.records.weight import record_defines, view_radius_uniforms
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings

_BATCH = 1.2e8  # records times pixels: some 30 ms of a software renderer, which also spends a millisecond on each batch


def batches(numbers: np.ndarray, size: tuple[int, int]) -> Iterator[np.ndarray]:
    """Yield the records' numbers in batches, in their order: work can end between two batches, without effect on the sums.

    size: width and height of the splat buffer, pixels.
    """
    count = max(int(_BATCH / (size[0] * size[1])), 1)
    return (numbers[first : first + count] for first in range(0, len(numbers), count))


def splat_target(ctx: moderngl.Context, size: tuple[int, int]) -> Target:
    """Return the target that sums records: SplatBuffer's textures, and the surfaces' depths that records are compared with."""
    return Target(ctx, size, (4, 2), depth=True)


class SplatPass(Owner):
    """Pass that adds records to a splat buffer of `size` (width, height).

    A second, smaller buffer has every other pixel in both directions, for pixel_stride = 2.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.ctx, self.size = ctx, size
        self.numbers = self.own(ctx.buffer(reserve=4))  # of the records that are drawn
        self.programs = {  # without gradients, E is valid only at the record's normal
            (gradients, bent, refined): self.own(
                Program(
                    ctx,
                    "indirect/splat",
                    defines={**record_defines(gradients), "NORMAL_MAPS": int(bent), "REFINED": int(refined)},
                )
            )
            for gradients, bent, refined in product((False, True), repeat=3)
            if gradients or not bent
        }
        self.empty = self.own(Program(ctx, "indirect/splat_clear", "lib/fullscreen"))
        self.targets = self.own(Workshop())

    def target(self, pixel_stride: int) -> Target:
        """Return the buffer of every `pixel_stride`-th pixel in both directions."""
        size = -(-self.size[0] // pixel_stride), -(-self.size[1] // pixel_stride)
        return self.targets.get(f"stride {pixel_stride}", (), lambda: splat_target(self.ctx, size))

    def clear(self, gbuffer: GBuffer, pixel_stride: int = 1, target: Target | None = None, unlit: bool = False) -> None:
        """Start again from no records; the weight is NOTHING_SEEN at pixels without a surface, or at all pixels if `unlit`."""
        self.empty(
            target or self.target(pixel_stride),
            state=DrawState(depth="1"),
            position=gbuffer.position,
            pixel_stride=pixel_stride,
            unlit=unlit,
        )

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
        """Add the records of these numbers (N,), in their order, to `target` (default: this pass's own buffer).

        reach: see SplatBuffer.
        """
        width, height = self.size
        if not len(numbers):
            return
        some: Uniforms = {} if reach is None else {"reach": reach}
        bent = settings.gradients and gbuffer.mapped_normal is not None
        if bent:
            some["lit_normal"] = gbuffer.mapped_normal
        data = numbers.astype("i4").tobytes()
        self.numbers.orphan(max(len(data), self.numbers.size))  # an earlier draw may still read the old numbers
        self.numbers.write(data)
        self.programs[settings.gradients, bent, reach is not None](
            target or self.target(pixel_stride),
            vertices=4,
            mode=moderngl.TRIANGLE_STRIP,
            instances=len(numbers),
            numbers=self.numbers,
            state=DrawState(depth="<", depth_write=False, blend="add", depth_clamp=True),
            **records.uniforms,
            clip_from_world=camera.clip_from_view(width / height, 1e-3, 1e3) @ camera.view_from_world,
            **view_radius_uniforms(camera, self.size, settings),
            pixel=camera.pixel(self.size) * pixel_stride,
            forward=-camera.axes[2],
            **gbuffer.surface_uniforms,
            **some,
            pixel_stride=pixel_stride,
        )
