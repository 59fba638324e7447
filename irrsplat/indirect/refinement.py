"""Progressive refinement of a covered view: each step lowers the error of the picture and estimates it (docs/METHOD.md, 8.3).

Inter-record variance at a pixel shortens the reach of the records there, so that the pixel requests further records. If the rays
are too few for the target error, all records are gathered with four times as many. The picture of a step stays on show until the
next step is complete, or until the surface cache has another level.

Gathers at random pixels estimate the error of a picture, without a model of it. Importance sampling draws pixels of large
estimated variance more often. Each test gathers along as many rays as the records around it. The estimated noise of the tests is
no error of the picture, and shows if records need more rays. The next step uses the records of the tests, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, ShadowMaps, Sites, SplatBuffer
from irrsplat.core.color import LUMINANCE
from irrsplat.core.timing.background import Steps, in_background
from irrsplat.core.timing.input_waits import InputWaits, input_waits
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import float_texture, pixels
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.indirect.paper_scan import SMOOTH_OFF, Seen, read_back
from irrsplat.indirect.scheduler import RecordScheduler, ViewState
from irrsplat.indirect.splat import ViewSplats
from irrsplat.scene.model import Camera
from irrsplat.settings import SETTINGS
from irrsplat.surface_cache.transport import BouncedLight

_STILL = 1.3  # times the change of E by a finer level of the surface cache: its own error
_BETWEEN = 0.3  # of a squared error: the share of surface cache or records, above which these are refined further
LAST = 40  # steps
_LEAVE = 0.8  # of the picture's error: pixels with less are not refined
_MOST = 6.0  # levels: at each √½ as much of the reach counts
_AIM = 3.0  # target of a step: the present error divided by this, unless the refinement ends before
_TESTS = 384  # pixels under test for the error estimate
_LEAST = 0.4  # of the squared difference of picture and tests: least squared error, since one test in a dark place may dominate
_TYPICAL = 0.25  # of E, divided by the side of a gather: its noise in the bundled scenes, about
_BLUR = 0.005  # of the image's height: radius over which inter-record variance is averaged


class Refiner(Owner):
    """Refinement of one view at a time, from `begin` until `leave` removes the added records.

    splats: the sums of the displayed picture; None while no view is refined. error: its estimated relative RMSE; None until the
    first estimate. ended: True if the refinement is complete or cannot continue. broken: True after an exception.
    """

    def __init__(self, world: World, scheduler: RecordScheduler, timers: Timers) -> None:
        self.world, self.scheduler, self.cache, self.timers = world, scheduler, scheduler.cache, timers
        self.splats: SplatBuffer | None = None
        self.error: float | None = None
        self.ended = self.broken = False
        self._buffers = self.own(Workshop())  # sums and reach of the displayed and of the next picture
        self._surface_error: tuple[BouncedLight | None, float] = None, 0.0  # of E in W/m², by these values of the surface cache
        self._steps: Iterator[None] = iter(())  # of the present view
        self._base: tuple[int, np.ndarray, int] = 0, np.zeros(0), 0  # of the cache before: records, limits, records compared

    def begin(self, splats: SplatBuffer, camera: Camera) -> None:
        """Refine a view that is covered by records whose sums are `splats`."""
        cache, self.size, self._camera = self.cache, splats.sums.size, camera
        self._base = cache.count, cache.limits(cache.count).copy(), self.scheduler.adaptation.compared
        self.splats, self.error, self.ended, self.broken = splats, None, False, False
        self._steps = self._refined()

    def leave(self) -> None:
        """Remove the records of the refinement; all other records regain their reach, and keep their values."""
        if self.splats is not None:
            (count, limits, compared), self._steps = self._base, iter(())
            self.splats, self.error, self.ended = None, None, False
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
        self._target, self._gbuffer, self._shadows, self._budget = target, gbuffer, shadows, budget
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

    def _refined(self) -> Steps[None]:
        """Refine a view in steps; pause after each part: some pixels tested, some records gathered more finely, some new ones."""
        scheduler, cache, gatherer = self.scheduler, self.cache, self.scheduler.gatherer
        levels, doublings, number, reach = np.zeros(self.size[::-1], "f4"), 0, 0, None
        gatherer.restore_surface(self._shadows, self._budget)  # else tests would lack its light
        if gatherer.surface_result is not self._surface_error[0]:  # else a view before has refined the surface cache
            self._surface_error = None, 0.0  # of other values; records of one bounce have none
            yield from self._light(number, reach)
        for step in range(LAST + 1):
            tests = yield from self._test(step, doublings)
            if tests is None:
                return
            (error, noise), surface_error = tests.squares, self._surface_error[1]
            of_records = math.sqrt(max(error - noise, _LEAST * error))
            off = math.hypot(of_records, surface_error)
            aim = max(self._target * tests.mean, off / _AIM)
            finer = self._side(doublings + 1) > self._side(doublings)
            doublings += finer and noise > aim**2
            self.error = off / tests.mean if tests.mean > 0.0 else 0.0
            surface = gatherer.surface_now
            # the finest surface cache may be off by more than the target; then records need not be much better
            if surface is not None and not surface.may_refine and of_records**2 < _BETWEEN * off**2:
                return
            yield
            if step == LAST:
                return
            if surface_error**2 > _BETWEEN * aim**2:
                yield from self._light(number, reach)
            more = yield from in_background(partial(_finer_by, tests.uncertainty))
            levels, number = np.minimum(levels + more, _MOST).astype("f4"), 1 - number
            reach = self._buffers.get(f"reach {number}", self.size, lambda: float_texture(self.world.ctx, self.size, 1))
            # the share of the records' reach that counts
            reach.write(np.exp2(-0.5 * levels).astype("f4")[::-1].tobytes())
            self._sums(number).forget()
            side, sizes = self._side(doublings), cache.column("gather_size")
            coarse = np.where(sizes > 0, sizes, self._side(0)) < side
            left = np.flatnonzero(coarse & (scheduler.pixels_covered(self._gbuffer, self._camera) > 0.0))
            yield
            yield from self._gathered(left, side)
            yield from self._fill(number, reach, side)

    def _side(self, doublings: int) -> int:
        """Return the side of a gather after so many doublings of the settings' side."""
        least = self.scheduler.settings.gather_size
        return int(min(least * 2**doublings, SETTINGS["gather_size"].high or least))

    def _gathered(self, at: Sites | np.ndarray, side: int) -> Steps[None]:
        """Gather new records at sites, or those of these numbers again, along side² rays; pause after each part."""
        while len(at):
            at = at[self.scheduler.gatherer.gather(at, self._shadows, self._budget, side) :]
            yield

    def _sums(self, number: int) -> ViewSplats:
        """Return the splat buffer of the displayed or of the next picture."""
        return self._buffers.get(f"sums {number}", self.size, lambda: ViewSplats(self.world, self.size, self.timers))

    def _splatted(self, number: int, reach: moderngl.Texture | None) -> Steps[SplatBuffer]:
        """Return the sums of all records in one of the two buffers; pause while input waits."""
        while True:
            try:
                return self._sums(number).update(self.cache, self._gbuffer, self._camera, self.scheduler.settings, 1, reach)
            except InputWaits:
                yield

    def _light(self, number: int, reach: moderngl.Texture | None) -> Steps[None]:
        """Refine the surface cache, gather the records again by it, and estimate the remaining error of E.

        number, reach: of the picture on show.
        """
        gatherer, cache = self.scheduler.gatherer, self.cache
        surface = gatherer.surface_now
        if surface is None or not surface.may_refine:
            return
        while not surface.refine(self._shadows, self._budget):
            yield
        yield
        before, sizes = cache.values[:, :3], cache.column("gather_size").copy()
        for side in np.unique(sizes).tolist():
            yield from self._gathered(np.flatnonzero(sizes == side), side)
        changes = cache.values[:, :3].astype(float) - before  # along equal rays: of the light alone
        pixels_covered = self.scheduler.pixels_covered(self._gbuffer, self._camera)[:, None]
        weights = pixels_covered / max(float(pixels_covered.sum()), 1e-20)
        self._surface_error = surface.result, _STILL * float(np.sqrt((weights * changes**2).sum(0).mean()))
        self.scheduler.limit_radii(ViewState(rounds=1))  # only new records, those of the last test: others would leave holes
        self.splats = yield from self._splatted(number, reach)
        yield

    def _test(self, step: int, doublings: int) -> Steps[_Tests | None]:
        """Gather at random pixels, as finely as the records of the picture. Return None without pixels."""
        cache, seen = self.cache, read_back(self._gbuffer)
        assert self.splats is not None
        if not seen.mask.any():  # as for a view past the scene
            self.error = 0.0
            return None
        seed, off = (self.scheduler.settings.seed, step), SMOOTH_OFF * self.world.scene.diagonal
        sums, weight = pixels(self.splats.sums), pixels(self.splats.weight)
        tests = yield from in_background(partial(_drawn, seen, sums, weight, seed, off))  # a large view takes long
        first, sites = cache.count, tests.sites
        yield
        screen = self._camera.measure_at(sites.position, self.size)
        yield from self._gathered(replace(sites, screen=screen), self._side(doublings))
        gathered, noise = cache.values[first:, :3].astype(float), cache.records.read("noise")["noise"][first:]
        if not self.scheduler.settings.gradients:  # records without derivatives do not estimate their noise
            noise = np.full(len(sites), _TYPICAL / self._side(doublings))
        return tests._replace(gathered=gathered, noise=noise[:, None] * gathered)

    def _fill(self, number: int, reach: moderngl.Texture, side: int) -> Steps[None]:
        """Make records where the next step lacks some, and show its picture, unless the limit of records leaves holes in it."""
        fill = ViewState(side=side, checked=True)
        while True:
            self.scheduler.limit_radii(fill)
            splats = yield from self._splatted(number, reach)
            screen = self.scheduler.screen(self._gbuffer, splats, self._camera)
            fill, _ = self.scheduler.gather_missing(fill, screen, self._shadows, self._budget)
            if self.scheduler.ended(fill, screen):
                break
            yield
        self.splats = self.splats if fill.full else splats
        yield


class _Tests(NamedTuple):
    """N pixels under test.

    shown: (N, 3) E of the picture, W/m². drawn_by: (N,) estimated variance by which each pixel was drawn. uncertainty: (H, W)
    this variance at all pixels. mean_uncertainty, mean: means of variance and E over the pixels of the error. gathered, noise:
    (N, 3) E of the tests and its estimated standard error, W/m²; empty at first.
    """

    sites: Sites
    shown: np.ndarray
    drawn_by: np.ndarray
    uncertainty: np.ndarray
    mean_uncertainty: float
    mean: float
    gathered: np.ndarray = np.zeros((0, 3))
    noise: np.ndarray = np.zeros((0, 3))

    @property
    def squares(self) -> tuple[float, float]:
        """The mean squared difference of picture and tests, and the mean squared noise of the tests, both (W/m²)²."""
        squares = np.stack([self.shown - self.gathered, self.noise]) ** 2
        error, noise = self.mean_uncertainty * (squares.mean(2) / self.drawn_by).mean(1)
        return float(error), float(noise)


def _blur_of(height: int) -> float:
    """Return the radius over which inter-record variance is averaged in an image of this height, both in pixels."""
    return max(_BLUR * height, 1.0)


def _drawn(seen: Seen, sums: np.ndarray, weight: np.ndarray, seed: tuple[int, ...], off: float) -> _Tests:
    """Return tests at some smooth pixels, as the error leaves out edges. sums, weight: of the splat buffer.

    Pixels are drawn in proportion to their uncertainty: the variance of the records there, averaged over the pixels around, plus
    its mean. off: see Seen.smooth.
    """
    from scipy import ndimage

    sums, weight = sums.astype(float), weight.astype(float)
    k = np.maximum(sums[..., 3], 1e-20)
    variance = np.where(seen.mask, np.maximum(weight[..., 1] / k - ((sums[..., :3] @ LUMINANCE) / k) ** 2, 0.0), 0.0)
    sigma = _blur_of(len(variance))
    share = ndimage.gaussian_filter(seen.mask.astype(float), sigma)
    uncertainty = np.where(seen.mask, ndimage.gaussian_filter(variance, sigma) / np.maximum(share, 1e-6), 0.0)
    uncertainty += seen.mask * (float(uncertainty[seen.mask].mean()) + 1e-20)
    smooth = seen.smooth(off)
    counting = smooth if smooth.any() else seen.mask
    random, candidates = np.random.default_rng(seed), np.flatnonzero(counting)
    sum_to = np.cumsum(uncertainty.ravel()[candidates])
    count = min(_TESTS, len(candidates))
    places = (np.arange(count) + random.random(count)) / max(count, 1) * sum_to[-1]
    chosen = np.unique(candidates[np.minimum(np.searchsorted(sum_to, places), len(candidates) - 1)])
    at = np.unravel_index(chosen, seen.mask.shape)
    E = sums[..., :3] / k[..., None]
    means = float(uncertainty[counting].mean()), float(E[counting].mean())
    return _Tests(seen.sites(at), E[at], uncertainty[at], uncertainty, *means)


def _finer_by(uncertainty: np.ndarray) -> np.ndarray:
    """Return (H, W) the levels to add for the next step, by the variance (H, W) at all pixels."""
    from scipy import ndimage

    limit = _LEAVE**2 * float(uncertainty[uncertainty > 0.0].mean())  # the variance's relation to the error's square cancels out
    # the error is about proportional to the square of the reach, so that a level halves the error
    more = np.maximum(0.5 * np.log2(np.maximum(uncertainty, 1e-30) / limit), 0.0)
    around = round(_blur_of(len(uncertainty)))
    return np.asarray(ndimage.gaussian_filter(ndimage.maximum_filter(more, 2 * around + 1), around))
