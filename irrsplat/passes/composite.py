"""The composite: normalised indirect light, blended with direct, then exposure, a filmic curve and sRGB (Jones 2010, 3.6)."""

from __future__ import annotations

import math

import moderngl

from irrsplat.buffers import FILMIC, GBuffer, SplatBuffer
from irrsplat.display import MID_GREY
from irrsplat.gpu.program import Program
from irrsplat.gpu.target import Target
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings

_METER = 64  # blocks along each side of the image
_SMOOTH = 0.01  # radius of the smoothing, of the image height


class CompositePass:
    """Makes irradiance, image and display picture of a view of `size` (width, height)."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.size = size
        self.normalise = Program(ctx, "composite", "lib/fullscreen")
        self.blend = Program(ctx, "composite_image", "lib/fullscreen")
        self.meter = Program(ctx, "composite_meter", "lib/fullscreen")
        self.display = Program(ctx, "composite_display", "lib/fullscreen", FILMIC.defines)
        self.irradiance_target = Target(ctx, size, (4,))
        self.image_target = Target(ctx, size, (4,))
        self.meter_block = (-(-size[0] // _METER), -(-size[1] // _METER))
        self.meter_target = Target(ctx, (-(-size[0] // self.meter_block[0]), -(-size[1] // self.meter_block[1])), (2,))

    def irradiance(self, splats: SplatBuffer, gbuffer: GBuffer, camera: Camera, settings: Settings) -> moderngl.Texture:
        """E at every pixel, Σ k·E / Σ k, smoothed where the settings say so; 0 where no record speaks."""
        height = self.size[1]
        self.normalise(
            self.irradiance_target,
            position=gbuffer.position,
            normal=gbuffer.normal,
            sums=splats.sums,
            smooth_radius=max(1, round(_SMOOTH * height)) if settings.smooth else 0,
            pixel_size=2.0 * math.tan(math.radians(camera.fov) / 2.0) / height,
        )
        return self.irradiance_target.textures[0]

    def image(
        self,
        irradiance: moderngl.Texture,
        direct: moderngl.Texture,
        gbuffer: GBuffer,
        sky: tuple[float, float, float],
        blend: float,
    ) -> moderngl.Texture:
        """Radiance before exposure: direct and indirect by the weights min(1, 2(1-b)) and min(1, 2b), emission, sky."""
        self.blend(
            self.image_target,
            position=gbuffer.position,
            albedo=gbuffer.albedo,
            emission=gbuffer.emission,
            direct=direct,
            irradiance=irradiance,
            blend=(min(1.0, 2.0 * (1.0 - blend)), min(1.0, 2.0 * blend)),
            sky=sky,
        )
        return self.image_target.textures[0]

    def exposure(self, image: moderngl.Texture) -> float:
        """The stops that bring the image's geometric mean luminance (of its lit pixels) to mid grey; 0 for a black image."""
        self.meter(self.meter_target, image=image, block=self.meter_block)
        total, lit = self.meter_target.read().sum((0, 1), dtype=float)
        return math.log2(MID_GREY) - total / lit if lit else 0.0

    def show(self, image: moderngl.Texture, exposure: float, target: Target) -> None:
        """Draw the image into `target` (of the same size) as a screen takes it: exposed by `exposure` stops, filmic, sRGB."""
        self.display(target, image=image, exposure=exposure)
