"""One round of a view: shadows, g-buffer, then splat, examine and gather where no record speaks for a pixel yet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol, TypeVar

from irrsplat.core.buffers import GBuffer, SplatBuffer
from irrsplat.core.timing.clock import now
from irrsplat.core.timing.input_waits import checked_by, never
from irrsplat.gpu.time_budget import Budget
from irrsplat.image.statistics import Statistics
from irrsplat.image.view import Progress
from irrsplat.indirect.scheduler import NOTHING_ASKED, RecordScheduler, RoundResult
from irrsplat.indirect.splat_buffer import first_stride
from irrsplat.indirect.view_state import ViewState
from irrsplat.records.record_cache import RecordCache
from irrsplat.renderer.stages import Stages
from irrsplat.renderer.state import Round, State
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings

Made = TypeVar("Made", bound="HasProgress")
_RENEWAL = 0.6  # of the time for gathering that stale records may take while pixels without a record wait too


class Rounds:
    """The rounds of a renderer's views, all of them but the pictures."""

    def __init__(self, stages: Stages, scheduler: RecordScheduler) -> None:
        self.stages, self.scheduler, self.cache = stages, scheduler, scheduler.cache

    def view_state(self, state: State, camera: Camera) -> ViewState:
        """How far this view has come; a new one begins where anything differs that decides which records it asks for."""
        view, subject = state.view, state.view_subject
        if view.camera == camera and view.subject == subject:
            return view
        # coarse splats are interpolated between pixels, which would lose what normal maps add
        whole = any(run.look.normal is not None for run in self.stages.world.runs)
        return ViewState(camera, subject, 1 if whole else first_stride(state.settings, state.size))

    def __call__(
        self, state: State, camera: Camera, budget: Budget, gather: bool = True, picture: bool = True
    ) -> tuple[State, Round]:
        """Every stage with what it depends on, in the paper's order; how far the renderer has come with it, and what it leaves.

        gather: False leaves the cache as it is. picture: time is kept back for one.
        """
        stages, scheduler, settings, costs = self.stages, self.scheduler, state.settings, state.costs
        later = costs.picture if picture else 0.0  # seconds
        scheduler.follow(settings, scheduler.change_to(state.scene), stages.shadows(state))
        shadows = stages.draw_shadows(state)
        gbuffer = stages.draw_gbuffer(state, camera)
        view = self.view_state(state, camera)

        bounces = settings.most_bounces > 0
        idle = view.settled is not None and not len(self.cache.stale)
        ready = gather and bounces and scheduler.prepare(shadows, budget.part(1.0, costs.splat + later), idle)
        renewed = 0
        if ready:
            share = 1.0 if view.coverage == 1.0 else _RENEWAL
            renewed = scheduler.renew(shadows, gbuffer, camera, budget.part(share, costs.splat + later if picture else 0.0))
        if renewed and not picture and len(self.cache.stale) and (shown := stages.splats(state).sums) is not None:
            # A changed record costs a splat of all records: while the last picture stays, records get the whole tick.
            return replace(state, view=replace(view, stalled_rounds=0)), Round(
                camera, shadows, gbuffer, shown, self._progress(view, NOTHING_ASKED, renewed, self.cache.waiting)
            )
        if renewed or len(self.cache.stale):
            view = replace(view, stalled_rounds=0)  # what stalled by the old light may be served by the new
        start = now()
        view, _ = scheduler.limit_radii(view)
        if view.stalled and view.pixel_stride > 1:
            view = replace(view, pixel_stride=1, stalled_rounds=0)
        splats = stages.splats(state).update(self.cache, gbuffer, camera, settings, view.pixel_stride)
        if budget.limited:
            stages.ctx.finish()
        costs = replace(costs, splat=now() - start)

        requests = NOTHING_ASKED
        if not bounces:
            view = replace(view, coverage=1.0)
        elif not ready or view.stalled:  # the last round of a stalled view may have covered all
            view, requests = self._look_only(state, view, gbuffer, splats, gather)
        elif view.settled != (splats, settings.asking):
            view, requests = scheduler.gather_missing(view, gbuffer, splats, shadows, camera, budget.part(1.0, later))
        if requests.new and picture and budget.limited and len(self.cache.stale):  # a frame later, what moves has moved on
            with checked_by(never):  # the round's records are in the cache, and not yet in the returned state
                splats = stages.splats(state).update(self.cache, gbuffer, camera, settings, view.pixel_stride)

        waiting = self.cache.waiting
        if ready and budget.limited and not requests.new and not renewed:
            scheduler.gatherer.learn(shadows, budget.part(1.0, later))
            waiting += scheduler.gatherer.to_learn
        progress = self._progress(view, requests, renewed, waiting if bounces else None)
        return replace(state, view=view, costs=costs), Round(camera, shadows, gbuffer, splats, progress)

    def _progress(self, view: ViewState, requests: RoundResult, renewed: int, waiting: int | None) -> Progress:
        """Return how far a view has come by a round: records gathered again, and records that wait for that.

        waiting: None without bounces, where nothing is gathered.
        """
        stale, made = (0, 1.0) if waiting is None else (waiting, self.scheduler.gatherer.surface_share)
        return Progress(
            view.rounds, self.cache.count, requests.new, view.coverage, renewed, stale, requests.complete, made, view.full
        )

    def frozen(self, state: State, camera: Camera) -> Round:
        """What a view's picture is made of by the records that there are: none is gathered or changed, and nothing of other views
        is in it."""
        stages, scheduler, settings = self.stages, self.scheduler, state.settings
        scheduler.follow(settings, scheduler.change_to(state.scene), stages.shadows(state))
        shadows, gbuffer = stages.draw_shadows(state), stages.draw_gbuffer(state, camera)
        scheduler.limit_radii(ViewState(), last=True)  # of a cache that has no limits yet, or such by other settings
        splats = stages.splats(state).update(self.cache, gbuffer, camera, settings, 1)
        missing = scheduler.missing(gbuffer, splats) if settings.most_bounces > 0 else 0.0
        progress = Progress(0, self.cache.count, 0, 1.0 - missing)
        return Round(camera, shadows, gbuffer, splats, progress, frozen=True)

    def _look_only(
        self, state: State, view: ViewState, gbuffer: GBuffer, splats: SplatBuffer, gather: bool
    ) -> tuple[ViewState, RoundResult]:
        """Return how much of the view is covered, while nothing is gathered for it. If `gather` is False for good, every pixel is
        splatted next."""
        looked_at = splats, state.settings.asking
        if view.looked_at != looked_at:
            view = replace(view, looked_at=looked_at, coverage=1.0 - self.scheduler.missing(gbuffer, splats))
        if gather or view.pixel_stride == 1:
            return view, NOTHING_ASKED
        return replace(view, pixel_stride=1), replace(NOTHING_ASKED, complete=False)


class HasProgress(Protocol):
    """What a round leaves: at least how far the view has come."""

    @property
    def progress(self) -> Progress:
        """How far."""


def until_complete(
    cache: RecordCache,
    settings: Settings,
    next_round: Callable[[], Made],
    stalled: Callable[[], bool],
    on_progress: Callable[[Progress], None] | None,
) -> tuple[Made | None, Statistics]:
    """Rounds until one finds nothing to gather, or as many as the settings allow, or until they are `stalled`: the last one, None
    before the first, and the statistics of them all. Ctrl-C ends them with the records of the last complete one."""
    stats: Statistics = {"rounds": 0, "converged": False, "full": False, "interrupted": False, "coverage": 0.0}
    stats["error"] = None
    complete, ended, done = cache.count + cache.evicted, False, None
    try:
        while not ended and stats["rounds"] < settings.max_rounds and not stalled():
            done = next_round()
            now = done.progress
            complete, ended = cache.count + cache.evicted, now.new == 0 and now.complete
            stats["rounds"] += 1
            stats["coverage"], stats["full"], stats["converged"] = now.coverage, now.full, ended and not now.full
            if on_progress is not None:
                on_progress(now)
    except KeyboardInterrupt:
        stats["interrupted"] = True
        cache.truncate(complete - cache.evicted)
    return done, stats
