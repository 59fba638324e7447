"""The g-buffer: position, normals and material at every pixel's centre (Jones 2010, section 3.2)."""

from __future__ import annotations

from dataclasses import fields

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target
from irrsplat.gpu.world import World
from irrsplat.scene.model import Camera

_NEAR = 1e-6  # of the far distance: only the matrix has it, nothing is clipped there


class GBufferTarget(Target):
    """What a g-buffer is drawn into: the textures of buffers.GBuffer, and depth."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        super().__init__(ctx, size, (4,) * len(fields(GBuffer)), depth=True)
        self.marked = Target(ctx, size, textures=self.textures[:1], depth_attachment=self.depth)

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.marked, *super().owned())


class GBufferPass(Owner):
    """Draws the world's scene from the eye into float textures of `size` (width, height)."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.program = Program(ctx, "image/gbuffer")
        self.target = GBufferTarget(ctx, size)

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.program, self.target)

    def __call__(self, world: World, camera: Camera, target: GBufferTarget | None = None) -> GBuffer:
        """What `camera` sees; the textures are the target's (default: this pass's own), and hold until it is drawn into again."""
        target, scene, geometry = target or self.target, world.scene, world.geometry
        width, height = target.size
        eye = np.asarray(camera.eye, float)
        far = 1.01 * float(np.linalg.norm(scene.corners - eye, axis=1).max()) + 1e-3 * scene.diagonal
        target.marked.clear()  # depth 0 says that a pixel sees nothing: the other textures are not looked at there
        self.program(
            target,
            geometry=geometry,
            state=DrawState(depth="<", depth_clamp=True),
            clip_from_world=camera.clip_from_view(width / height, _NEAR * far, far) @ camera.view_from_world,
            eye=eye,
            forward=-camera.axes[2],
            far=far,
            closed=geometry.parts["closed"][1] // 3,
            **world.raster_uniforms,
        )
        return GBuffer(*target.textures)
