"""The accumulation: one more sample of every pixel into the running means of all of them, in floats."""

from __future__ import annotations

import moderngl

from irrsplat.buffers import GBuffer
from irrsplat.gpu.holder import Holder
from irrsplat.gpu.program import Program, State
from irrsplat.gpu.target import Target


class AccumulatePass(Holder):
    """Keeps the means of image, direct, indirect and emission of a view of `size` (width, height)."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.program = Program(ctx, "accumulate", "lib/fullscreen")
        self.target = Target(ctx, size, (4, 4, 4, 4))

    def __call__(
        self,
        number: int,
        gbuffer: GBuffer,
        direct: moderngl.Texture,
        sums: moderngl.Texture,
        centre: moderngl.Texture,
        sky: tuple[float, float, float],
        mix: tuple[float, float],
    ) -> list[moderngl.Texture]:
        """The means with the `number`-th sample in them (the first, 1, begins anew), RGBA32F textures of this pass's own.

        sums: (Σ k·E, Σ k) of the sample; centre: the same of the pixels' centres, for where those of the sample are empty.
        mix: weights of direct and of indirect light in the image.
        """
        self.program(
            self.target,
            state=State(blend="over") if number > 1 else State(),  # what is there by 1 - share, the new by its share
            position=gbuffer.position,
            albedo=gbuffer.albedo,
            emission=gbuffer.emission,
            direct=direct,
            sums=sums,
            centre=centre,
            blend=mix,
            sky=sky,
            share=1.0 / number,
        )
        return self.target.textures
