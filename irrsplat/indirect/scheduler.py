"""Scheduling of records: rounds of examination and gathering within the frame budget.

The progress of a view is an immutable value, which restarts with another camera, size, scene or criterion.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np

from irrsplat.core.buffers import GBuffer, ShadowMaps, Sites, SplatBuffer
from irrsplat.core.color import LUMINANCE
from irrsplat.core.vectors import along_a_way
from irrsplat.gather.spot_check import SIDES, SpotCheck, SpotPass, Spots
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import pixels
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.indirect.examine import Examination, ExaminePass, Screen, chessboard, choose, tile_side
from irrsplat.indirect.gathering.record_gatherer import RecordGatherer
from irrsplat.indirect.hole_filling import HoleProbes
from irrsplat.indirect.paper_scan import Scan, gather_record, read_back
from irrsplat.records.adaptive_radius import AdaptiveRadius
from irrsplat.records.cache_file import CacheState
from irrsplat.records.culling import kept
from irrsplat.records.record_cache import RecordCache
from irrsplat.records.refresh_order import RefreshOrder
from irrsplat.scene.change import SceneChange
from irrsplat.scene.model import Camera, Scene, measure
from irrsplat.settings import Settings

COVERED = 0.9  # of the pixels: with fewer holes, all take the light of records around them
GIVE_UP = 8  # rounds in a row without gain in coverage, after which a view requests no more records
_PROBED_NOISE = 0.1  # of E: with more noise in records, a probe along a quarter of their rays is noise itself
_AROUND = 8  # records that decide whether a place is probed, half of them before it along a space-filling curve
_CHECKS = 3  # spot checks of a view, at most: the further ones probe around errors
_REACH = 8.0  # percent of the image height by which the first sites lie apart where radii have no upper limit


@dataclass(frozen=True)
class ViewState:
    """The progress of one view.

    subject: all inputs of its requests, the camera first; empty for no view. side: of the gathers of a refined view; 0: the
    settings' side. pixel_stride: 2 while only every other pixel is splatted, in both directions. rounds: number of complete
    rounds. stalled_rounds: number of successive rounds without gain in coverage. step: of the site selection, coarse to fine.
    missing, before: under-covered share of the surface pixels, 0..1, at the beginning of the present round, and of the last
    complete round. examined: sums and criteria of the last examination. settled: True if they request no record.
    queue: the waiting sites of the present round; None between rounds. near: True if they have the greatest density, so that
    their records cover only near surfaces. check: the unfinished spot check; failed: the numbers of pixels with errors at each
    check before it; checked: True after the last one. full: True if the view needs more records than the limit. holes: the cells
    that still lack a probe, see HoleFilling; None: unknown. scan: the traversal of the paper's algorithm.
    """

    subject: tuple[object, ...] = ()
    side: int = 0
    pixel_stride: int = 1
    rounds: int = 0
    stalled_rounds: int = 0
    step: int = 0
    missing: float = 1.0
    before: float = 1.0
    examined: tuple[object, ...] = ()
    settled: bool = False
    queue: Sites | None = None
    near: bool = False
    check: SpotCheck | None = None
    failed: tuple[np.ndarray, ...] = ()
    checked: bool = False
    full: bool = False
    holes: Sites | None = None
    scan: Scan | None = None

    @property
    def coverage(self) -> float:
        """The covered share of the surface pixels at the beginning of the present round, 0..1."""
        return 1.0 - self.missing

    @property
    def lacks_probes(self) -> bool:
        """True if holes have no probe and are too large to take the light of records around them."""
        return self.coverage < COVERED and (self.holes is None or len(self.holes) > 0)

    @property
    def stalled(self) -> bool:
        """True if rounds no longer gain coverage: the remaining requests cannot be met."""
        return self.stalled_rounds >= GIVE_UP


class RecordScheduler(Owner):
    """Scheduler that fills the `cache` for a view: stale records first, then pixels that no record covers."""

    def __init__(
        self,
        world: World,
        settings: Settings,
        cache: RecordCache,
        timers: Timers,
    ) -> None:
        self.ctx, self.cache, self.timers = world.ctx, cache, timers
        self.gatherer = self.own(RecordGatherer(world, settings, cache, timers))
        self.adaptation = self.own(AdaptiveRadius(world.ctx, cache, timers))
        self.examine_pass, self.refresh_order = self.own(ExaminePass(world.ctx)), self.own(RefreshOrder(world.ctx))
        self.hole_probes = self.own(HoleProbes(world.ctx))
        self.spot_pass = self.own(SpotPass(world.ctx))
        self._checked = 0  # number of records at the last spot check, including requested ones

    @property
    def settings(self) -> Settings:
        """The settings by which records are gathered now."""
        return self.gatherer.settings

    # ---- changes ---------------------------------------------------------------------------------------------------

    def apply(self, settings: Settings, scene: Scene, shadows: ShadowMaps | None) -> SceneChange:
        """Apply other settings and another state of the scene. Return the change of the scene.

        Records that a change may affect wait for probes, which find the stale ones. Records close to a place that a mesh has left
        or reached are removed. shadows: of the former scene, None if none are drawn.
        """
        change = SceneChange.between(self.gatherer.basis.scene, scene)
        bounces, limited = self.settings.most_bounces, self.adaptation.is_current(settings)
        kept = self.gatherer.apply(settings, change, shadows)
        if limited and change.dimming is not None and not np.ptp(change.dimming):  # limits depend on ratios of light alone
            self.adaptation.accept(vars(settings), self.adaptation.compared)
        other_lights = change and change.dimming is None
        if other_lights or self.settings.most_bounces != bounces:  # light differs otherwise from place to place
            self._checked = 0
        if kept is not None:
            self.adaptation.keep(kept)
        return change

    def expire(self) -> None:
        """Gather everything again."""
        self._checked = 0
        self.gatherer.expire()

    # ---- rounds ----------------------------------------------------------------------------------------------------

    def refresh(self, shadows: ShadowMaps, gbuffer: GBuffer | None, camera: Camera, budget: Budget) -> int:
        """Gather stale records again in place. Return their number. Records with most pixels in `gbuffer` come first."""
        stale = self.cache.stale
        numbers = stale if gbuffer is None else self.refresh_order.order(self.cache, gbuffer, camera, self.settings)
        return self.gatherer.gather(numbers, shadows, budget)

    def limit_radii(self, view: ViewState, old_too: bool = False) -> bool:
        """Compare new records with those before them, see AdaptiveRadius. Return True if the reach of an old record changed.

        A view compares old records, too, before its first round, and where `old_too` is set.
        """
        old_too = old_too or (view.rounds == 0 and view.queue is None)
        return self.adaptation(self.settings, old_too, same_floor=view.queue is not None)

    def screen(self, gbuffer: GBuffer, splats: SplatBuffer, camera: Camera) -> Screen:
        """Return a view that is drawn whole, for the examination."""
        examine, spots = partial(self.examine_pass, gbuffer, splats), partial(self.spot_pass, gbuffer, splats, camera)
        return Screen(camera, gbuffer.position.size, splats.pixel_stride, splats, examine, spots, gbuffer, splats)

    @property
    def changing(self) -> bool:
        """True while records may be stale or are provisional: their variance and difference from probes have no meaning."""
        return self.cache.waiting > 0 or self.gatherer.provisional

    def ended(self, view: ViewState, screen: Screen) -> bool:
        """True if the view requests no record, or only records that it cannot get."""
        return view.stalled or (view.settled and view.examined == self._inputs(screen))

    def examined(self, view: ViewState, screen: Screen) -> ViewState:
        """Return the view with its present coverage."""
        return view if view.examined == self._inputs(screen) else self._examine(view, screen, self.settings)[0]

    def _inputs(self, screen: Screen) -> tuple[object, ...]:
        """Return all inputs of an examination."""
        return screen.sums, self.settings.request_criteria

    def _examine(self, view: ViewState, screen: Screen, settings: Settings) -> tuple[ViewState, Examination]:
        """Return the view with its present coverage, and its examination by these settings."""
        with self.timers("examine"):
            found = screen.examine(settings)
        return replace(view, missing=found.missing, examined=self._inputs(screen)), found

    def gather_missing(self, view: ViewState, screen: Screen, shadows: ShadowMaps, budget: Budget) -> tuple[ViewState, int]:
        """Gather records that the view requests, within the budget. Return the view, and the number of new records.

        Further work waits until no tile requests a record: the spot check, then the reach of old records. Both may make tiles
        request records again.
        """
        if self.ended(view, screen):  # the last round of a stalled view may have covered all pixels
            return self.examined(view, screen), 0
        changing, coarse, new = self.changing, view.pixel_stride > 1, 0
        if self.settings.placement == "scan":
            view, new, waits = self._scan(view, screen, shadows, budget)
        else:
            if view.queue is None:
                view = self._request(view, screen, shadows, budget)
            if view.queue is not None:
                self.gatherer.restore_surface(shadows, budget)
                new = self.gatherer.gather(screen.requested(view.queue), shadows, budget, view.side, view.near)
                view = replace(view, queue=view.queue[new:] if new < len(view.queue) else None)
            waits = view.queue is not None or view.check is not None
        if waits or (changing and not (new or coarse)):  # changing records are compared once they have their final light
            return view, new
        gained, settled = view.missing < view.before, False
        if not new:
            # further records may be missing between pixels with sums, or after a change of an old record's reach
            settled = not (changing or self.limit_radii(view, old_too=True) or coarse)
            view = replace(view, pixel_stride=1)
        stalled = 0 if gained else view.stalled_rounds + 1
        return replace(view, settled=settled, rounds=view.rounds + 1, stalled_rounds=stalled, before=view.missing), new

    def _request(self, view: ViewState, screen: Screen, shadows: ShadowMaps, budget: Budget) -> ViewState:
        """Return the view with the queue of a new round, or with its spot check advanced within the budget."""
        if self.cache.count < self._checked:  # requested records were not gathered: their places are checked again
            self._checked = 0
        if view.check is None or self.changing:
            view = self._select(replace(view, check=None), screen)
        if view.queue is None and not (view.checked or self.changing or view.pixel_stride > 1):
            view = self._check(view, screen, shadows, budget)
        return view

    def _check(self, view: ViewState, screen: Screen, shadows: ShadowMaps, budget: Budget) -> ViewState:
        """Advance the spot check of a view that requests no record, within the budget, and queue records at failures.

        There is no first check without new records since the last one, without room for further ones, nor with settings that
        ignore inter-record variance. Further checks follow errors, such as those along a thin shadow.
        """
        check, gatherer, failed = view.check, self.gatherer, view.failed
        if check is None:
            pays = gatherer.may_probe_holes and self.settings.gather_size >= 2 * SIDES[-1]  # a gather has four times the rays
            if not (self.room and self.settings.spread and pays and (failed or self._checked < self.cache.count)):
                return replace(view, checked=True)
            with self.timers("examine"):
                spots = screen.spots(bool(failed))
            check = SpotCheck(spots.near(failed, screen.size) if failed else self._unchecked(spots))
        while check.stage < len(SIDES):
            probes = gatherer.empty_probes()
            gatherer.gather(check.spots.sites[len(check.found) :], shadows, budget, SIDES[check.stage], probes=probes)
            check = check.after(probes.values[:, :3].astype(float) @ LUMINANCE)
            if len(check.found) or (budget.left <= 0.0 and check.stage < len(SIDES)):  # the next tick continues
                return replace(view, check=check)
        spots = check.spots[: self.room]
        self._checked = self.cache.count + len(spots)
        queue, failed = spots.sites if len(spots) else None, (*failed, spots.pixels)
        ended = queue is None or len(failed) == _CHECKS
        return replace(view, check=None, failed=failed, checked=ended, queue=queue, near=False, stalled_rounds=0)

    def _unchecked(self, spots: Spots) -> Spots:
        """Return the places where half of the records around are new since the last spot check, and have little noise.

        With more noise, a probe resolves no difference that counts.
        """
        count = self.cache.count
        if not (count and len(spots)):
            return spots
        codes = along_a_way(np.concatenate([self.cache.positions, spots.sites.position]))
        order = np.argsort(codes[:count], kind="stable")
        after = np.searchsorted(codes[order], codes[count:])
        near = order[np.clip(after[:, None] + np.arange(_AROUND) - _AROUND // 2, 0, count - 1)]
        new = (near >= self._checked).mean(1) >= 0.5
        if not self.settings.gradients:  # the noise of records is unknown
            return spots[new]
        luminance = (self.cache.values[:, :3] @ LUMINANCE)[near]
        noise = self.cache.records.read("noise")["noise"][near] * luminance
        return spots[new & (np.sqrt((noise**2).mean(1)) <= _PROBED_NOISE * luminance.mean(1))]

    def _room(self, requested: int, screen: Screen) -> int:
        """Evict records to make room for new records where eviction is allowed; return the free number of records."""
        numbers = kept(self.cache, requested, screen.camera, screen.size, self.settings)
        if numbers is not None:
            self.cache.keep_only(numbers)
            self.adaptation.keep(numbers)
            self._checked = 0
        return self.room

    @property
    def room(self) -> int:
        """The free number of records without eviction."""
        return max(self.settings.max_records - self.cache.count, 0)

    def _select(self, view: ViewState, screen: Screen) -> ViewState:
        """Return the view with its present coverage, and the queue of a new round, coarse to fine; None without a request."""
        settings = replace(self.settings, spread=0.0) if self.changing else self.settings
        (view, found), step = self._examine(view, screen, settings), view.step
        # a quarter of the tiles requests a record if only every other pixel is examined
        requests = int(np.count_nonzero(found.requests)) * view.pixel_stride**2
        reach = (settings.radius_max or _REACH) / 100.0 * measure(screen.size) / tile_side(screen.size, 1)  # tiles
        while True:  # the next field of the chessboard follows a field without requests
            width, colour = chessboard(step, reach, requests)
            tiles = choose(found.requests, width, colour, settings.seed + step)
            step += requests > 0  # an examination without requests is no step: small ticks may repeat it
            if len(tiles[0]) or not requests:
                break
        sites = found.at(tiles)
        room = self.room if view.side else self._room(len(sites), screen)
        queue = sites[:room] if len(sites) and room else None
        return replace(view, step=step, queue=queue, near=colour < 0, full=room < len(sites))

    def _scan(self, view: ViewState, screen: Screen, shadows: ShadowMaps, budget: Budget) -> tuple[ViewState, int, bool]:
        """Gather by the paper's own algorithm: random warm-up records, then a traversal in scan order on the CPU.

        Return the view, the number of new records, and True if the traversal waits for the next frame.
        """
        scan, gbuffer, splats = view.scan, screen.gbuffer, screen.splats
        assert gbuffer is not None and splats is not None  # the scan draws whole views alone
        if scan is None:
            with self.timers("gbuffer"):
                scan = Scan(read_back(gbuffer), self.settings.warmup if self.cache.count else 0)
        self.gatherer.restore_surface(shadows, budget)
        room = self._room(1, screen)
        view = self.examined(replace(view, scan=scan, full=not room), screen)
        if not room:
            return view, 0, False
        gather, light = self.gatherer.gather_pass(), self.gatherer.light(shadows)

        def record(site: Sites) -> np.ndarray:
            return gather_record(gather, light, screen.requested(site))

        weight = pixels(splats.weight)[..., 0]
        with self.timers("gather" if scan.warmed < self.settings.warmup else "examine"):
            sites, values, missing, complete = scan.advance(weight, record, room, budget, screen.camera, self.settings)
        if len(sites):
            self.cache.append(screen.requested(sites), values)
        return replace(view, missing=missing), len(sites), not complete

    # ---- for files, the viewer and the statistics -------------------------------------------------------------------------

    def pixels_covered(self, gbuffer: GBuffer, camera: Camera) -> np.ndarray:
        """Return (N,) float32, about the number of a view's pixels that each record covers."""
        return self.refresh_order.covered(self.cache.records, gbuffer, camera, self.settings)

    def state(self) -> CacheState:
        """Return the records with all columns of a file."""
        gatherer = self.gatherer
        # records without a comparison after a change will all be stale
        bounces, settings = gatherer.bounces(self.settings), asdict(self.settings)
        records = self.cache.state(gatherer.has_pending_changes)
        checked = self._checked if self.cache.count >= self._checked else 0
        return CacheState(records, bounces, settings, checked, self.adaptation.compared)

    def restore(self, state: CacheState) -> None:
        """Replace the present records by the records of a file."""
        self.cache.restore(state.records)
        self.adaptation.accept(state.settings, state.compared)
        self._checked = state.checked
        self.gatherer.resume_with(state.bounces)
