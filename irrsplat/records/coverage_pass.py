"""Number of pixels that each record covers in a view; refresh_order.py refreshes records by it."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Records
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.target import Target
from irrsplat.records.weight import record_defines, view_radius_uniforms
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings


class CoveragePass(Owner):
    """Estimate of covered pixels, from samples of each record's bounding box on screen.

    gradients: records have derivatives.
    """

    def __init__(self, ctx: moderngl.Context, gradients: bool) -> None:
        self.ctx = ctx
        self.program = Program(ctx, "records/coverage", "lib/fullscreen", record_defines(gradients))
        self.targets = Workshop()

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (self.program, self.targets)

    def __call__(self, records: Records, gbuffer: GBuffer, camera: Camera, settings: Settings) -> np.ndarray:
        """Return (N,) float32, the estimated number of pixels that each record covers; 0 for hidden or off-screen records."""
        target = self.targets.get("target", records.size, lambda: Target(self.ctx, records.size, (1,)))
        width, height = gbuffer.position.size
        columns = records.size[0]
        self.program(
            target,
            scissor=(0, 0, columns, -(-records.count // columns)),
            **records.uniforms,
            count=records.count,
            clip_from_world=camera.clip_from_view(width / height, 1e-3, 1e3) @ camera.view_from_world,
            **view_radius_uniforms(camera, (width, height), settings),
            pixel=camera.pixel((width, height)),
            position=gbuffer.position,
            normal=gbuffer.normal,
        )
        pixels: np.ndarray = np.frombuffer(target.textures[0].read(), "f4")[: records.count]
        return pixels
