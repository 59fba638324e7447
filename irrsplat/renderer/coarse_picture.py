"""The picture of a view of which every other pixel is splatted: direct light, upsampled indirect light and their sum in one draw.

A view in motion is drawn so in every frame. What the draw does without, it need not write and read back for each pixel.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import moderngl

from irrsplat.core.buffers import GBuffer, ShadowMaps, SplatBuffer, Uniforms
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target, depth_texture
from irrsplat.image.backdrop import Backdrop
from irrsplat.indirect.upsample import UpsamplePass
from irrsplat.lighting.direct import Headlamp, headlamp_uniform
from irrsplat.scene.model import Camera


class CoarsePicturePass(Owner):
    """Draws image and alpha into the textures of `target`, which it borrows, by lights of the kinds that light_defines tells.

    It is what upsampling, DirectPass and CompositePass make one after the other of a view without filters and normal maps.
    """

    def __init__(self, ctx: moderngl.Context, target: Target, lights: Mapping[str, int]) -> None:
        self.depth = depth_texture(ctx, target.size)  # where pixels are marked that are to be searched for
        self.target = Target(ctx, target.size, textures=target.textures, depth_attachment=self.depth)
        self.pictures = {  # by whether any surface emits, and Backdrop.sky_terms
            (emissive, sky): Program(
                ctx,
                "upsample/picture",
                "lib/fullscreen",
                {**lights, "NORMAL_MAPS": 0, "EMISSIVE": emissive, "SKY": sky, "SKY_MAP": int(sky == 3)},
            )
            for emissive, sky in product((0, 1), (0, 1, 2, 3))
        }
        self.search = Program(ctx, "upsample/picture_search", "lib/fullscreen")

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (*self.pictures.values(), self.search, self.target, self.depth)

    def __call__(
        self,
        splats: SplatBuffer,
        upsample: UpsamplePass,
        gbuffer: GBuffer,
        shadows: ShadowMaps,
        headlamp: Headlamp | None,
        backdrop: Backdrop,
        camera: Camera,
        mix: tuple[float, float],
    ) -> tuple[moderngl.Texture, moderngl.Texture]:
        """The image before exposure, and its alpha. mix: weights of direct and of indirect light."""
        squares, sky = upsample.prepared(splats, gbuffer, camera), backdrop.sky_terms
        seen: Uniforms = {"position": gbuffer.position, "normal": gbuffer.normal, **gbuffer.material_uniforms, "blend": mix}
        behind: Uniforms = backdrop.uniforms(camera, self.target.size) if sky else {}
        self.pictures[int(gbuffer.emissive), sky](
            self.target,
            state=DrawState(depth="1"),
            **{**behind, "picture_corner": gbuffer.corner},
            **seen,
            **squares,
            **shadows.uniforms,
            headlamp=headlamp_uniform(headlamp),
            rotation=0.0,
        )
        self.search(self.target, state=DrawState(depth="<", depth_write=False, blend="add"), **seen, sums=splats.sums)
        image, alpha = self.target.textures
        return image, alpha
