"""Limits of OpenGL: size of the picture, number of lights, and size of their shadow tiles."""

from __future__ import annotations

import moderngl

from irrsplat.core.buffers import LIGHT_ROWS, LUMINAIRE_ROWS
from irrsplat.core.errors import InputError
from irrsplat.lighting.light_table import sheet, tile_count
from irrsplat.lighting.luminaire_table import photometries, photometry_size
from irrsplat.scene.model import Scene


def largest(ctx: moderngl.Context) -> int:
    """Return the greatest side of a drawing, pixels."""
    return int(ctx.info["GL_MAX_TEXTURE_SIZE"])


def shadow_notices(ctx: moderngl.Context, scene: Scene, shadow_size: int) -> tuple[str, ...]:
    """Return the notice for the user if the shadow tiles of all lights are smaller than `shadow_size`, to fit."""
    count = tile_count(scene)
    side, *_ = sheet(count, shadow_size, largest(ctx))
    if side == shadow_size:
        return ()
    return (f"the lights need {count} shadow tiles; they have {side} texels a side here instead of {shadow_size}",)


def check(ctx: moderngl.Context, size: tuple[int, int], scene: Scene) -> None:
    """Raise InputError for a picture too large for `ctx`, or too many lights."""
    limit = largest(ctx)
    if max(size) > limit:
        raise InputError(f"size {size[0]}x{size[1]} is beyond the limit here, {limit} pixels a side")
    different = photometries(scene.lights)
    rows = LIGHT_ROWS + 2 + (LUMINAIRE_ROWS if different else 0)  # 2: of shaders/lighting/virtual_lights/hit.glsl
    most = int(ctx.info["GL_MAX_FRAGMENT_UNIFORM_VECTORS"]) // rows - 8  # light tables are uniforms; 8 rows for other uniforms
    if len(scene.lights) > most:
        raise InputError(f"the scene has {len(scene.lights)} lights, and this OpenGL takes {most}: leave some out")
    if max(photometry_size(different)) > limit:
        raise InputError(f"the luminaires' candela need a texture of more than {limit} texels a side: leave some luminaires out")
