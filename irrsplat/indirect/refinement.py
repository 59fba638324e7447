"""Refinement of a view that is covered and rests: step by step its picture converges, and it is told how far off it is.

Where records contradict each other at a pixel, less of their reach counts there, so that further ones are asked for, and those
look along more rays. The picture of a step stays until the next one is complete. Its error is measured, not modelled: at pixels
drawn at random, more of them where records contradict each other, a fine gather tells what is true; those records serve the next
step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, ShadowMaps, Sites, SplatBuffer
from irrsplat.core.color import LUMINANCE
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import float_texture, pixels
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.indirect.paper_scan import Seen, read_back
from irrsplat.indirect.scheduler import Fineness, RecordScheduler
from irrsplat.indirect.splat_buffer import ViewSplats
from irrsplat.indirect.view_state import ViewState
from irrsplat.records.adaptive_radius import AdaptiveRadiusState
from irrsplat.scene.model import Camera

LAST = 40  # steps
CHECKS = 128  # pixels that tell how far off a picture is
_KEPT = 0.5  # of what earlier steps' pixels told counts on
_FAIR = 0.35  # share of the pixels' probability that is the same for all
_LEAVE = 0.8  # of the picture's error: where it is less, nothing is refined
_MOST = 6.0  # levels: at each √½ as much of the reach counts; at every fourth, records look along four times as many rays
_FINER = 4.0  # levels: how much more finely a pixel is tested than records there look
_STEP = 2.0  # levels at once
_FINEST = 256  # side of the finest gather
_BLUR = 0.005  # of the image's height: over how far contradictions are averaged


@dataclass(frozen=True, eq=False)
class Levels:
    """How far each pixel is refined. values: (H, W) level, top row first. camera: of the view."""

    values: np.ndarray
    camera: Camera

    @property
    def reach(self) -> np.ndarray:
        """(H, W) float32 the share of the records' reach that counts."""
        share: np.ndarray = np.exp2(-0.5 * self.values).astype("f4")
        return share

    def at(self, positions: np.ndarray) -> np.ndarray:
        """(N,) the levels where the camera sees `positions` (N, 3), or would; 0 beyond the image."""
        height, width = self.values.shape
        matrix = self.camera.clip_from_view(width / height, 1e-3, 1e3) @ self.camera.view_from_world
        clip = np.column_stack([positions, np.ones(len(positions))]) @ np.asarray(matrix, float).T
        w = np.where(clip[:, 3] > 0.0, clip[:, 3], np.inf)
        column = np.floor((clip[:, 0] / w * 0.5 + 0.5) * width)
        row = np.floor((0.5 - clip[:, 1] / w * 0.5) * height)
        inside = (clip[:, 3] > 0.0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
        at = np.where(inside, row, 0).astype(np.intp), np.where(inside, column, 0).astype(np.intp)
        return np.where(inside, self.values[at], 0.0)


@dataclass(frozen=True, eq=False)
class Base:
    """What the cache goes back to when the view no longer rests: how many records, and how far they reached."""

    count: int
    limits: np.ndarray
    adapted: AdaptiveRadiusState


@dataclass(frozen=True, eq=False)
class Check:
    """Pixels under test: their sites, the E (N, 3) in W/m² that the picture shows there, the doubt (N,) by which they were
    drawn, the number of the first one's record, and how many are gathered. doubt: (H, W) of all pixels, seen (H, W): those that
    count."""

    sites: Sites
    shown: np.ndarray
    drawn_by: np.ndarray
    first: int
    doubt: np.ndarray
    seen: np.ndarray
    done: int = 0


@dataclass(frozen=True, eq=False)
class Refinement:
    """How far a view's refinement has come: one value, replaced whole.

    step, splats, levels: of the picture on show. error: its relative RMSE, None until it is known; last_error: the last one
    known. told: the sums of what pixels
    told of errors: of their squares over doubt, and how many. The rest is of the next step: check: what is done for `error`.
    doubt: (H, W) W/m². next_levels, finer: the numbers of old records that still look along too few rays; None before they are
    chosen. fill: its progress as a view. ended: nothing more is to be refined, or nothing more can be.
    """

    base: Base
    splats: SplatBuffer
    levels: Levels
    step: int = 0
    error: float | None = None
    last_error: float | None = None
    told: tuple[float, float] = (0.0, 0.0)
    check: Check | None = None
    doubt: np.ndarray | None = None
    next_levels: Levels | None = None
    finer: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))
    fill: ViewState = ViewState()
    ended: bool = False


class Refiner(Owner):
    """Refines one view of `size` (width, height) at a time; the records that it adds go when the view no longer rests."""

    def __init__(
        self, ctx: moderngl.Context, size: tuple[int, int], gradients: bool, scheduler: RecordScheduler, timers: Timers
    ) -> None:
        self.scheduler, self.cache, self.size = scheduler, scheduler.cache, size
        self._splats = [ViewSplats(ctx, size, gradients, timers) for _ in range(2)]  # of the picture on show, and of the next one
        self._reach = [float_texture(ctx, size, 1) for _ in range(2)]

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (*self._splats, *self._reach)

    def begin(self, splats: SplatBuffer, camera: Camera) -> Refinement:
        """The refinement of a view that is covered by records whose sums are `splats`."""
        cache = self.cache
        base = Base(cache.count, cache.limits(cache.count).copy(), self.scheduler.adaptation.state())
        return Refinement(base, splats, Levels(np.zeros(self.size[::-1], "f4"), camera))

    def leave(self, state: Refinement) -> None:
        """Forget the records of the refinement; the others reach as far as before, and hold what they have come to hold."""
        self.cache.truncate(state.base.count)
        self.cache.restore_limits(state.base.limits)
        self.scheduler.adaptation.restore(state.base.adapted, self.scheduler.settings)

    def advance(self, state: Refinement, target: float, gbuffer: GBuffer, shadows: ShadowMaps, budget: Budget) -> Refinement:
        """Go on by a part of a step: test some pixels, gather some records more finely, or make some new ones.

        target: the relative error at which the refinement ends.
        """
        if state.ended or not self.scheduler.room or (state.error is not None and (state.error <= target or state.step >= LAST)):
            return replace(state, ended=True)
        if state.error is None or state.doubt is None:
            return self._test(state, gbuffer, shadows, budget)
        if state.next_levels is None:
            return self._choose(state, gbuffer)
        if len(state.finer):
            sizes = self._fineness(state.next_levels)(self.cache.positions[state.finer])
            done = self.scheduler.gatherer.regather_finely(shadows, state.finer, sizes, budget)
            return replace(state, finer=state.finer[done:])
        return self._fill(state, gbuffer, shadows, budget)

    def _fineness(self, levels: Levels, more: float = 0.0) -> Fineness:
        """How finely records look where a view is refined to these levels; more: added to them."""
        side = self.scheduler.settings.gather_size

        def sizes(positions: np.ndarray) -> np.ndarray:
            doublings = np.round(0.25 * (levels.at(positions) + 1.0 + more)).astype(np.intp)
            sides: np.ndarray = np.minimum(side * 2 ** np.maximum(doublings, 0), max(_FINEST, side))
            return sides

        return sizes

    def _test(self, state: Refinement, gbuffer: GBuffer, shadows: ShadowMaps, budget: Budget) -> Refinement:
        """Gather at pixels drawn at random, far more finely than the records that the picture is made of, and compare."""
        check, fineness = state.check, self._fineness(state.levels, more=_FINER)
        if check is None:
            seed = self.scheduler.settings.seed, state.step
            check = _drawn(read_back(gbuffer), state.splats, self.cache.count, seed)
            order = np.argsort(fineness(check.sites.position), kind="stable")
            check = replace(check, sites=check.sites[order], shown=check.shown[order], drawn_by=check.drawn_by[order])
        left = check.sites[check.done :]
        done = self.scheduler.gatherer.gather_finely(shadows, left, fineness(left.position), budget)
        check = replace(check, done=check.done + done)
        if check.done < len(check.sites):
            return replace(state, check=check)
        true = self.cache.values[check.first : check.first + check.done, :3].astype(float)
        squares = ((check.shown - true) ** 2).mean(1)
        told = _KEPT * state.told[0] + float((squares / check.drawn_by).sum()), _KEPT * state.told[1] + len(squares)
        mean = _mean(state.splats, check.seen)
        off = math.sqrt(float(check.doubt[check.seen].mean()) * told[0] / max(told[1], 1.0))
        error = off / mean if mean > 0.0 else 0.0
        return replace(state, check=None, doubt=check.doubt, told=told, error=error, last_error=error)

    def _choose(self, state: Refinement, gbuffer: GBuffer) -> Refinement:
        """The levels of the next step, and the records that have to look more finely for it."""
        from scipy import ndimage

        assert state.doubt is not None
        doubt = np.maximum(state.doubt, 1e-30)  # W²/m⁴; its relation to the error's square cancels out
        limit = _LEAVE**2 * float(doubt[state.doubt > 0.0].mean())
        # an error is about in proportion to the square of the reach, so that it takes a level to halve it
        more = np.clip(0.5 * np.log2(doubt / limit), 0.0, _STEP)
        around = max(round(_BLUR * self.size[1]), 1)
        more = ndimage.gaussian_filter(ndimage.maximum_filter(more, 2 * around + 1), around)
        levels = Levels(np.minimum(state.levels.values + more, _MOST).astype("f4"), state.levels.camera)
        index = (state.step + 1) % 2
        self._reach[index].write(levels.reach[::-1].tobytes())
        self._splats[index].forget()
        sizes = self._fineness(levels)(self.cache.positions)
        known = np.maximum(self.cache.gather_sizes, self.scheduler.settings.gather_size)
        finer = np.flatnonzero((sizes > known) & (self.scheduler.served(gbuffer, levels.camera) > 0.0))
        return replace(state, next_levels=levels, finer=finer[np.argsort(sizes[finer], kind="stable")])

    def _fill(self, state: Refinement, gbuffer: GBuffer, shadows: ShadowMaps, budget: Budget) -> Refinement:
        """Make records where the next step lacks some; once it lacks none its picture takes the place of the other."""
        levels, settings, index = state.next_levels, self.scheduler.settings, (state.step + 1) % 2
        assert levels is not None
        fill, _ = self.scheduler.limit_radii(state.fill)
        splats = self._splats[index].update(self.cache, gbuffer, levels.camera, settings, 1, self._reach[index])
        if not fill.stalled and fill.settled != (splats, settings.asking):
            fill, _ = self.scheduler.gather_missing(fill, gbuffer, splats, shadows, levels.camera, budget, self._fineness(levels))
            if not (fill.stalled or fill.settled == (splats, settings.asking)):
                return replace(state, fill=fill, ended=fill.full)
        return Refinement(state.base, splats, levels, state.step + 1, last_error=state.last_error, told=state.told)


def _mean(splats: SplatBuffer, seen: np.ndarray) -> float:
    """The mean irradiance of the seen pixels (H, W), W/m²."""
    sums = pixels(splats.sums)[seen]
    return float((sums[:, :3] / np.maximum(sums[:, 3:], 1e-20)).mean(dtype=float))


def _drawn(seen: Seen, splats: SplatBuffer, first: int, seed: tuple[int, ...]) -> Check:
    """CHECKS of the seen pixels, drawn with a probability in proportion to their doubt: the variance of what records
    say there, averaged over the pixels around, and a share of its mean. first: the number of the first record to come."""
    from scipy import ndimage

    sums, weight = pixels(splats.sums).astype(float), pixels(splats.weight).astype(float)
    k = np.maximum(sums[..., 3], 1e-20)
    variance = np.where(seen.mask, np.maximum(weight[..., 1] / k - ((sums[..., :3] @ LUMINANCE) / k) ** 2, 0.0), 0.0)
    sigma = max(_BLUR * len(variance), 1.0)
    share = ndimage.gaussian_filter(seen.mask.astype(float), sigma)
    doubt = np.where(seen.mask, ndimage.gaussian_filter(variance, sigma) / np.maximum(share, 1e-6), 0.0)
    doubt += seen.mask * (_FAIR / (1.0 - _FAIR) * float(doubt[seen.mask].mean()) + 1e-20)
    random, candidates = np.random.default_rng(seed), np.flatnonzero(seen.mask)
    sum_to = np.cumsum(doubt.ravel()[candidates])
    count = min(CHECKS, len(candidates))
    places = (np.arange(count) + random.random(count)) / max(count, 1) * sum_to[-1]
    chosen = np.unique(candidates[np.minimum(np.searchsorted(sum_to, places), len(candidates) - 1)])
    at = np.unravel_index(chosen, seen.mask.shape)
    triangle = None if seen.triangle is None else seen.triangle[at]
    shown = sums[at][:, :3] / np.maximum(sums[at][:, 3:], 1e-20)
    return Check(
        Sites(seen.position[at], seen.normal[at], seen.geometric[at], triangle), shown, doubt[at], first, doubt, seen.mask
    )
