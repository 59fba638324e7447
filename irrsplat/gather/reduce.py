"""The reduction: irradiance and harmonic mean distance of a batch of records from their atlas, on the GPU.

E = Σ L·cosθ·dω (Larsen and Christensen 2004), R = Σ cosθ·dω / Σ (cosθ·dω / r).
"""

from __future__ import annotations

from itertools import product
from typing import Any

import moderngl

from irrsplat.core.buffers import Atlas, Records, Uniforms
from irrsplat.core.record_layout import GATHERED
from irrsplat.gather.light_samples import LightSamplePass
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target, uneven
from irrsplat.lighting.sky import sky_defines
from irrsplat.settings import WIDE

_SUMS = "sums", "share", *(f"sums_{what}_{channel}" for what, channel in product("mg", "rgb"))  # as in reduce_blocks.frag


class ReducePass(Owner):
    """Pass that sums the cells of an atlas: first each block, then all blocks of a record.

    gradients: True if it also computes M, ∇E and the Hessian, which need a single eye position. places: number of eye positions
    of a record.
    """

    def __init__(self, ctx: moderngl.Context, gradients: bool, places: int = 1) -> None:
        self.ctx, self.places = ctx, places
        defines = {"GRADIENTS": int(gradients)}
        self.components = (4,) * (8 if gradients else 2)
        self.blocks = {
            (sky_map, share): self.own(
                Program(ctx, "gather/reduce_blocks", "lib/fullscreen", defines | {"SKY_MAP": sky_map, "SKY_SHARE": share})
            )
            for sky_map, share in product((0, 1), (0, 1))
        }
        self.totals = [
            self.own(Program(ctx, "gather/reduce_total", defines=defines | {"WIDE": WIDE, "CLOSE_LIGHT": on})) for on in (0, 1)
        ]
        self.light_samples = self.own(LightSamplePass(ctx, gradients, places))
        self.targets = self.own(Workshop())

    def __call__(self, atlas: Atlas, records: Records, sky: Uniforms, radii: tuple[float, float]) -> None:
        """Write E, R, M and ∇E of the atlas's records into `records`, each at its number; R is kept within `radii`.

        sky: the uniforms of shaders/lighting/sky.glsl.
        """
        size = uneven(atlas.radiance.width // atlas.block[0]), uneven(atlas.radiance.height // atlas.block[1])
        target = self.targets.get(f"sums of {size}", (), lambda: Target(self.ctx, size, self.components))
        per_cell = atlas.cell[0] // atlas.block[0], atlas.cell[1] // atlas.block[1]
        across, down = min(atlas.count, atlas.columns), -(-atlas.count // atlas.columns)
        used = (0, 0, across * per_cell[0], down * per_cell[1])
        mapped = sky_defines(sky)["SKY_MAP"]
        looks: Uniforms = {} if atlas.sky_share is None else {"sky_share": atlas.sky_share}
        self.blocks[mapped, int(atlas.sky_share is not None)](
            target,
            scissor=used,
            radiance=atlas.radiance,
            table=atlas.table,
            rays=atlas.rays or atlas.table,
            planes=atlas.planes,
            edges=atlas.edges,
            frames=atlas.frames,
            cell=atlas.cell,
            block=atlas.block,
            columns=atlas.columns,
            places=self.places,
            **sky,
            **looks,
        )
        self.light_samples(target, atlas, per_cell, used)
        sums: dict[str, Any] = dict(zip(_SUMS, target.textures, strict=False))
        textures = [records.textures[name] for name in GATHERED]
        self.totals[atlas.close_light is not None](
            self.targets.get("records", textures, lambda: Target(self.ctx, records.size, textures=textures)),
            vertices=atlas.count,
            mode=moderngl.POINTS,
            **sums,
            frames=atlas.frames,
            blocks=per_cell,
            columns=atlas.columns,
            places=self.places,
            table=records.size,
            radii=radii,
            **(atlas.close_light or {}),
        )
