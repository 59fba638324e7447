"""Pictures in tiles: a large picture is examined and drawn a part at a time, so that only its arrays have its size.

Pictures have tiles by the caller's choice, or where memory or OpenGL's texture limit requires tiles.

The whole picture requests records, in the rounds of a picture in one piece. Each round draws and examines every tile, and joins
the examinations before it chooses sites. Then every tile is drawn by the records of the whole picture.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from functools import partial

import moderngl
import numpy as np

from irrsplat.core.buffers import CHANNELS, GBuffer, SplatBuffer
from irrsplat.core.errors import InputError
from irrsplat.core.memo import Memo
from irrsplat.gather.spot_check import MARGIN, Spots
from irrsplat.gpu import context
from irrsplat.image.statistics import Statistics
from irrsplat.image.tonemap import automatic_exposure, metered
from irrsplat.image.view import BUFFERS, View, reflectance, uncovered
from irrsplat.indirect.examine import Examination, Screen, tile_count, tile_side
from irrsplat.lighting import gl_limits
from irrsplat.lighting.light_table import unshadowed_luminance
from irrsplat.records.culling import reaching
from irrsplat.renderer import memory
from irrsplat.renderer.stages import Stages
from irrsplat.renderer.state import Round, State
from irrsplat.scene.model import Camera, Part, part_of
from irrsplat.settings import LEAST_TILE, MOST_TILE, Settings

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


def tile_screen(stages: Stages, memo: Memo, state: State, camera: Camera, pixel_stride: int) -> Screen:
    """Return a view in tiles for the examination, with splats at every `pixel_stride`-th pixel.

    memo: keeps the examinations, since a tile that no new record reaches is not examined again.
    """
    cache = stages.scheduler.cache
    sums = camera, state.view_subject, pixel_stride, cache.revision, cache.count
    examine = partial(_examined, stages, memo, state, camera, pixel_stride)
    return Screen(camera, state.size, pixel_stride, sums, examine, partial(_spots, stages, state, camera))


def _examined(stages: Stages, memo: Memo, state: State, camera: Camera, stride: int, settings: Settings) -> Examination:
    """Return the examination of all tiles. A tile that no new record reaches keeps its last result."""
    cache = stages.scheduler.cache
    count = cache.count if settings.most_bounces > 0 else 0
    inputs = camera, state.view_subject, state.tile, stride, settings, cache.revision
    held: dict[Part, tuple[int, Examination]] = memo.get("examined", inputs, dict)  # with the number of its records
    cells = tile_count(state.size, stride)
    step = tile_side(state.size, stride) * stride  # pixels, of a tile of the examination
    across, up = (min(max(1, state.tile // step), n) for n in cells)
    whole: dict[str, np.ndarray] = {}
    for column, row in _grid(cells, (across, up)):
        part = Part(state.size, (column * step, row * step), (across * step, up * step))
        seen, (before, found) = part_of(camera, part), held.get(part, (0, None))
        if found is None or len(reaching(cache, before, seen, part.size, settings)):
            here = replace(state, size=part.size)
            found = stages.scheduler.examine_pass(*_splatted(stages, here, seen, stride), settings, part)
        held[part] = count, found
        for name, values in vars(found).items():
            whole_of = whole.setdefault(name, np.zeros((*cells[::-1], *values.shape[2:]), values.dtype))
            there = whole_of[::-1][row : row + up, column : column + across]  # rows run down
            there[:] = values[::-1][: there.shape[0], : there.shape[1]]
    return Examination(**whole)


def _spots(stages: Stages, state: State, camera: Camera, fine: bool) -> Spots:
    """Return the places of all tiles for a spot check, see SpotPass."""
    found: list[Spots] = []
    here = replace(state, size=(state.tile + 2 * MARGIN, state.tile + 2 * MARGIN))
    for x, y in _grid(state.size, (state.tile, state.tile)):
        seen = part_of(camera, Part(state.size, (x - MARGIN, y - MARGIN), here.size))
        found.append(stages.scheduler.spot_pass(*_splatted(stages, here, seen), seen, fine, MARGIN))
    return Spots.joined(found)


def draw_tiles(
    stages: Stages,
    state: State,
    done: Round,
    names: Collection[str] | None,
    stats: Statistics,
    on_share: Callable[[float], None] | None,
) -> tuple[dict[str, np.ndarray], View, float]:
    """Draw the whole picture of a round in tiles. Return its arrays, the view of the last tile, and the automatic exposure.

    names: of its buffers (None: all). stats: filled by the interruption and, for a frozen view, the pixels that no record
    reaches. on_share: called with the share of the tiles that are drawn. After Ctrl-C the other tiles get one sample a pixel. A
    second Ctrl-C ends the picture without a result.
    """
    settings, camera, cache = state.settings, done.camera, stages.scheduler.cache
    cache.mark_seen(reaching(cache, 0, camera, state.size, settings))
    requested = CHANNELS.keys() if names is None else CHANNELS.keys() & {*names, "image"}
    arrays = {name: np.empty((*state.size[::-1], *(3,) * (CHANNELS[name].components == 3)), "f4") for name in requested}
    width, height = (min(side, state.tile + 2 * MARGIN) for side in state.size)
    here, none_reach, view = replace(state, size=(width, height)), 0, None
    samples, stopped = 1 if stats["interrupted"] else settings.samples, False
    light = np.zeros(2)  # the sum of log₂ luminances, and the number of lit pixels
    tiles = list(_grid(state.size, (state.tile, state.tile)))
    for number, (left, bottom) in enumerate(tiles):
        x, y = (min(max(0, at - MARGIN), side - own) for at, side, own in zip((left, bottom), state.size, here.size, strict=True))
        seen = part_of(camera, Part(state.size, (x, y), here.size))
        try:
            view = _drawn(stages, here, seen, done, samples)
        except KeyboardInterrupt:
            if stopped:
                raise
            stopped, samples = True, 1
            view = _drawn(stages, here, seen, done, samples)
        wide, high = min(state.tile, state.size[0] - left), min(state.tile, state.size[1] - bottom)
        rows, columns = slice(state.size[1] - bottom - high, state.size[1] - bottom), slice(left, left + wide)
        mine = slice(y + height - bottom - high, y + height - bottom), slice(left - x, left - x + wide)
        for name, values in arrays.items():
            values[rows, columns] = BUFFERS[name](view)[mine]
        light += metered(arrays["image"][rows, columns], reflectance(view)[mine])
        if done.frozen and settings.most_bounces > 0:
            none_reach += uncovered(view, mine)
        if on_share is not None and not stopped:
            try:
                on_share((number + 1) / len(tiles))
            except KeyboardInterrupt:
                stopped, samples = True, 1
    assert view is not None
    if stopped:
        stats |= {"interrupted": True, "converged": False}
    if done.frozen:
        stats["uncovered"] = none_reach
    return arrays, view, automatic_exposure(float(light[0]), float(light[1]), unshadowed_luminance(state.scene))


def _drawn(stages: Stages, here: State, camera: Camera, done: Round, samples: int) -> View:
    """Return the picture of a part. Raises KeyboardInterrupt after Ctrl-C."""
    gbuffer, splats = _splatted(stages, here, camera)
    view = stages.draw_picture(here, replace(done, camera=camera, gbuffer=gbuffer, splats=splats))
    view = stages.accumulate(here, view, samples)
    if view.samples < samples:
        raise KeyboardInterrupt
    return view


def _splatted(stages: Stages, here: State, camera: Camera, stride: int = 1) -> tuple[GBuffer, SplatBuffer]:
    """Return the g-buffer and the sums of a part at every `stride`-th pixel. The cache does not mark the records as seen."""
    gbuffer = stages.draw_gbuffer(here, camera)
    return gbuffer, stages.splats(here).update(stages.scheduler.cache, gbuffer, camera, here.settings, stride, noted=False)


def _grid(size: Collection[int], step: tuple[int, int]) -> Iterator[tuple[int, int]]:
    """Yield the corners of squares of `step` that cover `size` (width, height), row by row."""
    width, height = size
    return ((x, y) for y in range(0, height, step[1]) for x in range(0, width, step[0]))
