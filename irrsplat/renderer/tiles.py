"""Pictures in tiles: a large picture is examined and drawn a part at a time, so that only its arrays have its size.

The whole picture requests records, in the rounds of a picture in one piece. Each round draws and examines every tile, and joins
the examinations before it chooses sites. Then every tile is drawn by the records of the whole picture.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from irrsplat.core.buffers import CHANNELS, GBuffer, SplatBuffer
from irrsplat.core.memo import Memo
from irrsplat.gather.spot_check import MARGIN, Spots
from irrsplat.image.statistics import Statistics
from irrsplat.image.tonemap import automatic_exposure, metered
from irrsplat.image.view import BUFFERS, View, reflectance, uncovered
from irrsplat.indirect.examine import Examination, Screen, tile_count, tile_side
from irrsplat.lighting.light_table import unshadowed_luminance
from irrsplat.records.culling import reaching
from irrsplat.renderer.stages import Stages
from irrsplat.renderer.state import Round, State
from irrsplat.scene.model import Camera, Part, part_of
from irrsplat.settings import Settings


class TileScreens:
    """The examination of views that are drawn in tiles. A tile that no new record reaches is not examined again."""

    def __init__(self, stages: Stages) -> None:
        self.stages, self.scheduler, self.cache = stages, stages.scheduler, stages.scheduler.cache
        self._memo = Memo()

    def __call__(self, state: State, camera: Camera, pixel_stride: int) -> Screen:
        """Return the view for the examination, with splats at every `pixel_stride`-th pixel."""
        sums = camera, state.view_subject, pixel_stride, self.cache.revision, self.cache.count
        examine, spots = partial(self._examine, state, camera, pixel_stride), partial(self._spots, state, camera)
        return Screen(camera, state.size, pixel_stride, sums, examine, spots)

    def _examine(self, state: State, camera: Camera, stride: int, settings: Settings) -> Examination:
        """Return the examination of all tiles. A tile that no new record reaches keeps its last result."""
        cache, count = self.cache, self.cache.count if settings.most_bounces > 0 else 0
        inputs = camera, state.view_subject, state.tile, stride, settings, cache.revision
        held: dict[Part, tuple[int, Examination]] = self._memo.get("examined", inputs, dict)  # with the number of its records
        cells = tile_count(state.size, stride)
        step = tile_side(state.size, stride) * stride  # pixels, of a tile of the examination
        across, up = (min(max(1, state.tile // step), n) for n in cells)
        whole: dict[str, np.ndarray] = {}
        for column, row in _grid(cells, (across, up)):
            part = Part(state.size, (column * step, row * step), (across * step, up * step))
            seen, (before, found) = part_of(camera, part), held.get(part, (0, None))
            if found is None or len(reaching(cache, before, seen, part.size, settings)):
                here = replace(state, size=part.size)
                found = self.scheduler.examined(*_splatted(self.stages, here, seen, stride), settings, part)
            held[part] = count, found
            for name, values in vars(found).items():
                whole_of = whole.setdefault(name, np.zeros((*cells[::-1], *values.shape[2:]), values.dtype))
                there = whole_of[::-1][row : row + up, column : column + across]  # rows run down
                there[:] = values[::-1][: there.shape[0], : there.shape[1]]
        return Examination(**whole)

    def _spots(self, state: State, camera: Camera) -> Spots:
        """Return the places of all tiles for a spot check."""
        found: list[Spots] = []
        here = replace(state, size=(state.tile + 2 * MARGIN, state.tile + 2 * MARGIN))
        for x, y in _grid(state.size, (state.tile, state.tile)):
            seen = part_of(camera, Part(state.size, (x - MARGIN, y - MARGIN), here.size))
            found.append(self.scheduler.spots(*_splatted(self.stages, here, seen), seen, MARGIN))
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
