"""Choice of tiled drawing: by the caller, or where memory or OpenGL's texture limit requires tiles."""

from __future__ import annotations

import operator
from collections.abc import Collection
from dataclasses import replace

import moderngl

from irrsplat.core.errors import InputError
from irrsplat.gpu import context
from irrsplat.lighting import gl_limits
from irrsplat.renderer import memory
from irrsplat.renderer.state import State
from irrsplat.settings import LEAST_TILE, MOST_TILE

TILE = 1024  # pixels along a side of tiles by default


def fitting(state: State, ctx: moderngl.Context, buffers: Collection[str] | None = memory.PICTURE) -> State:
    """Return `state`, with tiles if its pictures with these `buffers` need them.

    Raises InputError for pictures that do not fit into memory, or into a texture.
    """
    software = bool(context.describe(ctx)["software"])
    tile, size = state.tile_size or state.tile, state.size
    short = memory.shortage(size, state.scene, state.settings, software, buffers, tile)
    if state.tile_size is None and not tile and (short or max(size) > gl_limits.largest(ctx)):
        tile = TILE
        short = memory.shortage(size, state.scene, state.settings, software, buffers, tile)
    if short:
        raise InputError(short)
    return replace(state, tile=tile)


def checked(state: State, ctx: moderngl.Context, again: bool) -> State:
    """Return `state`, with tiles if it needs them; see `fitting`. again: True for a state of another size.

    Raises InputError for pictures beyond the limits of OpenGL.
    """
    state = fitting(replace(state, tile=0), ctx) if again else state
    at_once = (2 * state.tile, 2 * state.tile) if state.tile else state.size
    gl_limits.check(ctx, at_once, state.scene)
    return state


def notices(state: State) -> tuple[str, ...]:
    """Return the notice for the user if a picture is tiled without a request."""
    if state.tile_size is not None or not state.tile:
        return ()
    width, height = state.size
    return (f"size {width}x{height} is more than fits here at once; it is drawn in tiles of {state.tile}x{state.tile}",)


def check_whole(state: State) -> None:
    """Raise InputError if views are drawn in tiles."""
    if state.tile:
        width, height = state.size
        raise InputError(f"size {width}x{height} is drawn in tiles here, which only rendering does: take a smaller size")


def check_tiled(state: State, figures: bool) -> None:
    """Raise InputError if a tiled picture cannot meet the request."""
    settings = state.settings
    features = {"a folder's figures": figures, "--quality": settings.quality, "--placement scan": settings.placement == "scan"}
    if not_there := [name for name, requested in features.items() if requested]:
        width, height = state.size
        raise InputError(f"size {width}x{height} is drawn in tiles here, without {' and '.join(not_there)}: take a smaller size")


def checked_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return `size` as width and height in pixels; raises InputError unless both are whole numbers of at least 1."""
    try:
        width, height = (operator.index(n) for n in size)
    except (TypeError, ValueError):
        raise InputError(f"size takes two whole numbers, width and height, not {size!r}") from None
    if width < 1 or height < 1:
        raise InputError(f"size must be at least 1x1 pixels, not {width}x{height}")
    return width, height


def checked_tile_size(tile_size: int | None) -> int | None:
    """Return the side of tiles, 0 for no tiles, or None for tiles where they are needed. Raises InputError for other values."""
    try:
        found = None if tile_size is None else operator.index(tile_size)
    except TypeError:
        raise InputError(f"tile_size takes a whole number of pixels, not {tile_size!r}") from None
    if found and not LEAST_TILE <= found <= MOST_TILE:
        raise InputError(f"tile_size is 0 or between {LEAST_TILE} and {MOST_TILE} pixels, not {found}")
    return found
