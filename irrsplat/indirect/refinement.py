"""Progressive refinement of a covered view: each step lowers the error of the picture and estimates it.

Inter-record variance at a pixel shortens the reach of the records there, so that the pixel requests further records. If the rays
are too few for the target error, all records are gathered with four times as many. The picture of a step stays on show until the
next step is complete, or until the surface cache has another level. The next step uses the records of the error estimate
(error_estimate.py), too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, ShadowMaps, SplatBuffer
from irrsplat.core.timing.background import Steps, in_background
from irrsplat.core.timing.input_waits import InputWaits, input_waits
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import float_texture, pixels
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.indirect.error_estimate import GAIN, Check, ErrorSums, blur_of, drawn
from irrsplat.indirect.paper_scan import SMOOTH_OFF, read_back
from irrsplat.indirect.scheduler import RecordScheduler
from irrsplat.indirect.splat_buffer import ViewSplats
from irrsplat.indirect.view_state import Phase, ViewState
from irrsplat.scene.model import Camera
from irrsplat.settings import SETTINGS

_STILL = 1.3  # times the change of E by a finer level of the surface cache: its own error
_WORTH = 1.2  # times the error of the finest surface cache: an error that more records hardly reduce
_BETWEEN = 0.3  # of the squared target error: the surface cache's share, above which it is refined further
LAST = 40  # steps
_LEAVE = 0.8  # of the picture's error: pixels with less are not refined
_MOST = 6.0  # levels: at each √½ as much of the reach counts
_RAYS = 2.0  # of the squared target error: the greatest ray noise of a record, since several contribute to a pixel
_AIM = 3.0  # target of a step: the present error divided by this, unless the refinement ends before


class _Given(NamedTuple):
    """The arguments of the last `advance`. target: greatest relative error."""

    target: float
    gbuffer: GBuffer
    shadows: ShadowMaps
    budget: Budget


class Refiner(Owner):
    """Refinement of one view of `size` (width, height) at a time, from `begin` until `leave` removes the added records.

    splats: the sums of the displayed picture; None while no view is refined. error: its estimated relative RMSE; None until the
    first estimate. ended: True if the refinement is complete or cannot continue. broken: True after an exception.
    """

    def __init__(self, world: World, size: tuple[int, int], scheduler: RecordScheduler, timers: Timers) -> None:
        self.scheduler, self.cache, self.size = scheduler, scheduler.cache, size
        self.splats: SplatBuffer | None = None
        self.error: float | None = None
        self.ended = self.broken = False
        # of the displayed and of the next picture
        self._splats = [self.own(ViewSplats(world, size, timers)) for _ in range(2)]
        self._reach = [self.own(float_texture(world.ctx, size, 1)) for _ in range(2)]
        self._surface_error: tuple[int, float] | None = None  # of E in W/m², by the level of the surface cache
        self._steps: Iterator[None] = iter(())  # of the present view
        self._base: tuple[int, np.ndarray, int] = 0, np.zeros(0), 0  # of the cache before: records, limits, records compared

    def begin(self, splats: SplatBuffer, camera: Camera) -> None:
        """Refine a view that is covered by records whose sums are `splats`."""
        cache = self.cache
        self._base = cache.count, cache.limits(cache.count).copy(), self.scheduler.adaptation.compared
        self.splats, self.error, self.ended, self.broken = splats, None, False, False
        self._steps = self._refined(camera)

    def leave(self) -> None:
        """Remove the records of the refinement; all other records regain their reach, and keep their values."""
        if self.splats is not None:
            (count, limits, compared), self.splats, self._steps = self._base, None, iter(())
            self.cache.truncate(count)
            self.cache.set_limits(limits)
            self.cache.revision += 1
            self.scheduler.adaptation.accept(vars(self.scheduler.settings), compared)

    def advance(
        self, target: float, gbuffer: GBuffer, shadows: ShadowMaps, budget: Budget, on_pause: Callable[[], None] | None = None
    ) -> None:
        """Refine the view until its estimated relative error is at most `target`, or the budget is spent.

        on_pause: called after each part of a step.
        """
        self._given = _Given(target, gbuffer, shadows, budget)
        try:
            while not self.ended:
                enough = not self.scheduler.room or (self.error is not None and self.error <= target)
                self.ended = enough or next(self._steps, self) is self
                if on_pause is not None:
                    on_pause()
                if budget.left <= 0.0 or input_waits():
                    break
        except BaseException:  # the step's assumptions about the cache are void: the refinement restarts
            self.broken = True
            raise

    def _refined(self, camera: Camera) -> Steps[None]:
        """Refine a view in steps; pause after each part: some pixels tested, some records gathered more finely, some new ones."""
        scheduler, cache, gatherer = self.scheduler, self.cache, self.scheduler.gatherer
        levels, tested, doublings, index = np.zeros(self.size[::-1], "f4"), ErrorSums(), 0, 0
        gatherer.restore_surface(self._given.shadows, self._given.budget)  # else tests would lack its light
        surface, known = gatherer.surface_now, self._surface_error
        if surface is not None and known is not None and surface.refinements and surface.refinements == known[0]:
            surface_error = known[1]  # a view before has refined the surface cache
        else:
            surface_error = yield from self._light(camera, 0.0)
        for step in range(LAST + 1):
            check = yield from self._test(camera, step, doublings)
            if check is None:
                return
            tested = tested.including(check)
            off = math.hypot(math.sqrt(check.mean_uncertainty * tested.ratio), surface_error)
            aim = max(self._given.target * check.mean, off / _AIM)
            finer = self._side(doublings + 1) > self._side(doublings)
            if finer and check.mean_uncertainty * tested.ray_ratio > _RAYS * aim**2:
                tested, doublings = tested._replace(rays=tested.rays / GAIN), doublings + 1
            self.error = off / check.mean if check.mean > 0.0 else 0.0
            surface = gatherer.surface_now
            # the finest surface cache may be off by more than the target; then records need not be much better
            if surface is not None and not surface.may_refine and off < _WORTH * surface_error:
                return
            yield
            if step == LAST:
                return
            if surface_error**2 > _BETWEEN * aim**2:
                surface_error = yield from self._light(camera, surface_error, self._reach[index] if step else None, index)

            choosing, index = in_background(partial(_finer_by, check.uncertainty)), 1 - index
            yield
            while (more := self._given.budget.advance(choosing)) is None:
                yield
            levels = np.minimum(levels + more, _MOST).astype("f4")
            # the share of the records' reach that counts
            self._reach[index].write(np.exp2(-0.5 * levels).astype("f4")[::-1].tobytes())
            self._splats[index].forget()
            side, sizes = self._side(doublings), cache.column("gather_size")
            coarse = np.where(sizes > 0, sizes, self._side(0)) < side
            left = np.flatnonzero(coarse & (scheduler.pixels_covered(self._given.gbuffer, camera) > 0.0))
            yield
            while len(left):
                left = left[gatherer.regather(self._given.shadows, left, self._given.budget, side) :]
                yield
            if not (yield from self._fill(camera, index, side)):
                return

    def _side(self, doublings: int) -> int:
        """Return the side of a gather after so many doublings of the settings' side."""
        least = self.scheduler.settings.gather_size
        return int(min(least * 2**doublings, SETTINGS["gather_size"].high or least))

    def _splatted(self, camera: Camera, index: int, reach: moderngl.Texture | None) -> Steps[SplatBuffer]:
        """Return the sums of all records in one of the two buffers; pause while input waits."""
        while True:
            try:
                return self._splats[index].update(self.cache, self._given.gbuffer, camera, self.scheduler.settings, 1, reach)
            except InputWaits:
                yield

    def _light(self, camera: Camera, known: float, reach: moderngl.Texture | None = None, index: int = 0) -> Steps[float]:
        """Refine the surface cache, gather the records again by it, and return the estimated remaining error of E, W/m².

        known: its present error. reach, index: of the picture on show.
        """
        gatherer, cache = self.scheduler.gatherer, self.cache
        surface = gatherer.surface_now
        if surface is None or not surface.may_refine:
            yield
            return known
        while not surface.refine(self._given.shadows, self._given.budget):
            yield
        yield
        before, sizes = cache.values[:, :3], cache.column("gather_size").copy()
        for side in np.unique(sizes).tolist():
            left = np.flatnonzero(sizes == side)
            while len(left):
                left = left[gatherer.regather(self._given.shadows, left, self._given.budget, side) :]
                yield
        changes = cache.values[:, :3].astype(float) - before  # along equal rays: of the light alone
        pixels_covered = self.scheduler.pixels_covered(self._given.gbuffer, camera)[:, None]
        weights = pixels_covered / max(float(pixels_covered.sum()), 1e-20)
        error = _STILL * float(np.sqrt((weights * changes**2).sum(0).mean()))
        self._surface_error = surface.refinements, error
        self.scheduler.limit_radii(ViewState(phase=Phase.FILL))  # the last test's records are new
        self.splats = yield from self._splatted(camera, index, reach)
        yield
        return error

    def _test(self, camera: Camera, step: int, doublings: int) -> Steps[Check | None]:
        """Gather at random pixels, as finely as the records of the picture, and some more finely. Return None without pixels."""
        gatherer, cache = self.scheduler.gatherer, self.cache
        seen = read_back(self._given.gbuffer)
        assert self.splats is not None
        if not seen.mask.any():  # as for a view past the scene
            self.error = 0.0
            return None
        seed, off = (self.scheduler.settings.seed, step), SMOOTH_OFF * gatherer.world.scene.diagonal
        sums, weight = pixels(self.splats.sums), pixels(self.splats.weight)
        drawing = in_background(partial(drawn, seen, sums, weight, seed, off))  # a large view takes long
        yield
        while (check := self._given.budget.advance(drawing)) is None:
            yield
        first, done, side = cache.count, 0, self._side(doublings)
        sites = replace(check.sites, screen=camera.measure_at(check.sites.position, self.size))
        yield
        while done < len(sites):
            done += gatherer.gather(self._given.shadows, sites[done:], self._given.budget, side)
            yield
        coarse, done = cache.values[first:, :3].astype(float), 0
        again, side = check.again, self._side(doublings + 1)
        while done < len(again):
            done += gatherer.regather(self._given.shadows, first + again[done:], self._given.budget, side)
            yield
        return replace(check, coarse=coarse, fine=cache.values[first + again, :3])

    def _fill(self, camera: Camera, index: int, side: int) -> Steps[bool]:
        """Make records where the next step lacks some, and show its picture. Return False at the limit of records."""
        fill, settings = ViewState(), self.scheduler.settings
        while True:
            fill, _ = self.scheduler.limit_radii(fill)
            splats = yield from self._splatted(camera, index, self._reach[index])
            of = splats, settings.request_criteria
            if not fill.ended(of):
                screen = self.scheduler.screen(self._given.gbuffer, splats, camera)
                fill, *_ = self.scheduler.gather_missing(fill, screen, self._given.shadows, self._given.budget, side)
            if fill.ended(of):
                self.splats = splats
                yield
                return True
            if fill.full:
                return False
            yield


def _finer_by(uncertainty: np.ndarray) -> np.ndarray:
    """Return (H, W) the levels to add for the next step, by the variance (H, W) at all pixels."""
    from scipy import ndimage

    limit = _LEAVE**2 * float(uncertainty[uncertainty > 0.0].mean())  # the variance's relation to the error's square cancels out
    # the error is about proportional to the square of the reach, so that a level halves the error
    more = np.maximum(0.5 * np.log2(np.maximum(uncertainty, 1e-30) / limit), 0.0)
    around = round(blur_of(len(uncertainty)))
    return np.asarray(ndimage.gaussian_filter(ndimage.maximum_filter(more, 2 * around + 1), around))
