"""The composite: normalised indirect light, blended with direct, then exposure, a filmic curve and sRGB (Jones 2010, 3.6)."""

from __future__ import annotations

from functools import partial
from itertools import product

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Uniforms
from irrsplat.core.timing.input_waits import stop_for_input
from irrsplat.gpu.program import Program, SampledTexture
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import Target, bands, table_texture
from irrsplat.image.backdrop import Backdrop
from irrsplat.image.tonemap import automatic_exposure
from irrsplat.lighting.sky import sky_defines
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings

_METER = 64  # blocks along each side of the image


class NoFilters(Owner):
    """Neutral textures in place of Filters: one texel that transmits all light, and one that adds none."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.tint, self.glow = (self.own(table_texture(ctx, np.full((1, 1, 4), value))) for value in (1.0, 0.0))

    def uniforms(self, gbuffer: GBuffer) -> Uniforms:
        """Return the uniforms of shaders/image/filtered.glsl for this g-buffer."""
        filters = gbuffer.filters
        return {"tint": filters.tint if filters else self.tint, "glow": (filters and filters.glow) or self.glow}


class CompositePass(Owner):
    """Composes the image and display picture of a view of `size` (width, height)."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.size = size
        self.fills = [self.own(Program(ctx, "image/composite_fill", "lib/fullscreen", {"SKY_MAP": map_})) for map_ in (0, 1)]
        blend = partial(Program, ctx, "image/composite", "lib/fullscreen")
        self.blends = {  # by presence of filters, presence of emission, and Backdrop.sky_terms; 2 or 3 with filters
            (filters, emissive, sky): self.own(
                blend({"FILTERS": filters, "EMISSIVE": emissive, "SKY": sky, "SKY_MAP": int(sky == 3)})
            )
            for filters, emissive, sky in product((0, 1), (0, 1), (0, 1, 2, 3))
            if sky >= 2 or not filters
        }
        self.meter = self.own(Program(ctx, "image/composite_meter", "lib/fullscreen"))
        self.display = self.own(Program(ctx, "image/composite_display", "lib/fullscreen"))
        self.target = self.own(Target(ctx, size, (4, 1)))
        self.no_filters = self.own(NoFilters(ctx))
        self.mipmapped = self.own(
            ctx.sampler(repeat_x=False, repeat_y=False, filter=(moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR))
        )
        self.fill_target: Target | None = None
        self.meter_block = -(-size[0] // _METER), -(-size[1] // _METER)
        self.meter_target = self.own(Target(ctx, (-(-size[0] // self.meter_block[0]), -(-size[1] // self.meter_block[1])), (4,)))

    def __call__(
        self,
        sums: moderngl.Texture,
        direct: moderngl.Texture,
        gbuffer: GBuffer,
        backdrop: Backdrop,
        camera: Camera,
        settings: Settings,
    ) -> tuple[moderngl.Texture, moderngl.Texture]:
        """Return the image before exposure, and its alpha.

        Direct and indirect light are weighted by Settings.mix; emission and sky are not weighted. Filters tint all of them.
        """
        filtered = gbuffer.filters is not None
        sky = (2 if backdrop.maps is None else 3) if filtered else backdrop.sky_terms
        behind: Uniforms = self.no_filters.uniforms(gbuffer) if filtered else {}
        if sky:
            behind |= backdrop.uniforms(camera, self.size)
        self.blends[int(filtered), int(gbuffer.emissive), sky](
            self.target, **gbuffer.material_uniforms, direct=direct, sums=sums, blend=settings.mix, **behind
        )
        image, alpha = self.target.textures
        return image, alpha

    def filled(self, sums: moderngl.Texture, direct: moderngl.Texture, gbuffer: GBuffer, backdrop: Backdrop) -> moderngl.Texture:
        """Return the sums (Σ k·E, Σ k) in a texture of this pass, with empty pixels filled from their surroundings.

        Raises InputWaits between two bands.
        """
        self.fill_target = self.fill_target or self.own(Target(self.target.ctx, self.size, (4,)))
        for texture in (sums, direct):
            texture.build_mipmaps()
            texture.filter = moderngl.NEAREST, moderngl.NEAREST  # the filters of other readers
        levels = max(self.size).bit_length()
        light: Uniforms = {"sums": SampledTexture(sums, self.mipmapped), "direct": SampledTexture(direct, self.mipmapped)}
        sky = backdrop.sky_uniforms
        fill = self.fills[sky_defines(sky)["SKY_MAP"]]
        for band in bands(self.size):
            fill(self.fill_target, scissor=band, levels=levels, **light, **gbuffer.surface_uniforms, **sky)
            stop_for_input(self.target.ctx)
        return self.fill_target.textures[0]

    def exposure(self, image: moderngl.Texture, gbuffer: GBuffer, unshadowed: float = 0.0) -> float:
        """Return the stops of image.tonemap.automatic_exposure for the image."""
        self.meter(self.meter_target, image=image, position=gbuffer.position, block=self.meter_block, **gbuffer.material_uniforms)
        total, lit, _, _ = self.meter_target.read().reshape(-1, 4).sum(0, dtype=float).tolist()
        return automatic_exposure(total, lit, unshadowed)

    def show(self, image: moderngl.Texture, exposure: float, target: Target) -> None:
        """Draw the image into `target` (of equal size) as display values: exposed by `exposure` stops, filmic, sRGB."""
        self.display(target, image=image, exposure=exposure)
