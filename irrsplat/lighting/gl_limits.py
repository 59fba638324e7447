"""Limits of OpenGL and memory: size of the picture and number of lights, checked before anything is allocated."""

from __future__ import annotations

import operator
from collections.abc import Collection

import moderngl

from irrsplat.core.buffers import CHANNELS, LIGHT_ROWS, LUMINAIRE_ROWS
from irrsplat.core.errors import InputError
from irrsplat.lighting import memory
from irrsplat.lighting.light_table import sheet, tile_count
from irrsplat.lighting.luminaire_table import photometries, photometry_size
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings

LARGE = 1 << 22  # pixels, size from which a picture's memory is checked
PICTURE = frozenset(("image", "alpha"))
_BESIDE = 450_000_000  # bytes for gathers, surface cache, shadow maps and records, independent of the size
_READING = 28  # bytes a pixel, while one more buffer is read
_WRITING = 6  # bytes a pixel, while a .png is written
_AROUND = 1.25  # drawn side of a tile, in tile sides


def checked(size: tuple[int, int]) -> tuple[int, int]:
    """Return `size` as width and height in pixels; raises InputError unless both are whole numbers of at least 1."""
    try:
        width, height = (operator.index(n) for n in size)
    except (TypeError, ValueError):
        raise InputError(f"size takes two whole numbers, width and height, not {size!r}") from None
    if width < 1 or height < 1:
        raise InputError(f"size must be at least 1x1 pixels, not {width}x{height}")
    return width, height


def view_bytes(scene: Scene, settings: Settings) -> int:
    """Return the bytes a pixel of a view during rendering: g-buffer, splat buffer, picture, samples."""
    gbuffer, splats, image, direct, summed = 68, 35, 20, 20, 24  # summed: temporally filtered, or with holes filled
    gbuffer += 16 if any(material.normal_texture for material in scene.materials) else 0
    gbuffer += 36 if any(material.filters for material in scene.materials) else 0
    if settings.samples > 1:
        return 2 * (gbuffer + splats + direct) + summed + image + 68
    refined = 64 if settings.quality else 0  # two more splat buffers and their comparison
    return gbuffer + splats + refined + summed + direct + image


def shortage(
    size: tuple[int, int],
    scene: Scene,
    settings: Settings,
    software: bool,
    buffers: Collection[str] | None = PICTURE,
    tile: int = 0,
) -> str:
    """Return the error if a picture of `size`, with `buffers` as arrays (None: all), certainly exceeds free memory; else "".

    GPU memory is not known: on a GPU only the arrays count. tile: pixels, side of the tiles that are drawn one by one; 0: draw
    the picture whole.
    """
    names = set(CHANNELS if buffers is None else buffers) & CHANNELS.keys()
    arrays = 4 * sum(CHANNELS[name].components for name in names)
    pixel = view_bytes(scene, settings) if software else 0
    if tile:
        drawn = min(_AROUND * tile, max(size)) ** 2  # with the margin of a tile
        need = size[0] * size[1] * (arrays + _WRITING) + int(drawn) * (2 * pixel + _READING)
    else:
        need = size[0] * size[1] * (pixel + arrays + (0 if PICTURE.issuperset(names) else _READING))
    need += _BESIDE if software else 0
    free = memory.available()
    if size[0] * size[1] < LARGE or free is None or need <= free:
        return ""
    found = f"size {size[0]}x{size[1]} needs {need / 1e9:.1f} GB of memory, and {free / 1e9:.1f} GB are free here"
    return f"{found}: take a smaller size" + ("" if PICTURE.issuperset(names) else ", or fewer buffers: a .png needs least")


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
