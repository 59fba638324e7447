"""Pictures in tiles: a large picture is examined and drawn a part at a time, so that only its arrays have its size.

Records are asked for by the whole picture, in the same rounds as in one piece: in each, every tile is drawn and examined, and
what the tiles find is put together before sites are chosen. Then every tile is drawn by the same records.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from irrsplat.core.buffers import CHANNELS, ShadowMaps
from irrsplat.gather.spot_check import Spots
from irrsplat.gpu.time_budget import Budget
from irrsplat.image.tonemap import automatic_exposure, metered
from irrsplat.image.view import Progress, View, reflectance, uncovered, values_of
from irrsplat.indirect.examine import Examination, Screen, tile_count, tile_side
from irrsplat.indirect.scheduler import NOTHING_ASKED, RecordScheduler
from irrsplat.indirect.view_state import ViewState
from irrsplat.records.culling import reaching
from irrsplat.renderer.rounds import Rounds
from irrsplat.renderer.stages import Stages
from irrsplat.renderer.state import Round, State
from irrsplat.scene.model import Camera, Part, part_of
from irrsplat.settings import Settings

_MARGIN = 2  # pixels about a tile that its picture looks at

Size = tuple[int, int]


@dataclass(frozen=True)
class _Looked:
    """What the examination of a tile has found, by so many records."""

    count: int
    found: Examination


@dataclass(frozen=True)
class TiledRound:
    """What a round leaves: how far the view has come."""

    progress: Progress


class Tiles:
    """The rounds and the pictures of views that are drawn in tiles."""

    def __init__(self, stages: Stages, rounds: Rounds, scheduler: RecordScheduler) -> None:
        self.stages, self.rounds, self.scheduler, self.cache = stages, rounds, scheduler, scheduler.cache
        self._looked: dict[tuple[int, int], _Looked] = {}  # by the tile
        self._looked_by: object = None  # all else that it depends on

    # ---- rounds ----------------------------------------------------------------------------------------------------

    def __call__(self, state: State, camera: Camera, gather: bool = True) -> tuple[State, TiledRound]:
        """A round of a view, as Rounds has it, with all the time that it takes. gather: False leaves the cache as it is."""
        scheduler, settings, budget = self.scheduler, state.settings, Budget(None)
        shadows = self._followed(state)
        view = self.rounds.view_state(state, camera)
        bounces = settings.most_bounces > 0
        ready = gather and bounces and scheduler.prepare(shadows, budget)
        renewed = scheduler.gatherer.renew(shadows, self.cache.stale, budget) if ready else 0
        if renewed or len(self.cache.stale):
            view = replace(view, stalled_rounds=0)
        view, _ = scheduler.limit_radii(view)
        if view.stalled and view.pixel_stride > 1:
            view = replace(view, pixel_stride=1, stalled_rounds=0)
        screen, requests = self.screen(state, camera, view.pixel_stride), NOTHING_ASKED
        if not bounces:
            view = replace(view, coverage=1.0)
        elif not ready:
            view = replace(view, coverage=1.0 - screen.examine(settings).missing)
        elif not view.stalled and view.settled != (screen.sums, settings.asking):
            view, requests = scheduler.gather_asked(view, screen, shadows, camera, budget)
        done = Progress(
            view.rounds,
            self.cache.count,
            requests.new,
            view.coverage,
            renewed,
            self.cache.waiting if bounces else 0,
            requests.complete,
            scheduler.gatherer.surface_share if bounces else 1.0,
            view.full,
        )
        return replace(state, view=view), TiledRound(done)

    def frozen(self, state: State, camera: Camera) -> TiledRound:
        """How far a view is covered by the records that there are; none is gathered or changed."""
        self._followed(state)
        self.scheduler.limit_radii(ViewState(), last=True)
        missing = self.screen(state, camera, 1).examine(state.settings).missing if state.settings.most_bounces > 0 else 0.0
        return TiledRound(Progress(0, self.cache.count, 0, 1.0 - missing))

    def _followed(self, state: State) -> ShadowMaps:
        """The shadow maps of the scene as it is, once the scheduler knows it."""
        scheduler = self.scheduler
        scheduler.follow(state.settings, scheduler.change_to(state.scene), self.stages.shadows(state))
        return self.stages.draw_shadows(state)

    # ---- the examination -------------------------------------------------------------------------------------------

    def screen(self, state: State, camera: Camera, pixel_stride: int) -> Screen:
        """The view as the scheduler looks at it, of which every `pixel_stride`-th pixel is splatted."""
        sums = camera, state.view_subject, pixel_stride, self.cache.revision, self.cache.count
        return Screen(
            state.size,
            pixel_stride,
            sums,
            lambda settings: self._examine(state, camera, pixel_stride, settings),
            lambda: self._spots(state, camera),
        )

    def _examine(self, state: State, camera: Camera, stride: int, settings: Settings) -> Examination:
        """What the examination finds in all tiles. A tile that no new record reaches is as it was."""
        inputs = camera, state.view_subject, state.tile, stride, settings, self.cache.revision
        if self._looked_by != inputs:
            self._looked, self._looked_by = {}, None
        cells = tile_count(state.size, stride)
        step = tile_side(state.size, stride) * stride  # pixels, of a tile of the examination
        across, up = (min(max(1, state.tile // step), n) for n in cells)
        whole: Examination | None = None
        for column, row in _grid(cells, (across, up)):
            part = Part(state.size, (column * step, row * step), (across * step, up * step))
            found = self._look(state, part_of(camera, part), part, stride, settings, (column, row))
            whole = whole or _empty(found, (cells[1], cells[0]))
            wide, high = min(across, cells[0] - column), min(up, cells[1] - row)
            for name, values in vars(whole).items():
                # rows run down
                there = getattr(found, name)[::-1][:high, :wide]
                values[::-1][row : row + high, column : column + wide] = there
        self._looked_by = inputs
        assert whole is not None
        return whole

    def _look(
        self, state: State, camera: Camera, part: Part, stride: int, settings: Settings, tile: tuple[int, int]
    ) -> Examination:
        """What the examination finds in a part."""
        before, cache = self._looked.get(tile), self.cache
        count = cache.count if settings.most_bounces > 0 else 0
        if before is not None and not len(reaching(cache, before.count, camera, part.size, settings)):
            found = before.found
        else:
            here = replace(state, size=part.size)
            gbuffer = self.stages.draw_gbuffer(here, camera)
            splats = self.stages.splats(here).update(cache, gbuffer, camera, settings, stride, noted=False)
            found = self.scheduler.examined(gbuffer, splats, settings, part)
        self._looked[tile] = _Looked(count, found)
        return found

    def _spots(self, state: State, camera: Camera) -> Spots:
        """The places of all tiles for a spot check."""
        found: list[Spots] = []
        here = replace(state, size=(state.tile, state.tile))
        for corner in _grid(state.size, here.size):
            seen = part_of(camera, Part(state.size, corner, here.size))
            gbuffer = self.stages.draw_gbuffer(here, seen)
            splats = self.stages.splats(here).update(self.cache, gbuffer, seen, state.settings, 1, noted=False)
            found.append(self.scheduler.spots(gbuffer, splats, seen))
        return Spots.joined(found)

    # ---- the picture -----------------------------------------------------------------------------------------------

    def draw(
        self,
        state: State,
        camera: Camera,
        done: Progress,
        names: Collection[str] | None,
        frozen: bool,
        samples: int,
        on_share: Callable[[float], None] | None,
    ) -> tuple[dict[str, np.ndarray], View, float, int, bool]:
        """The image, and the buffers of these names (None: all), of the whole picture by the records that there are; the last
        tile's view; its automatic exposure in stops; how many pixels no record reaches (where `frozen`); and whether Ctrl-C came.

        done: how far the view has come. samples: of a pixel. on_share: called with the share of the tiles that are drawn. After
        Ctrl-C the tiles that are left get one sample a pixel; a second one ends it without a picture.
        """
        settings, shadows = state.settings, self._followed(state)
        self.cache.mark_seen(reaching(self.cache, 0, camera, state.size, settings))
        wanted = CHANNELS.keys() if names is None else CHANNELS.keys() & {*names, "image"}
        arrays: dict[str, np.ndarray] = {}
        size = tuple(min(side, state.tile + 2 * _MARGIN) for side in state.size)
        here, none_reach, view, stopped = replace(state, size=(size[0], size[1])), 0, None, False
        light = np.zeros(2)  # the sum of log₂ luminances, and how many pixels are lit
        tiles = list(_grid(state.size, (state.tile, state.tile)))
        for number, (left, bottom) in enumerate(tiles):
            x, y = (min(max(0, at - _MARGIN), side - own) for at, side, own in zip((left, bottom), state.size, size, strict=True))
            seen = part_of(camera, Part(state.size, (x, y), here.size))
            try:
                view = self._drawn(here, seen, shadows, done, frozen, samples)
            except KeyboardInterrupt:
                if stopped:
                    raise
                stopped, samples = True, 1
                view = self._drawn(here, seen, shadows, done, frozen, samples)
            wide, high = min(state.tile, state.size[0] - left), min(state.tile, state.size[1] - bottom)
            rows = slice(state.size[1] - bottom - high, state.size[1] - bottom)
            mine = slice(y + size[1] - bottom - high, y + size[1] - bottom), slice(left - x, left - x + wide)
            self._keep(view, wanted, arrays, state.size, (rows, slice(left, left + wide)), mine)
            light += metered(arrays["image"][rows, left : left + wide], reflectance(view)[mine])
            if frozen and settings.most_bounces > 0:
                none_reach += uncovered(view, mine)
            if on_share is not None and not stopped:
                try:
                    on_share((number + 1) / len(tiles))
                except KeyboardInterrupt:
                    stopped, samples = True, 1
        assert view is not None
        return arrays, view, automatic_exposure(*light.tolist()), none_reach, stopped

    def _drawn(self, here: State, camera: Camera, shadows: ShadowMaps, done: Progress, frozen: bool, samples: int) -> View:
        """The picture of a part."""
        gbuffer = self.stages.draw_gbuffer(here, camera)
        splats = self.stages.splats(here).update(self.cache, gbuffer, camera, here.settings, 1, noted=False)
        view = self.stages.draw_picture(here, Round(camera, shadows, gbuffer, splats, done, frozen=frozen))
        if samples > 1:
            view = self.stages.accumulate(here, view, samples, Budget(None), None)
            if view.samples < samples:
                raise KeyboardInterrupt
        return view

    @staticmethod
    def _keep(view: View, names: Collection[str], arrays: dict[str, np.ndarray], size: Size, there: Any, mine: Any) -> None:
        """Copy what is `mine` of a part's buffers to where it belongs in the whole picture's."""
        for name in names:
            values = values_of(view, name)
            if name not in arrays:
                arrays[name] = np.empty((size[1], size[0], *values.shape[2:]), "f4")
            arrays[name][there] = values[mine]


def _grid(size: Collection[int], step: Size) -> Iterator[tuple[int, int]]:
    """Where squares of `step` begin that cover `size` (width, height), row by row."""
    width, height = size
    return ((x, y) for y in range(0, height, step[1]) for x in range(0, width, step[0]))


def _empty(like: Examination, shape: Size) -> Examination:
    """An examination of so many rows and columns, to be filled."""
    return Examination(**{name: np.zeros((*shape, *values.shape[2:]), values.dtype) for name, values in vars(like).items()})
