"""Direct light at every pixel of a view, with shadow maps antialiased by dithered samples (Jones 2010, section 2.4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import moderngl

from irrsplat.core.buffers import GBuffer, ShadowMaps, Uniforms
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Region, Target
from irrsplat.gpu.world import World


@dataclass(frozen=True)
class Headlamp:
    """A point light at the eye, for direct light alone; its shadows are invisible from there and left out.

    position: (3,) world space. intensity: W/sr.
    """

    position: tuple[float, float, float]
    intensity: float


class DirectPass(Owner):
    """Pass that draws the direct outgoing radiance of a view of `size` (width, height).

    kinds: light_defines, and with rays also World.material_defines. irradiance: draw E_direct instead, W/m², independent of
    reflectance.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], kinds: Mapping[str, int], irradiance: bool = False) -> None:
        kinds = {**kinds, "IRRADIANCE": 1} if irradiance else kinds
        self._programs = {
            (bent, rays): Program(ctx, "lighting/direct", "lib/fullscreen", {**kinds, "NORMAL_MAPS": bent, "SHADOW_RAYS": rays})
            for bent in (0, 1)
            for rays in (0, 1)
        }
        self.target = Target(ctx, size, (4,))

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (*self._programs.values(), self.target)

    def __call__(
        self,
        gbuffer: GBuffer,
        shadows: ShadowMaps,
        rotation: float = 0.0,
        target: Target | None = None,
        headlamp: Headlamp | None = None,
        world: World | None = None,
        band: Region | None = None,
    ) -> moderngl.Texture:
        """Return ρ/π·E_direct, and 1 on surfaces, as an RGBA32F texture, the target's (default: this pass's own).

        rotation: of the pattern of shadow samples, radians. world: its rays decide pixels whose shadow samples differ, and keep
        facet shadows off curved surfaces; None: use the mean of the samples. band: the part (x, y, width, height) to draw; None:
        all of it.
        """
        target = target or self.target
        lamp = (0.0, 0.0, 0.0, 0.0) if headlamp is None else (*headlamp.position, headlamp.intensity)
        uniforms: Uniforms = {
            "position": gbuffer.position,
            "normal": gbuffer.normal,
            "picture_corner": gbuffer.corner,
            "rotation": rotation,
            "headlamp": lamp,
            **gbuffer.material_uniforms,
            **shadows.uniforms,
        }
        if gbuffer.mapped_normal is not None:
            uniforms["lit_normal"] = gbuffer.mapped_normal
        if world is not None:
            uniforms |= {**world.trace_uniforms, "lit": world.geometry.counts.lit}
        program = self._programs[int(gbuffer.mapped_normal is not None), int(world is not None)]
        program(target, scissor=band, **program.declared(uniforms))
        return target.textures[0]
