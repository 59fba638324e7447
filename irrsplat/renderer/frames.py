"""The frames of a renderer, one after the other: its rounds and their pictures, and the one State that each hands to the next.

Cameras are relative to the scene's origin here. Read `Frames.frame` first, and then `Rounds` (rounds.py), which is all of it
but the picture.
"""

from __future__ import annotations

from dataclasses import replace

from irrsplat.core.timing.clock import now
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.image.antialias import OnProgress
from irrsplat.image.composite import CompositePass
from irrsplat.image.view import Progress, View
from irrsplat.indirect.refinement import Refiner
from irrsplat.indirect.scheduler import RecordScheduler
from irrsplat.indirect.view_state import ViewState
from irrsplat.renderer.moving import MovingViews
from irrsplat.renderer.rounds import Rounds
from irrsplat.renderer.stages import Stages
from irrsplat.renderer.state import Round, Shown, State
from irrsplat.scene.model import Camera

_PICTURE_SHARE = 2.0  # how many times as long as a picture takes pass before the next one, while a view fills in ticks
_OLDEST_PICTURE = 0.3  # seconds after which the next one comes in any case


class Frames(Owner):
    """Draws the frames of a world's views. state: how far they have come, replaced whole from frame to frame."""

    def __init__(self, world: World, scheduler: RecordScheduler, timers: Timers, state: State) -> None:
        self.ctx, self.scheduler, self.timers, self.state = world.ctx, scheduler, timers, state
        self.stages = Stages(world, scheduler, timers)
        self.moving = MovingViews(Stages(world, scheduler, timers, self.stages), scheduler)
        self.rounds = Rounds(self.stages, scheduler)
        self._passes = Workshop()  # the refiner

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (self.stages, self.moving, self._passes)

    # ---- a frame ---------------------------------------------------------------------------------------------------

    def frame(self, camera: Camera, seconds: float | None, gather: bool = True, moving: bool = False) -> tuple[View, Progress]:
        """One round and its picture, as Renderer.frame has them."""
        self.timers.clear()
        budget = Budget(seconds)
        if self.refines:
            if self._rests(camera):
                return self.refined_view(camera)
            self.leave_refinement()
        if moving and self.moving.divisor(self.state) > 1:
            self.state = replace(self.state, view=ViewState())  # what the whole view was to request may have been gathered since
            return self.moving(self.state, camera, budget, gather)
        start, other = now(), camera != self.state.view.camera
        shown = self.state.shown if gather and budget.limited and self._picture_may_wait(camera) else None
        self.state, done = self.rounds(self.state, camera, budget, gather, picture=shown is None)
        if budget.limited:
            self.ctx.finish()
        surface = self.scheduler.gatherer.surface_now
        bounced = None if surface is None else surface.result
        if shown is not None and not done.progress.still and shown.bounced is bounced:
            older = replace(shown, age=shown.age + now() - start)
            self.state = replace(self.state, shown=older)
            return shown.view, replace(done.progress, fading=shown.view.fading)
        start = now()
        fading = budget.limited and self.state.settings.placement != "scan"
        view = self.stages.draw_picture(self.state, done, fading, hurried=budget.limited)
        if budget.limited and (self.state.shown is None or view is not self.state.shown.view):
            self.ctx.finish()
            self.state = replace(self.state, costs=replace(self.state.costs, picture=now() - start))
        if seconds is not None and other:
            self.moving.note(self.state.costs.splat + self.state.costs.picture, seconds)
        self.state = replace(self.state, shown=Shown(view, self.state.picture_subject(camera), bounced))
        return view, replace(done.progress, fading=view.fading)

    def _picture_may_wait(self, camera: Camera) -> bool:
        """True if the last picture can stay for another frame: only new records would change it, and drawing takes time from
        gathering."""
        shown = self.state.shown
        if shown is None or shown.subject != self.state.picture_subject(camera) or self.stages.picture is not shown.view:
            return False
        costs, renewing = self.state.costs, len(self.scheduler.cache.stale) > 0
        least = costs.splat + costs.picture if renewing else 0.0  # so that gathering gets half of the time
        return shown.age < max(min(_PICTURE_SHARE * costs.picture, _OLDEST_PICTURE), least)

    def accumulate(self, view: View, samples: int, seconds: float | None = None, on_progress: OnProgress | None = None) -> View:
        """The view of the last frame with more samples, as Renderer.accumulate has it."""
        if samples <= 1:
            return view
        return self.stages.accumulate(self.state, view, samples, Budget(seconds), on_progress)

    def stops(self, view: View) -> float:
        """The exposure of a view in stops, as the settings have it."""
        exposure = self.state.settings.exposure
        if exposure != "auto":
            return float(exposure)
        return self.composite_pass(view).exposure(view.image, view.gbuffer)

    def composite_pass(self, view: View) -> CompositePass:
        """Return the pass that makes pictures of the size of a `view` that `frame` gave."""
        size = view.image.size
        stages = self.stages if size == self.state.size else self.moving.stages
        return stages.composite_pass(replace(self.state, size=size))

    # ---- progressive refinement ------------------------------------------------------------------------------------

    def refine(self, camera: Camera, target: float, seconds: float | None) -> tuple[View, Progress]:
        """A step of a complete view's refinement, as Renderer.refine has it."""
        budget, refiner = Budget(seconds), self._refiner
        if refiner is not None and refiner.state is not None and (refiner.state.broken or not self._rests(camera)):
            self.leave_refinement()
        if not self.refines:
            state, view = self.state, self.state.view
            shown = self.rounds.view_state(state, camera) is view and view.ended and view.pixel_stride == 1
            if not shown or not self.can_refine:
                return self.frame(camera, seconds)
            made_of = state.size, state.settings.gradients
            refiner = self._passes.get("refiner", made_of, lambda: Refiner(self.ctx, *made_of, self.scheduler, self.timers))
            gbuffer, splats = self.stages.draw_gbuffer(state, camera), self.stages.splats(state)
            refiner.begin(splats.update(self.scheduler.cache, gbuffer, camera, state.settings, 1), camera)
        assert refiner is not None
        refiner.advance(target, self.stages.draw_gbuffer(self.state, camera), self.stages.draw_shadows(self.state), budget)
        return self.refined_view(camera)

    @property
    def can_refine(self) -> bool:
        """True if these settings allow `refine`."""
        settings = self.state.settings
        return settings.placement == "tiles" and settings.most_bounces > 0

    @property
    def refines(self) -> bool:
        """True while a view is refined."""
        return self._refiner is not None and self._refiner.state is not None

    @property
    def _refiner(self) -> Refiner | None:
        return self._passes.find("refiner", Refiner)

    def _rests(self, camera: Camera) -> bool:
        """True if the present view is the unchanged view of `camera` and no record is stale."""
        return self.rounds.view_state(self.state, camera) is self.state.view and not len(self.scheduler.cache.stale)

    def refined_view(self, camera: Camera) -> tuple[View, Progress]:
        """Return the picture of a refined view, and its progress."""
        state, view, stages, cache = self.state, self.state.view, self.stages, self.scheduler.cache
        assert self._refiner is not None and self._refiner.state is not None
        refined, full = self._refiner.state, view.full or self.scheduler.room == 0
        progress = Progress(
            view.rounds, cache.count, 0, view.coverage, full=full, error=refined.last_error, refined=refined.ended
        )
        done = Round(camera, stages.draw_shadows(state), stages.draw_gbuffer(state, camera), refined.splats, progress)
        return stages.draw_picture(state, done), progress

    def leave_refinement(self) -> None:
        """Return to the view as its settings have it."""
        if self._refiner is not None:
            self._refiner.leave()

    # ---- what changes ----------------------------------------------------------------------------------------------

    def change_to(self, state: State) -> None:
        """Change to another scene, size or settings that have been validated."""
        if state.view_subject != self.state.view_subject:
            self.leave_refinement()
        change = self.scheduler.change_to(state.scene)
        dimming = change.dimming
        self.scheduler.apply(state.settings, change, self.stages.shadows(self.state))
        if dimming is not None:
            state = replace(state, view=self._dimmed_view(state))
            if self.stages.temporal_filter is not None:
                self.stages.temporal_filter.dim(dimming)
        self.state = state

    def _dimmed_view(self, after: State) -> ViewState:
        """Return the progress of the present view after a mere dimming of lights, which the records follow at once."""
        view = self.state.view
        if view.subject != self.state.view_subject:
            return view
        subject = replace(self.state, scene=after.scene).view_subject
        return replace(view, subject=subject, limited=False, settled=None, examined_at=None)

    def forget(self, shadows: bool) -> None:
        """Draw every buffer of the view again next time; the `shadows` only if they are meant too."""
        self.leave_refinement()
        self.stages.forget(shadows=shadows)
        self.moving.stages.forget(shadows=shadows)
        self.state = replace(self.state, view=ViewState())

    def free_buffers(self) -> None:
        """Free the buffers of the last view except image and alpha; the next use makes them again."""
        self.stages.free_buffers()
        self.moving.stages.free_buffers()
        self.leave_refinement()
        self._passes.drop("refiner")
        self.state = replace(self.state, view=ViewState(), shown=None)
