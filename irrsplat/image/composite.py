"""The composite: normalised indirect light, blended with direct, then exposure, a filmic curve and sRGB (Jones 2010, 3.6)."""

from __future__ import annotations

from functools import partial
from itertools import product

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Uniforms
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import Target, table_texture
from irrsplat.image.backdrop import Backdrop
from irrsplat.image.tonemap import automatic_exposure
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

    def exposure(self, image: moderngl.Texture, gbuffer: GBuffer, unshadowed: float = 0.0) -> float:
        """Return the stops of image.tonemap.automatic_exposure for the image."""
        self.meter(self.meter_target, image=image, position=gbuffer.position, block=self.meter_block, **gbuffer.material_uniforms)
        total, lit, _, _ = self.meter_target.read().reshape(-1, 4).sum(0, dtype=float).tolist()
        return automatic_exposure(total, lit, unshadowed)

    def show(self, image: moderngl.Texture, exposure: float, target: Target) -> None:
        """Draw the image into `target` (of equal size) as display values: exposed by `exposure` stops, filmic, sRGB."""
        self.display(target, image=image, exposure=exposure)
