"""A view that rests: it is refined step by step, and its picture is that of the last complete step."""

from __future__ import annotations

from dataclasses import replace

from irrsplat.core.timing.input_waits import InputWaits
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.time_budget import Budget
from irrsplat.image.view import Progress
from irrsplat.indirect.refinement import Refinement, Refiner
from irrsplat.indirect.scheduler import RecordScheduler
from irrsplat.renderer.rounds import Rounds
from irrsplat.renderer.stages import Stages
from irrsplat.renderer.state import Round, State
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings


class RestingView(Owner):
    """The refinement of the view that a renderer shows, from `begin` until `leave` undoes it."""

    def __init__(self, stages: Stages, rounds: Rounds, scheduler: RecordScheduler) -> None:
        self.stages, self.rounds, self.scheduler = stages, rounds, scheduler
        self._passes = Workshop()
        self._refinement: Refinement | None = None  # one value, replaced whole
        self._refiner: Refiner | None = None  # the one that it was begun with

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (self._passes,)

    @property
    def begun(self) -> bool:
        """True while a view is refined."""
        return self._refinement is not None

    @property
    def broken(self) -> bool:
        """True if the refinement was interrupted and has to restart."""
        return self._refinement is not None and self._refinement.broken

    @staticmethod
    def possible(settings: Settings) -> bool:
        """True if views with these settings can be refined."""
        return settings.placement == "tiles" and settings.most_bounces > 0

    def rests(self, state: State, camera: Camera) -> bool:
        """True if the present view is the unchanged view of `camera` and no record is stale."""
        return self.rounds.view_state(state, camera) is state.view and not len(self.scheduler.cache.stale)

    def begin(self, state: State, camera: Camera) -> None:
        """Refine a complete view further."""
        made_of = state.size, state.settings.gradients
        self._refiner = self._passes.get(
            "refiner", made_of, lambda: Refiner(self.stages.ctx, *made_of, self.scheduler, self.stages.timers)
        )
        gbuffer, splats = self.stages.draw_gbuffer(state, camera), self.stages.splats(state)
        self._refinement = self._refiner.begin(splats.update(self.scheduler.cache, gbuffer, camera, state.settings, 1), camera)

    def advance(self, state: State, camera: Camera, target: float, budget: Budget) -> None:
        """Refine the view until its estimated relative error is at most `target`, or the budget is spent."""
        shadows, gbuffer = self.stages.draw_shadows(state), self.stages.draw_gbuffer(state, camera)
        assert self._refinement is not None and self._refiner is not None
        try:
            while True:
                self._refinement = self._refiner.advance(self._refinement, target, gbuffer, shadows, budget)
                if self._refinement.ended or budget.left <= 0.0:
                    break
        except InputWaits:  # before any record was made: the next tick takes the same step
            raise
        except BaseException:  # what the cache holds is no longer what the step says: it is not gone on with
            self._refinement = replace(self._refinement, broken=True, check=None)
            raise

    def shown(self, state: State, camera: Camera) -> Round:
        """Return the refined view's round for its picture, with its progress."""
        refined, view, stages = self._refinement, state.view, self.stages
        assert refined is not None
        full = view.full or self.scheduler.room == 0
        progress = Progress(
            view.rounds, self.scheduler.cache.count, 0, view.coverage, full=full, error=refined.last_error, refined=refined.ended
        )
        return Round(camera, stages.draw_shadows(state), stages.draw_gbuffer(state, camera), refined.splats, progress)

    def free(self) -> None:
        """Free the passes of refinement, which are rebuilt at the next use; no view is refined now."""
        self._passes.drop("refiner")

    def leave(self) -> None:
        """Go back to the view as its settings have it."""
        if self._refinement is not None and self._refiner is not None:
            self._refiner.leave(self._refinement)
            self._refinement = None
