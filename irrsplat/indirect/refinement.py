"""Progressive refinement of a covered view: each step lowers the error of the picture and estimates it.

Inter-record variance at a pixel shortens the reach of the records there, so that the pixel requests further records. If the rays
are too few for the target error, all records are gathered with four times as many. The picture of a step stays on show until the
next step is complete, or until the surface cache has another level. The next step uses the records of the error estimate
(error_estimate.py), too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from irrsplat.core.buffers import GBuffer, ShadowMaps, SplatBuffer
from irrsplat.core.timing.background import Steps, in_background
from irrsplat.core.timing.input_waits import InputWaits
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import float_texture
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.indirect.error_estimate import Check, ErrorSums, blur_of, drawing
from irrsplat.indirect.paper_scan import SMOOTH_OFF, read_back
from irrsplat.indirect.scheduler import RecordScheduler
from irrsplat.indirect.splat_buffer import ViewSplats
from irrsplat.indirect.view_state import Phase, ViewState
from irrsplat.scene.model import Camera

_STILL = 1.3  # times the change of E by a finer level of the surface cache: its own error
_WORTH = 1.2  # times the error of the finest surface cache: an error that more records hardly reduce
_BETWEEN = 0.3  # of the squared target error: the surface cache's share, above which it is refined further
LAST = 40  # steps
_LEAVE = 0.8  # of the picture's error: pixels with less are not refined
_MOST = 6.0  # levels: at each √½ as much of the reach counts
_STEP = 2.0  # levels at once
_FINEST = 256  # side of the finest gather
_RAYS = 2.0  # of the squared target error: the greatest ray noise of a record, since several contribute to a pixel
_AIM = 3.0  # target of a step: the present error divided by this, unless the refinement ends before


@dataclass(frozen=True, eq=False)
class Levels:
    """The refinement level of each pixel. values: (H, W) level, top row first. camera: of the view."""

    values: np.ndarray
    camera: Camera

    @property
    def reach(self) -> np.ndarray:
        """(H, W) float32 the share of the records' reach that counts."""
        share: np.ndarray = np.exp2(-0.5 * self.values).astype("f4")
        return share


@dataclass(frozen=True, eq=False)
class Base:
    """The state that the cache returns to after progressive refinement: the number of records, and their limits.

    compared: the number of records by which all others are limited.
    """

    count: int
    limits: np.ndarray
    compared: int


@dataclass(frozen=True, eq=False)
class Refinement:
    """The progress of a view's refinement: one value, replaced whole.

    step, splats, levels: of the picture on show. error: its relative RMSE, None until it is known; last_error: the last known
    one. lit: True if the surface cache is fine enough for the step. changes: (K, 3) W/m², changes of E of the first K records
    by its last level, None without a new level. surface_error: W/m², estimated remaining error of E by the surface cache.
    tested: sums of all tests. doublings: of the sides of gathers for the next step.

    The next step has the following fields. drawing: the choice of the pixels under test. check: the pixels under test.
    uncertainty: (H, W) W²/m⁴. choosing: the choice of levels. next_levels: None before they are chosen. finer: numbers of old
    records that still need more rays. fill: its progress as a view. ended: True if nothing more is or can be refined.
    """

    base: Base
    splats: SplatBuffer
    levels: Levels
    step: int = 0
    error: float | None = None
    last_error: float | None = None
    doublings: int = 0
    lit: bool = False
    changes: np.ndarray | None = None
    surface_error: float = 0.0
    tested: ErrorSums = ErrorSums()
    drawing: Steps[Check] | None = None
    check: Check | None = None
    uncertainty: np.ndarray | None = None
    choosing: Steps[np.ndarray] | None = None
    next_levels: Levels | None = None
    finer: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))
    fill: ViewState = ViewState()
    ended: bool = False
    broken: bool = False


class Refiner(Owner):
    """Refinement of one view of `size` (width, height) at a time, from `begin` until `leave` removes the added records.

    state: the progress; None while no view is refined.
    """

    def __init__(self, world: World, size: tuple[int, int], gradients: bool, scheduler: RecordScheduler, timers: Timers) -> None:
        self.scheduler, self.cache, self.size = scheduler, scheduler.cache, size
        # of the picture on show, and of the next one
        self._splats = [ViewSplats(world, size, gradients, timers) for _ in range(2)]
        self._reach = [float_texture(world.ctx, size, 1) for _ in range(2)]
        self._surface_error: tuple[int, float] | None = None  # by the level of the surface cache
        self.state: Refinement | None = None

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (*self._splats, *self._reach)

    def begin(self, splats: SplatBuffer, camera: Camera) -> None:
        """Refine a view that is covered by records whose sums are `splats`."""
        cache = self.cache
        base = Base(cache.count, cache.limits(cache.count).copy(), self.scheduler.adaptation.compared)
        self.state = Refinement(base, splats, Levels(np.zeros(self.size[::-1], "f4"), camera))
        surface, known = self.scheduler.gatherer.surface_now, self._surface_error
        if surface is not None and known is not None and surface.refinements and surface.refinements == known[0]:
            self.state = replace(self.state, lit=True, surface_error=known[1])  # a view before has refined the surface cache

    def leave(self) -> None:
        """Remove the records of the refinement; the others reach as far as before, and keep their present values."""
        if self.state is not None:
            base, self.state = self.state.base, None
            self.cache.truncate(base.count)
            self.cache.restore_limits(base.limits)
            self.scheduler.adaptation.accept(vars(self.scheduler.settings), base.compared)

    def advance(self, target: float, gbuffer: GBuffer, shadows: ShadowMaps, budget: Budget) -> None:
        """Refine the view until its estimated relative error is at most `target`, or the budget is spent."""
        assert self.state is not None
        try:
            while not self.state.ended:
                self.state = self._part(self.state, target, gbuffer, shadows, budget)
                if budget.left <= 0.0:
                    break
        except InputWaits:  # before any record was made: the next tick takes the same step
            raise
        except BaseException:  # the step's assumptions about the cache no longer hold: the refinement restarts
            self.state = replace(self.state, broken=True, check=None)
            raise

    def _part(self, state: Refinement, target: float, gbuffer: GBuffer, shadows: ShadowMaps, budget: Budget) -> Refinement:
        """Do a part of a step: test some pixels, gather some records more finely, or make some new ones."""
        if not self.scheduler.room or (state.error is not None and (state.error <= target or state.step >= LAST)):
            return replace(state, ended=True)
        if not state.lit:
            return self._light(state, gbuffer, shadows, budget)
        if state.error is None or state.uncertainty is None:
            return self._test(state, target, gbuffer, shadows, budget)
        if state.next_levels is None:
            return self._choose(state, gbuffer, budget)
        if len(state.finer):
            return self._regather_finer(state, shadows, budget)
        return self._fill(state, gbuffer, shadows, budget)

    def _side(self, doublings: int) -> int:
        """Return the side of a gather after so many doublings of the settings' side."""
        least = self.scheduler.settings.gather_size
        return int(min(least * 2**doublings, max(_FINEST, least)))

    def _light(self, state: Refinement, gbuffer: GBuffer, shadows: ShadowMaps, budget: Budget) -> Refinement:
        """Refine the surface cache, correct the records by it, and estimate its remaining error."""
        gatherer, cache, camera = self.scheduler.gatherer, self.cache, state.levels.camera
        surface = gatherer.surface_now
        if surface is None or (state.changes is None and not surface.may_refine):
            return replace(state, lit=True)
        if state.changes is None:
            done = gatherer.refine_surface(shadows, budget)
            return replace(state, changes=np.zeros((0, 3))) if done else state
        if len(state.changes) < cache.count:
            more = gatherer.correct_by_refinement(shadows, np.arange(len(state.changes), cache.count), budget)
            return replace(state, changes=np.concatenate([state.changes, more]))
        pixels_covered = self.scheduler.pixels_covered(gbuffer, camera)[:, None]
        weights = pixels_covered / max(float(pixels_covered.sum()), 1e-20)
        surface_error = _STILL * float(np.sqrt((weights * state.changes**2).sum(0).mean()))
        self._surface_error, index = (surface.refinements, surface_error), state.step % 2
        self.scheduler.limit_radii(replace(state.fill, phase=Phase.FILL))  # the last test's records are new
        splats = self._splats[index].update(
            cache, gbuffer, camera, self.scheduler.settings, 1, self._reach[index] if state.step else None
        )
        return replace(state, splats=splats, lit=True, surface_error=surface_error, changes=None)

    def _test(self, state: Refinement, target: float, gbuffer: GBuffer, shadows: ShadowMaps, budget: Budget) -> Refinement:
        """Gather at pixels drawn at random, as finely as the records of the picture, and some more finely, and compare."""
        check, gatherer, cache = state.check, self.scheduler.gatherer, self.cache
        if check is None and state.drawing is None:
            seed, off = (self.scheduler.settings.seed, state.step), SMOOTH_OFF * gatherer.world.scene.diagonal
            seen = read_back(gbuffer)
            if not seen.mask.any():  # such as a view past the scene
                return replace(state, error=0.0, last_error=0.0, ended=True)
            return replace(state, drawing=drawing(seen, state.splats, seed, off))
        if check is None:
            assert state.drawing is not None
            found = budget.advance(state.drawing)
            return state if found is None else replace(state, drawing=None, check=replace(found, first=cache.count))
        done, again = check.done, check.again
        if check.coarse is None:
            done += gatherer.gather(shadows, check.sites[done:], budget, self._side(state.doublings))
            if done == len(check.sites):
                coarse = cache.values[check.first : check.first + done, :3].astype(float)
                return replace(state, check=replace(check, done=0, coarse=coarse))
            return replace(state, check=replace(check, done=done))
        if done < len(again):
            done += gatherer.regather(shadows, check.first + again[done:], budget, self._side(state.doublings + 1))
            return replace(state, check=replace(check, done=done))
        tested, doublings = state.tested.including(check, cache.values[check.first + again, :3]), state.doublings
        off = math.hypot(math.sqrt(check.mean_uncertainty * tested.ratio), state.surface_error)
        aim = max(target * check.mean, off / _AIM)
        if check.mean_uncertainty * tested.ray_ratio > _RAYS * aim**2 and self._side(doublings + 1) > self._side(doublings):
            tested, doublings = tested.doubled(), doublings + 1
        error = off / check.mean if check.mean > 0.0 else 0.0
        lit = state.surface_error**2 <= _BETWEEN * aim**2
        surface = gatherer.surface_now
        # the finest surface cache may be off by more than the target; then records need not be much better
        ended = surface is not None and not surface.may_refine and off < _WORTH * state.surface_error
        state = replace(
            state, check=None, uncertainty=check.uncertainty, tested=tested, doublings=doublings, lit=lit, ended=ended
        )
        return replace(state, error=error, last_error=error)

    def _choose(self, state: Refinement, gbuffer: GBuffer, budget: Budget) -> Refinement:
        """Choose the levels of the next step, and the records that need more rays for it."""
        if state.choosing is None:
            assert state.uncertainty is not None
            return replace(state, choosing=in_background(partial(_finer_by, state.uncertainty)))
        if (more := budget.advance(state.choosing)) is None:
            return state
        levels = Levels(np.minimum(state.levels.values + more, _MOST).astype("f4"), state.levels.camera)
        index = (state.step + 1) % 2
        self._reach[index].write(levels.reach[::-1].tobytes())
        self._splats[index].forget()
        side, sizes = self._side(state.doublings), self.cache.column("gather_size")
        known = np.where(sizes > 0, sizes, self._side(0))
        pixels_covered = self.scheduler.pixels_covered(gbuffer, levels.camera)
        return replace(state, choosing=None, next_levels=levels, finer=np.flatnonzero((known < side) & (pixels_covered > 0.0)))

    def _regather_finer(self, state: Refinement, shadows: ShadowMaps, budget: Budget) -> Refinement:
        """Gather records again that need more rays."""
        done = self.scheduler.gatherer.regather(shadows, state.finer, budget, self._side(state.doublings))
        return replace(state, finer=state.finer[done:])

    def _fill(self, state: Refinement, gbuffer: GBuffer, shadows: ShadowMaps, budget: Budget) -> Refinement:
        """Make records where the next step lacks some; once it lacks none its picture takes the place of the other."""
        levels, settings, index = state.next_levels, self.scheduler.settings, (state.step + 1) % 2
        assert levels is not None
        fill, _ = self.scheduler.limit_radii(state.fill)
        splats = self._splats[index].update(self.cache, gbuffer, levels.camera, settings, 1, self._reach[index])
        of = splats, settings.request_criteria
        if not fill.ended(of):
            side = self._side(state.doublings)
            screen = self.scheduler.screen(gbuffer, splats, levels.camera)
            fill, _ = self.scheduler.gather_missing(fill, screen, shadows, levels.camera, budget, side)
            if not fill.ended(of):
                return replace(state, fill=fill, ended=fill.full)
        known = replace(state, error=None, check=None, uncertainty=None, next_levels=None, fill=ViewState())
        return replace(known, splats=splats, levels=levels, step=state.step + 1)


def _finer_by(uncertainty: np.ndarray) -> np.ndarray:
    """Return (H, W) the levels to add for the next step, by the variance (H, W) at all pixels."""
    from scipy import ndimage

    limit = _LEAVE**2 * float(uncertainty[uncertainty > 0.0].mean())  # the variance's relation to the error's square cancels out
    # an error is about in proportion to the square of the reach, so that it takes a level to halve it
    more = np.clip(0.5 * np.log2(np.maximum(uncertainty, 1e-30) / limit), 0.0, _STEP)
    around = round(blur_of(len(uncertainty)))
    finer: np.ndarray = ndimage.gaussian_filter(ndimage.maximum_filter(more, 2 * around + 1), around)
    return finer
