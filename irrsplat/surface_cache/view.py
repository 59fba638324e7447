"""What the surface cache says of every pixel of a view."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl

from irrsplat.core.buffers import GBuffer, Uniforms
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target


class SurfaceViewPass(Owner):
    """Looks the surface cache up at pixels. materials: World.material_defines (default: nothing is cut out)."""

    def __init__(self, ctx: moderngl.Context, materials: Mapping[str, int] | None = None) -> None:
        self.ctx = ctx
        self.program = Program(ctx, "surface_cache/view", "lib/fullscreen", materials)
        self.target: Target | None = None

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.program, self.target)

    def __call__(self, gbuffer: GBuffer, surface: Uniforms) -> moderngl.Texture:
        """RGBA32F texture of indirect irradiance in W/m²; a: 1 where a surface is seen, else 0. It is this pass's own.

        surface: the cache's uniforms for triangles numbered as in the scene.
        """
        if self.target is None or self.target.size != gbuffer.position.size:
            if self.target is not None:
                self.target.release()
            self.target = Target(self.ctx, gbuffer.position.size, (4,))
        g = gbuffer
        self.program(self.target, position=g.position, normal=g.normal, albedo=g.albedo, emission=g.emission, **surface)
        return self.target.textures[0]
