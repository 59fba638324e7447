"""What OpenGL can draw here: the size of the picture and the number of lights, checked before anything is made."""

from __future__ import annotations

import operator

import moderngl

from irrsplat.core.buffers import LIGHT_ROWS, LUMINAIRE_ROWS
from irrsplat.core.errors import InputError
from irrsplat.lighting.light_table import light_table, sheet
from irrsplat.lighting.luminaire_table import photometries, photometry_size
from irrsplat.scene.model import Scene


def checked(size: tuple[int, int]) -> tuple[int, int]:
    """`size` as width and height in pixels; raises InputError where it is not two whole numbers of at least 1."""
    try:
        width, height = (operator.index(n) for n in size)
    except (TypeError, ValueError):
        raise InputError(f"size takes two whole numbers, width and height, not {size!r}") from None
    if width < 1 or height < 1:
        raise InputError(f"size must be at least 1x1 pixels, not {width}x{height}")
    return width, height


def check(ctx: moderngl.Context, size: tuple[int, int], scene: Scene, shadow_size: int) -> None:
    """Raises InputError for a picture too large for `ctx`, too many lights, or more shadow tiles of `shadow_size` than fit."""
    limit = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
    if max(size) > limit:
        raise InputError(f"size {size[0]}x{size[1]} is beyond the limit here, {limit} pixels a side")
    different = photometries(scene.lights)
    rows = LIGHT_ROWS + (LUMINAIRE_ROWS if different else 0)
    most = int(ctx.info["GL_MAX_FRAGMENT_UNIFORM_VECTORS"]) // rows - 8  # the tables are uniforms; there are others
    if len(scene.lights) > most:
        raise InputError(f"the scene has {len(scene.lights)} lights, and this OpenGL takes {most}: leave some out")
    sheet(len(light_table(scene, shadow_size).tiles), shadow_size, limit)
    if max(photometry_size(different)) > limit:
        raise InputError(f"the luminaires' candela need a texture of more than {limit} texels a side: leave some luminaires out")
