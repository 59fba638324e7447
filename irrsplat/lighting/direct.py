"""Direct light at every pixel of a view, with shadow maps that are antialiased by dithered samples (Jones 2010, section 2.4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import moderngl

from irrsplat.core.buffers import GBuffer, ShadowMaps, Uniforms
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target


@dataclass(frozen=True)
class Headlamp:
    """A point light at the eye: direct light alone, without shadows, which nobody there would see. position: (3,) world space;
    intensity: W/sr."""

    position: tuple[float, float, float]
    intensity: float


class DirectPass(Owner):
    """Draws the direct outgoing radiance of a view of `size` (width, height), by lights of the kinds that light_defines tells.

    irradiance: draws E_direct in its place, W/m², whatever the surfaces reflect.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], lights: Mapping[str, int], irradiance: bool = False) -> None:
        lights = {**lights, "IRRADIANCE": 1} if irradiance else lights
        self.program = Program(ctx, "lighting/direct", "lib/fullscreen", {**lights, "NORMAL_MAPS": 0})
        self.bent = Program(ctx, "lighting/direct", "lib/fullscreen", {**lights, "NORMAL_MAPS": 1})
        self.target = Target(ctx, size, (4,))

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.program, self.bent, self.target)

    def __call__(
        self,
        gbuffer: GBuffer,
        shadows: ShadowMaps,
        rotation: float = 0.0,
        target: Target | None = None,
        headlamp: Headlamp | None = None,
    ) -> moderngl.Texture:
        """ρ/π·E_direct, and 1 where a surface is seen, as an RGBA32F texture, the target's (default: this pass's own).

        rotation: of the pattern of shadow samples, radians.
        """
        target = target or self.target
        lamp = (0.0, 0.0, 0.0, 0.0) if headlamp is None else (*headlamp.position, headlamp.intensity)
        uniforms: Uniforms = {
            "position": gbuffer.position,
            "normal": gbuffer.normal,
            "picture_corner": gbuffer.corner,
            **gbuffer.material_uniforms,
            **shadows.uniforms,
        }
        if gbuffer.mapped_normal is None:
            self.program(target, **uniforms, rotation=rotation, headlamp=lamp)
        else:
            self.bent(target, **uniforms, lit_normal=gbuffer.mapped_normal, rotation=rotation, headlamp=lamp)
        return target.textures[0]
