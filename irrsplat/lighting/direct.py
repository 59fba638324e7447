"""Direct light at every pixel of a view, with shadow maps antialiased by dithered samples (Jones 2010, section 2.4)."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl

from irrsplat.core.buffers import GBuffer, ShadowMaps, Uniforms
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import Region, Target
from irrsplat.gpu.world import World

_MARKS, _RAYS = "SHADOW_MARKS", "SHADOW_RAYS"  # the two draws of a scene with rays


def direct_target(ctx: moderngl.Context, size: tuple[int, int]) -> Target:
    """Return a target for direct light; its depth marks the pixels where a shadow ray decides."""
    return Target(ctx, size, (4,), depth=True)


class DirectPass(Owner):
    """Pass that draws the direct outgoing radiance of a view of `size` (width, height).

    kinds: light_defines, and with rays also World.material_defines. irradiance: draw E_direct instead, W/m², independent of
    reflectance.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], kinds: Mapping[str, int], irradiance: bool = False) -> None:
        kinds = {**kinds, "IRRADIANCE": 1} if irradiance else kinds
        ways: dict[str, dict[str, int]] = {"": {}, _MARKS: {_MARKS: 1}, _RAYS: {_RAYS: 1}}
        self._programs = {
            (bent, way): self.own(Program(ctx, "lighting/direct", "lib/fullscreen", {**kinds, "NORMAL_MAPS": bent, **defines}))
            for bent in (0, 1)
            for way, defines in ways.items()
        }
        self.target = self.own(direct_target(ctx, size))

    def __call__(
        self,
        gbuffer: GBuffer,
        shadows: ShadowMaps,
        rotation: float = 0.0,
        target: Target | None = None,
        world: World | None = None,
        band: Region | None = None,
    ) -> moderngl.Texture:
        """Return ρ/π·E_direct, and 1 on surfaces, as an RGBA32F texture, the target's (default: this pass's own).

        rotation: of the pattern of shadow samples, radians. world: its rays decide pixels whose shadow samples differ, and keep
        facet shadows off curved surfaces; None: use the mean of the samples. band: the part (x, y, width, height) to draw; None:
        all of it.
        """
        target = target or self.target
        uniforms: Uniforms = {
            **gbuffer.surface_uniforms,
            "picture_corner": gbuffer.corner,
            "rotation": rotation,
            **gbuffer.material_uniforms,
            **shadows.uniforms,
        }
        if gbuffer.mapped_normal is not None:
            uniforms["lit_normal"] = gbuffer.mapped_normal
        if world is not None:
            uniforms |= {**world.trace_uniforms, "lit": world.geometry.counts.lit}
        bent = int(gbuffer.mapped_normal is not None)
        way, state = ("", DrawState()) if world is None else (_MARKS, DrawState(depth="1"))
        program = self._programs[bent, way]
        program(target, state=state, scissor=band, **program.declared(uniforms))
        if world is not None:
            program, state = self._programs[bent, _RAYS], DrawState(depth="<", depth_write=False)
            program(target, state=state, scissor=band, **program.declared(uniforms))
        return target.textures[0]
