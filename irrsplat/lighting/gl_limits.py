"""What can be drawn at all: sizes and numbers of lights, checked before anything is made."""

from __future__ import annotations

import operator

import moderngl

from irrsplat.core.errors import InputError
from irrsplat.lighting.light_table import light_table, sheet
from irrsplat.scene.model import Scene


def checked(size: tuple[int, int]) -> tuple[int, int]:
    """`size` as two whole numbers of pixels, width and height; raises InputError where it is none."""
    try:
        width, height = (operator.index(n) for n in size)
    except (TypeError, ValueError):
        raise InputError(f"size takes two whole numbers, width and height, not {size!r}") from None
    if width < 1 or height < 1:
        raise InputError(f"size must be at least 1x1 pixels, not {width}x{height}")
    return width, height


def check(ctx: moderngl.Context, size: tuple[int, int], scene: Scene, shadow_size: int) -> None:
    """Raises InputError where `ctx` takes no picture of this size, or not so many lights with shadow tiles of so many texels."""
    limit = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
    if max(size) > limit:
        raise InputError(f"size {size[0]}x{size[1]} is beyond the limit here, {limit} pixels a side")
    most = int(ctx.info["GL_MAX_FRAGMENT_UNIFORM_VECTORS"]) // 8 - 8  # eight rows of the light table a light
    if len(scene.lights) > most:
        raise InputError(f"the scene has {len(scene.lights)} lights, and this OpenGL takes {most}: leave some out")
    sheet(len(light_table(scene, shadow_size).tiles), shadow_size, limit)
