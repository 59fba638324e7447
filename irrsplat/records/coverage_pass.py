"""The rank of records: how many pixels of a view each of them serves, so that what is seen most is gathered again first."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Records
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target
from irrsplat.records.weight import reach_uniforms
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings, weight_defines


class RankPass(Owner):
    """Estimates the pixels that records serve, with their gradients or without, by some samples of what bounds each on screen."""

    def __init__(self, ctx: moderngl.Context, gradients: bool) -> None:
        self.ctx = ctx
        self.program = Program(ctx, "records/rank", "lib/fullscreen", weight_defines(gradients))
        self.target: Target | None = None

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.program, self.target)

    def __call__(self, records: Records, gbuffer: GBuffer, camera: Camera, settings: Settings) -> np.ndarray:
        """(N,) float32 pixels, about; 0 for records that are hidden or off the screen."""
        table = records.irradiance.size
        if self.target is None or self.target.size != table:
            if self.target is not None:
                self.target.release()
            self.target = Target(self.ctx, table, (1,))
        width, height = gbuffer.position.size
        self.program(
            self.target,
            scissor=(0, 0, table[0], -(-records.count // table[0])),
            **{name: value for name, value in records.uniforms.items() if name in self.program.uniforms},
            count=records.count,
            clip_from_world=camera.clip_from_view(width / height, 1e-3, 1e3) @ camera.view_from_world,
            **reach_uniforms(camera, settings),
            pixel=camera.screen / height,
            position=gbuffer.position,
            normal=gbuffer.normal,
            in_front=settings.in_front,
        )
        pixels: np.ndarray = np.frombuffer(self.target.textures[0].read(), "f4")[: records.count]
        return pixels
