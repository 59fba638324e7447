"""Scheduling of records: rounds of examination and gathering within the frame budget."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import cast

import numpy as np

from irrsplat.core.buffers import GBuffer, ShadowMaps, Sites, SplatBuffer
from irrsplat.gather.spot_check import SIDES, PlacesChecked, SpotCheck, SpotPass, Spots
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.target import pixels
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.indirect import paper_scan
from irrsplat.indirect.examine import Examination, ExaminePass, Screen, tile_side
from irrsplat.indirect.flight_order import FlightOrder
from irrsplat.indirect.gathering.basis import BounceStatistics
from irrsplat.indirect.gathering.record_gatherer import RecordGatherer
from irrsplat.indirect.site_selection import FEWER, chessboard, choose
from irrsplat.indirect.view_state import ViewState
from irrsplat.records.adaptive_radius import AdaptiveRadius
from irrsplat.records.cache_file import CacheState
from irrsplat.records.culling import within
from irrsplat.records.eviction import kept
from irrsplat.records.record_cache import RecordCache
from irrsplat.records.refresh_order import RefreshOrder
from irrsplat.scene.change import SceneChange
from irrsplat.scene.model import Camera, Part, Scene, measure
from irrsplat.settings import Settings

_ROOMY = 0.1  # of the records that there may be: with room for fewer, views are not checked
_REACH = 8.0  # percent of the image height by which the first sites lie apart where radii have no upper limit


@dataclass(frozen=True)
class RoundResult:
    """Result of one step on the splat buffer: the number of new records; True if all sites of the round are gathered."""

    new: int
    complete: bool


NOTHING_ASKED = RoundResult(0, True)


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
        self.gatherer = RecordGatherer(world, settings, cache, timers)
        self.adaptation = AdaptiveRadius(world.ctx, cache, timers)
        self.flight_order = FlightOrder()
        self._passes = Workshop()
        self._checked = PlacesChecked()

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (self.gatherer, self.adaptation, self._passes)

    @property
    def settings(self) -> Settings:
        """The settings by which records are gathered now."""
        return self.gatherer.settings

    @property
    def refresh_order(self) -> RefreshOrder:
        """The order in which stale records are gathered again."""
        gradients = self.settings.gradients
        return self._passes.get("refresh_order", gradients, lambda: RefreshOrder(self.ctx, gradients))

    # ---- what changes ----------------------------------------------------------------------------------------------

    def change_to(self, scene: Scene) -> SceneChange:
        """Return how `scene` differs from the scene by which records are gathered now."""
        return self.gatherer.change_to(scene)

    def apply(self, settings: Settings, change: SceneChange, shadows: ShadowMaps | None) -> None:
        """Apply other settings and another state of the scene.

        Affected records become stale. Records close to a place that a mesh has left or reached are removed. change: from
        `change_to`. shadows: of the former scene, None if none are drawn.
        """
        bounces = self.settings.most_bounces
        kept = self.gatherer.apply(settings, change, shadows)
        other_lights = change and change.dimming is None
        if other_lights or self.settings.most_bounces != bounces:  # light differs otherwise from place to place
            self._checked.forget()
        if kept is not None:
            self.adaptation.keep(kept)

    def expire(self) -> None:
        """Gather everything again."""
        self._checked.forget()
        self.gatherer.expire()

    # ---- rounds ----------------------------------------------------------------------------------------------------

    def prepare(self, shadows: ShadowMaps, budget: Budget, idle: bool = False) -> bool:
        """Prepare gathering. Return True if records may be gathered. idle: True if no record waits."""
        return self.gatherer.prepare(shadows, budget, idle)

    def refresh(self, shadows: ShadowMaps, gbuffer: GBuffer | None, camera: Camera, budget: Budget) -> int:
        """Gather stale records again in place. Return how many. gbuffer: records with most pixels in it come first."""
        stale = self.cache.stale
        numbers = stale if gbuffer is None else self.refresh_order.order(self.cache, gbuffer, camera, self.settings)
        return self.gatherer.regather(shadows, numbers, budget)

    def limit_radii(self, state: ViewState, last: bool = False) -> tuple[ViewState, bool]:
        """Hold new records against all others, as AdaptiveRadius does, and the old ones too where a view begins or, `last`, ends;
        whether any old one reaches otherwise now."""
        changed = self.adaptation(self.settings, old_too=last or not state.limited, same_floor=state.queue is not None)
        return replace(state, limited=True), changed

    def screen(self, gbuffer: GBuffer, splats: SplatBuffer, camera: Camera) -> Screen:
        """Return a view that is drawn whole, for the examination."""
        return Screen(
            gbuffer.position.size,
            splats.pixel_stride,
            splats,
            lambda settings: self.examined(gbuffer, splats, settings),
            lambda: self.spots(gbuffer, splats, camera),
            gbuffer,
            splats,
        )

    @property
    def _changing(self) -> bool:
        """True while records are stale or provisional: their variance and their difference from probes have no meaning."""
        return len(self.cache.stale) > 0 or self.gatherer.provisional

    def missing(self, screen: Screen) -> float:
        """Return the share of the seen pixels that request a record now. Nothing is gathered."""
        with self.timers("examine"):
            return screen.examine(self.settings).missing

    def gather_missing(
        self, state: ViewState, screen: Screen, shadows: ShadowMaps, camera: Camera, budget: Budget, side: int = 0
    ) -> tuple[ViewState, RoundResult]:
        """Gather where the view lacks records, as far as the budget goes.

        side: of the gathers for a view that is refined, 0 for any other. Refinement evicts no record, and checks no spots.
        """
        scan = self.settings.placement == "scan" and not side
        close = partial(self._close, screen=screen, shadows=shadows, budget=budget, spots=not (scan or side))
        before, result = state, NOTHING_ASKED
        if scan:
            state, result = self._scan(state, screen, shadows, camera, budget)
        elif state.queue is None:
            self._checked.forget_if_fewer(self.cache.count)
            if self._changing:
                state = replace(state, check=None)
            elif state.check is not None:
                return self._check(state, screen, shadows, budget, True), replace(NOTHING_ASKED, complete=False)
            if state.closing:
                state, ended, _ = close(state)
                return replace(state, rounds=state.rounds + ended), replace(NOTHING_ASKED, complete=False)
            state = self._requested(state, screen, camera, budget, side)
        if state.queue is not None:
            self.gatherer.restore_surface(shadows, budget)
            done = self.gatherer.gather(shadows, _asked_by(state.queue, camera, screen.size), budget, side, state.near)
            state = replace(state, queue=state.queue[done:] if done < len(state.queue) else None)
            result = RoundResult(done, state.queue is None)

        state = replace(state, coverage=1.0 - state.missing)
        if not result.complete:
            return state, result
        few = state.requesting < FEWER
        state = replace(state, crowded=not few, closing=state.closing or (few and state.crowded))
        settled = False
        if not result.new:
            state, ended, settled = close(state)
            if not ended:
                return state, replace(result, complete=False)
        gained = state.coverage > before.coverage or state.holes < before.holes_before
        state = replace(
            state,
            rounds=state.rounds + 1,
            stalled_rounds=0 if gained else state.stalled_rounds + 1,
            holes_before=state.holes,
            settled=(screen.sums, self.settings.request_criteria) if settled else state.settled,
        )
        return state, replace(result, complete=result.new > 0 or settled)

    def _requested(self, state: ViewState, screen: Screen, camera: Camera, budget: Budget, side: int) -> ViewState:
        """Return the view with the queue of a new round, coarse to fine; None if there is nothing to gather."""
        state, sites = self._select(state, screen)
        if budget.limited and not side:
            sites = sites[self.flight_order(sites.position, camera, screen.size)]
        room = self.room if side else self._room(len(sites), camera, screen.size)
        return replace(state, queue=sites[:room] or None, full=room < len(sites))

    def _close(
        self, state: ViewState, screen: Screen, shadows: ShadowMaps, budget: Budget, spots: bool
    ) -> tuple[ViewState, bool, bool]:
        """Continue the work that waits until hardly any tile requests records: the spot check, then the reach of old records.

        That work makes many tiles request records again. So it does not wait until none does: the last few would take rounds of
        their own, over and over. Return whether one part is done, and whether that was the last one and changed nothing.
        """
        if self._changing:  # every pixel is splatted meanwhile, and the rest waits
            coarse = state.pixel_stride > 1
            return (replace(state, pixel_stride=1, closing=False) if coarse else state), coarse, False
        if not (state.checked or state.pixel_stride > 1):
            state = self._check(state, screen, shadows, budget, spots)
            if not state.checked or state.queue is not None:
                return state, state.checked, False
        if not self.adaptation.compare(self.settings, budget):
            return state, False, False
        state, limited = self.limit_radii(state, last=True)
        unchanged = not limited and state.pixel_stride == 1  # else others may be missing
        return replace(state, pixel_stride=1, closing=False), True, unchanged

    def spots(self, gbuffer: GBuffer, splats: SplatBuffer, camera: Camera) -> Spots:
        """The places of a view, or of the part of it that `camera` draws, for a spot check, as SpotPass has them."""
        size = gbuffer.position.size
        with self.timers("examine"):
            return self._passes.get("spots", size, lambda: SpotPass(self.ctx, size))(gbuffer, splats, camera)

    def _check(self, state: ViewState, screen: Screen, shadows: ShadowMaps, budget: Budget, spots: bool) -> ViewState:
        """Advance the spot check of a view that requests no record, as far as the budget goes, and queue records where it fails.

        There is no check with little room for further records, nor with settings that ignore inter-record variance.
        """
        check, gatherer = state.check, self.gatherer
        if check is None:
            roomy = self.room > _ROOMY * self.settings.max_records
            if not (spots and roomy and self.settings.spread and gatherer.may_probe):
                return replace(state, checked=True)
            left = self._checked.left(screen.spots())
            check = SpotCheck(left, left)
        while True:
            more = gatherer.probe_luminance(shadows, check.spots.sites[len(check.found) :], budget, SIDES[check.stage])
            check = replace(check, found=np.concatenate([check.found, more]))
            if len(check.found) < len(check.spots):
                return replace(state, check=check)
            if check.stage == len(SIDES) - 1:
                break
            check = SpotCheck(check.whole, check.doubtful, stage=check.stage + 1)
            if budget.left <= 0.0:
                return replace(state, check=check)
        sites = check.doubtful.sites[: self.room]
        self._checked.note(check.whole, self.cache.count + len(sites))
        return replace(state, check=None, checked=True, queue=sites or None, near=False, stalled_rounds=0)

    def _room(self, wanted: int, camera: Camera, size: tuple[int, int]) -> int:
        """Evict records to make room for new records where eviction is allowed; return the free number of records."""
        numbers = kept(self.cache, wanted, camera, size, self.settings)
        if numbers is not None:
            self.cache.keep_only(numbers)
            self.adaptation.keep(numbers)
            self._checked.forget()
        return self.room

    @property
    def room(self) -> int:
        """The free number of records without eviction."""
        return max(self.settings.max_records - self.cache.count, 0)

    def examined(self, gbuffer: GBuffer, splats: SplatBuffer, settings: Settings, part: Part | None = None) -> Examination:
        """Return the examination of a picture, or of the `part` that the buffers hold."""
        return self._passes.get("examine", (), lambda: ExaminePass(self.ctx))(gbuffer, splats, settings, part)

    def _select(self, state: ViewState, screen: Screen) -> tuple[ViewState, Sites]:
        """The sites of a new round, and with them the state in which the next one selects."""
        settings = replace(self.settings, spread=0.0) if self._changing else self.settings
        with self.timers("examine"):
            found, side = screen.examine(settings), tile_side(screen.size, 1)
            reach = (settings.radius_max or _REACH) / 100.0 * measure(screen.size) / side  # tiles
            # of every other pixel a quarter of the tiles ask: about as many as would, were every pixel looked at
            requests, step = int(np.count_nonzero(found.requests)) * screen.pixel_stride**2, state.step
            board = chessboard(step, reach, requests)
            tiles = choose(found.requests, board, settings.seed + step)
            while requests and not len(tiles[0]):  # no requests in these fields of the chessboard: try the next ones
                step += 1
                board = chessboard(step, reach, requests)
                tiles = choose(found.requests, board, settings.seed + step)
            step += requests > 0  # looks that find nothing are no steps: there may be any number of them in small ticks
            state = replace(state, missing=found.missing, holes=found.holes, requesting=requests, step=step, near=board.last)
            return state, found.at(tiles)

    def _scan(
        self, state: ViewState, screen: Screen, shadows: ShadowMaps, camera: Camera, budget: Budget
    ) -> tuple[ViewState, RoundResult]:
        """Gather by the paper's own algorithm: random warm-up records, then a traversal in scan order on the CPU."""
        scan, gbuffer, splats = state.scan, screen.gbuffer, screen.splats
        assert gbuffer is not None and splats is not None  # such a view is drawn whole
        if scan is None:
            with self.timers("gbuffer"):
                scan = paper_scan.View(gbuffer, self.settings.warmup if self.cache.count else 0)
        self.gatherer.restore_surface(shadows, budget)
        room = self._room(1, camera, gbuffer.position.size)
        state = replace(state, scan=scan, full=not room)
        if not room:
            return replace(state, missing=self.missing(screen)), NOTHING_ASKED
        more = iter(range(1, room))

        def goes_on() -> bool:
            return budget.left > 0.0 and next(more, None) is not None

        record = paper_scan.Recorder(self.gatherer.gather_pass, self.gatherer.light(shadows), goes_on)
        with self.timers("gather" if scan.warmed < self.settings.warmup else "examine"):
            sites, values, missing = scan.ask(pixels(splats.weight)[..., 0], record, camera, self.settings)
        if len(sites):
            self.cache.append(_asked_by(sites, camera, gbuffer.position.size), values)
        return replace(state, missing=missing), RoundResult(len(sites), not record.stopped)

    # ---- for files, the viewer and the statistics -------------------------------------------------------------------------

    def served(self, gbuffer: GBuffer, camera: Camera) -> np.ndarray:
        """(N,) float32: about how many pixels of a view each record serves."""
        return self.refresh_order.covered(self.cache.records, gbuffer, camera, self.settings)

    def count_in_view(self, camera: Camera, size: tuple[int, int]) -> int:
        """Return the number of records in the frustum of a view of `size` (width, height), hidden records included."""
        return int(np.count_nonzero(within(self.cache.positions, camera, size)))

    def state(self) -> CacheState:
        """Return the records with all that a file keeps of them."""
        gatherer = self.gatherer
        # records that are not yet compared with a change: all of them will be stale
        bounces, settings = gatherer.bounces(self.settings), asdict(self.settings)
        records = self.cache.state(gatherer.has_pending_changes)
        self._checked.forget_if_fewer(self.cache.count)
        return CacheState(records, self.adaptation.state(), bounces, settings, self._checked.cells)

    def restore(self, state: CacheState) -> None:
        """Replace the present records by the records of a file."""
        self.cache.restore(state.records)
        self.adaptation.restore(state.adapted, self.settings)
        self._checked = PlacesChecked(state.checked, self.cache.count)
        self.gatherer.resume_with(cast(BounceStatistics, dict(state.bounces)))


def _asked_by(sites: Sites, camera: Camera, size: tuple[int, int]) -> Sites:
    """Return `sites` as requested by a view of `size` (width, height) from `camera`."""
    distance = np.linalg.norm(sites.position - np.asarray(camera.eye, "f4"), axis=1)
    return replace(sites, screen=camera.measure(size) * distance)
