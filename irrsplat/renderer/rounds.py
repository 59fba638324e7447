"""One round of a view: the paper's stages in their order, each where something it depends on has changed (Jones 2010)."""

from __future__ import annotations

from dataclasses import replace

from irrsplat.core.buffers import ShadowMaps
from irrsplat.core.timing.clock import now
from irrsplat.core.timing.input_waits import checked_by, never
from irrsplat.gpu.time_budget import Budget
from irrsplat.image.view import Progress
from irrsplat.indirect.examine import Screen
from irrsplat.indirect.scheduler import NOTHING_ASKED, RecordScheduler, RoundResult
from irrsplat.indirect.splat_buffer import first_stride
from irrsplat.indirect.view_state import ViewState
from irrsplat.renderer.stages import Stages
from irrsplat.renderer.state import Round, State
from irrsplat.renderer.tiles import TileScreens
from irrsplat.scene.model import Camera

_RENEWAL = 0.6  # of the time for gathering: the share of stale records while pixels without a record wait too


class Rounds:
    """The rounds of a renderer's views, without their pictures. Views are drawn whole, or in tiles where the state has some."""

    def __init__(self, stages: Stages, scheduler: RecordScheduler) -> None:
        self.stages, self.scheduler, self.cache = stages, scheduler, scheduler.cache
        self._tiles = TileScreens(stages, scheduler)

    def __call__(
        self, state: State, camera: Camera, budget: Budget, gather: bool = True, picture: bool = True
    ) -> tuple[State, Round]:
        """Return the state after a round, and the round.

        gather: False leaves the cache as it is. picture: True if time is reserved for a picture.
        """
        scheduler, settings, costs = self.scheduler, state.settings, state.costs
        later = costs.picture if picture else 0.0  # seconds
        shadows = self.follow_scene(state)  # 3.3
        gbuffer = None if state.tile else self.stages.draw_gbuffer(state, camera)  # 3.2
        view = self.view_state(state, camera)

        bounces = settings.most_bounces > 0
        idle = (view.settled is not None or view.coverage == 1.0) and not len(self.cache.stale)
        dark = scheduler.gatherer.surface_now is None
        ready = gather and bounces and scheduler.prepare(shadows, budget.part(1.0, costs.splat + later), idle)
        if dark and budget.limited and scheduler.gatherer.surface_now is not None and budget.left <= 0.0:
            ready = False  # the first light is shown at once: passes that gather records take a tenth of a second to make
        renewed = 0
        if ready:  # 2.1, records whose light has changed
            part = budget.part(1.0 if view.coverage == 1.0 else _RENEWAL, costs.splat + later if picture else 0.0)
            renewed = scheduler.refresh(shadows, gbuffer, camera, part)
        if renewed and not picture and len(self.cache.stale) and (shown := self.stages.splats(state).sums) is not None:
            # A changed record costs a splat of all records: while the last picture stays, records get the whole tick.
            progress = self._progress(view, NOTHING_ASKED, renewed, self.cache.waiting)
            return replace(state, view=replace(view, stalled_rounds=0)), Round(camera, shadows, gbuffer, shown, progress)
        if renewed or len(self.cache.stale):
            view = replace(view, stalled_rounds=0)  # other light may cover what stalled

        start = now()
        view, _ = scheduler.limit_radii(view)
        if view.stalled and view.pixel_stride > 1:
            view = replace(view, pixel_stride=1, stalled_rounds=0)
        screen = self._screen(state, camera, view.pixel_stride)  # 2.2
        if budget.limited:
            self.stages.ctx.finish()
        costs = replace(costs, splat=now() - start)

        requests = NOTHING_ASKED
        if not bounces:
            view = replace(view, coverage=1.0)
        elif not ready or view.stalled:  # the last round of a stalled view may have covered all
            view, requests = self._examine_only(view, screen, settings.request_criteria, gather)
        elif view.settled != (screen.sums, settings.request_criteria):  # 2.3 and 2.1
            view, requests = scheduler.gather_missing(view, screen, shadows, camera, budget.part(1.0, later))
        if requests.new and picture and budget.limited and len(self.cache.stale):  # a frame later, what moves has moved on
            with checked_by(never):  # the round's records are in the cache, and not yet in the returned state
                screen = self._screen(state, camera, view.pixel_stride)

        progress = self._progress(view, requests, renewed, self.cache.waiting if bounces else None)
        return replace(state, view=view, costs=costs), Round(camera, shadows, gbuffer, screen.splats, progress)

    def frozen(self, state: State, camera: Camera) -> Round:
        """Return the round of a view by the present records: none is gathered, and nothing of other views is in the picture."""
        shadows = self.follow_scene(state)
        gbuffer = None if state.tile else self.stages.draw_gbuffer(state, camera)
        self.scheduler.limit_radii(ViewState(), last=True)  # the cache may have no limits yet, or those of other settings
        screen = self._screen(state, camera, 1)
        missing = self.scheduler.missing(screen) if state.settings.most_bounces > 0 else 0.0
        progress = Progress(0, self.cache.count, 0, 1.0 - missing)
        return Round(camera, shadows, gbuffer, screen.splats, progress, frozen=True)

    def view_state(self, state: State, camera: Camera) -> ViewState:
        """Return the progress of this view, which begins anew where anything differs that decides which records it requests."""
        view, subject = state.view, state.view_subject
        if view.camera == camera and view.subject == subject:
            return view
        # coarse splats are interpolated between pixels, which would lose what normal maps add
        whole = any(run.look.normal is not None for run in self.stages.world.runs)
        return ViewState(camera, subject, 1 if whole else first_stride(state.settings, state.size))

    def follow_scene(self, state: State) -> ShadowMaps:
        """Let records and surface cache follow the scene's changes, and return its shadow maps."""
        self.scheduler.apply(state.settings, self.scheduler.change_to(state.scene), self.stages.shadows(state))
        return self.stages.draw_shadows(state)

    def _screen(self, state: State, camera: Camera, stride: int) -> Screen:
        """Return the view for the examination, with the splats of all records at every `stride`-th pixel."""
        if state.tile:
            return self._tiles(state, camera, stride)
        gbuffer = self.stages.draw_gbuffer(state, camera)
        splats = self.stages.splats(state).update(self.cache, gbuffer, camera, state.settings, stride)
        return self.scheduler.screen(gbuffer, splats, camera)

    def _examine_only(
        self, view: ViewState, screen: Screen, criteria: tuple[object, ...], gather: bool
    ) -> tuple[ViewState, RoundResult]:
        """Return the coverage of a view for which nothing is gathered. If `gather` is False for good, every pixel is splatted
        next."""
        examined_at = screen.sums, criteria
        if view.examined_at != examined_at:
            view = replace(view, examined_at=examined_at, coverage=1.0 - self.scheduler.missing(screen))
        if gather or view.pixel_stride == 1:
            return view, NOTHING_ASKED
        return replace(view, pixel_stride=1), replace(NOTHING_ASKED, complete=False)

    def _progress(self, view: ViewState, requests: RoundResult, renewed: int, waiting: int | None) -> Progress:
        """Return the progress of a view by a round: records gathered again, and records that wait for that.

        waiting: None without bounces, where nothing is gathered.
        """
        stale, made = (0, 1.0) if waiting is None else (waiting, self.scheduler.gatherer.surface_share)
        return Progress(
            view.rounds, self.cache.count, requests.new, view.coverage, renewed, stale, requests.complete, made, view.full
        )
