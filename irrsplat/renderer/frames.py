"""The frames of a renderer: the paper's stages in their order, each drawn if an input has changed (Jones 2010).

Cameras are relative to the scene's origin here. Read `Frames.frame` first, and then `Frames.round`, which has all stages but the
picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import moderngl
import numpy as np

from irrsplat.core.buffers import ShadowMaps
from irrsplat.core.errors import InputError
from irrsplat.core.memo import Memo
from irrsplat.core.timing.clock import now
from irrsplat.core.timing.input_waits import checked_by, never
from irrsplat.gather.stratified import LEAST_SIDE
from irrsplat.gpu.context import is_gone
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.time_budget import HALF, Budget
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.image.composite import CompositePass
from irrsplat.image.texture_maps import TextureMaps
from irrsplat.image.view import Progress, Reader, View
from irrsplat.indirect.examine import Screen
from irrsplat.indirect.hole_filling import CELLS, HoleFilling, HoleLight
from irrsplat.indirect.refinement import Refiner
from irrsplat.indirect.scheduler import RecordScheduler, ViewState
from irrsplat.indirect.splat import first_stride
from irrsplat.lighting.light_table import unshadowed_luminance
from irrsplat.renderer.stages import Stages
from irrsplat.renderer.state import Round, Shown, State
from irrsplat.renderer.tiles import tile_screen
from irrsplat.scene.model import Camera
from irrsplat.scene.model.checks import check_type

_PICTURE_SHARE = 2.0  # how many times as long as a picture takes pass before the next one, while a view fills in ticks
_HOLES = 0.2  # of a tick: share for probes of holes, besides records
_OLDEST_PICTURE = 0.3  # seconds after which the next one comes in any case
_SMALLEST = 4  # the largest divisor of width and height of a moving camera's view
_DRAWN = 0.8  # greatest share of a tick for drawing while the camera moves; the gather has the remaining time
_MARGIN = 0.7  # of that share: a larger picture is drawn only if its expected time is less


class Frames(Owner):
    """The frames of a world's views.

    state: scene, settings and progress, replaced whole from frame to frame. reader: see View.
    """

    def __init__(self, world: World, scheduler: RecordScheduler, timers: Timers, state: State, reader: Reader) -> None:
        self.ctx, self.scheduler, self.timers, self.state = world.ctx, scheduler, timers, state
        self.cache, self.maps = scheduler.cache, self.own(TextureMaps(world.ctx))
        self.stages = self.own(Stages(world, scheduler, self.maps, timers, reader))
        self.small = self.own(Stages(world, scheduler, self.maps, timers, reader))  # of a moving camera's smaller views
        self.refiner = self.own(Refiner(world, scheduler, timers))
        self._tiles = Memo()  # examinations of tiles
        self._divisor, self._small = 1, ((0, 0), 0.0, 0.0)  # of the last smaller view: size, seconds of splats and picture

    # ---- a frame ---------------------------------------------------------------------------------------------------

    def frame(self, camera: Camera, seconds: float | None, gather: bool = True, moving: bool = False) -> tuple[View, Progress]:
        """Return the picture and the progress of one round, see Renderer.frame."""
        self.timers.clear()
        budget = Budget(seconds)
        if self.refines:
            if self._is_unchanged(camera):
                return self.refined_view(camera)
            self.refiner.leave()
        if moving and self.divisor > 1:
            return self._smaller_frame(camera, budget, gather)
        other = (camera,) != self.state.view.subject[:1]
        shown = self._waiting_picture(camera) if gather and budget.limited else None
        self.state, done = self.round(self.state, camera, budget, gather, picture=shown is None)
        if budget.limited:
            self.ctx.finish()
        if shown is not None and not done.progress.still and shown.inputs == self._inputs(camera):
            return shown.view, replace(done.progress, accumulating=shown.view.accumulating)
        start = now()
        accumulating, gatherer = budget.limited and self.state.settings.placement != "scan", self.scheduler.gatherer
        # the first light and the first records do not wait for exact shadows
        first = done.progress.coverage < 1.0 and (gatherer.awaits_light or gatherer.provisional) and budget.limited
        view = self.stages.draw_picture(self.state, done, accumulating, budget.limited, moving or first)  # 2.4, 2.5
        if budget.limited and (self.state.shown is None or view is not self.state.shown.view):
            self.ctx.finish()
            self.state = replace(self.state, picture_seconds=now() - start)
        if seconds is not None and other:
            took = self.state.splat_seconds + self.state.picture_seconds
            self._divisor = max(self._divisor, divisor_after(1, took, seconds))
        self.state = replace(self.state, shown=Shown(view, self._inputs(camera), now()))
        return view, replace(done.progress, accumulating=view.accumulating)

    def _smaller_frame(self, camera: Camera, budget: Budget, gather: bool) -> tuple[View, Progress]:
        """Return a smaller picture of a moving camera, and the progress of its round.

        Width and height are divided by a number that follows the time of pictures. Requests are measured in shares of the
        picture: views of any size place records alike, and the whole view starts again with these records.
        """
        start, stages, (known, splat, picture) = now(), self.small, self._small
        self.state = replace(self.state, view=ViewState())
        state = replace(self.state, size=self.size_in_motion, shown=None, splat_seconds=splat, picture_seconds=picture)
        stages.draw_gbuffer(state, camera)
        self.ctx.finish()
        seen = now() - start
        state, done = self.round(state, camera, budget, gather, stages=stages)
        start = now()
        view = stages.draw_picture(state, done, accumulating=True, moving=True)
        self.ctx.finish()
        for texture in (view.image, view.alpha):
            texture.filter = moderngl.LINEAR, moderngl.LINEAR  # a larger target interpolates the picture
        self._small = state.size, state.splat_seconds, now() - start
        if budget.seconds is not None and known == state.size:  # the first view of a size compiles programs
            self._divisor = divisor_after(self._divisor, seen + sum(self._small[1:]), budget.seconds)
        return view, replace(done.progress, accumulating=view.accumulating)

    @property
    def divisor(self) -> int:
        """The divisor of the next moving view's width and height. The paper's scan examines whole pictures alone."""
        return self._divisor if self.state.settings.placement != "scan" else 1

    @property
    def size_in_motion(self) -> tuple[int, int]:
        """Width and height of the next view of a moving camera, pixels."""
        width, height = (max(1, -(-side // self.divisor)) for side in self.state.size)
        return width, height

    def round(
        self,
        state: State,
        camera: Camera,
        budget: Budget,
        gather: bool = True,
        picture: bool = True,
        stages: Stages | None = None,
    ) -> tuple[State, Round]:
        """Return the state after one round of a view, and the round.

        gather: False leaves the cache as it is. picture: True if time is reserved for a picture. stages: of the view's size;
        default: of whole views.
        """
        scheduler, gatherer, cache, settings = self.scheduler, self.scheduler.gatherer, self.cache, state.settings
        stages, bounces, dark = stages or self.stages, settings.most_bounces > 0, self.scheduler.gatherer.awaits_light
        later = state.picture_seconds if picture else 0.0
        reserve = state.splat_seconds + later if picture else 0.0
        scheduler.apply(settings, state.scene, self.stages.shadows(state))
        stages.world.eyes = np.array([camera.eye])
        shadows = self.stages.draw_shadows(state)  # 3.3
        gbuffer = None if state.tile else stages.draw_gbuffer(state, camera)  # 3.2
        view = self.view_state(state, camera)
        if stages is self.small:
            view = replace(view, checked=True)  # the spot check takes half of such a frame: it waits for a still camera

        covered, renewed = view.coverage == 1.0, 0
        idle = covered and not len(cache.stale)
        ready = gather and bounces and gatherer.prepare(shadows, budget.part(1.0, reserve), idle)
        if dark and budget.left <= 0.0:
            ready = False  # the first light is shown at once: passes that gather records take a tenth of a second to make
        if ready:  # 2.1, records whose light has changed, before pixels without a record
            renewed = scheduler.refresh(shadows, gbuffer, camera, budget.part(1.0 if covered else HALF, reserve))
        if renewed or len(cache.stale):
            view = replace(view, stalled_rounds=0)  # other light may end the stall
        if not picture and len(cache.stale) and (sums := stages.splats(state).sums) is not None:
            # A changed record costs a splat of all records: while the last picture stays, records get the whole tick.
            progress = self.progress(view, renewed=renewed)
            return replace(state, view=view), Round(camera, shadows, gbuffer, sums, progress)

        start = now()
        scheduler.limit_radii(view)
        if view.stalled and view.pixel_stride > 1:
            view = replace(view, pixel_stride=1, stalled_rounds=0)
        screen = self._screen(state, camera, view.pixel_stride, stages)  # 2.2
        if budget.limited:
            self.ctx.finish()
        state = replace(state, splat_seconds=now() - start)

        probing = budget.limited and gather and bounces and settings.fill_holes and gatherer.may_probe_holes
        if scheduler.hole_probes.follow(gatherer.surface_result, gatherer.basis.scene, settings.shadow_size):
            view = replace(view, holes=None)
        first = not (cache.count or scheduler.hole_probes.cache.count)
        new, complete = 0, view.pixel_stride == 1
        if not bounces:
            view = replace(view, missing=0.0)
        elif ready:  # 2.3 and 2.1
            part = budget.part(1.0 - _HOLES if probing and view.lacks_probes else 1.0, later)
            view, new = scheduler.gather_missing(view, screen, shadows, part)
            complete = scheduler.ended(view, screen)
        elif not gather:
            view = scheduler.examined(replace(view, pixel_stride=1), screen)
        else:  # records wait for their light; the first record comes before any examination
            view = scheduler.examined(view, screen) if cache.count else view
            complete = False
        if probing and view.lacks_probes:
            filling = stages.hole_filling(state)
            view = self._probe_holes(filling, view, screen, shadows, budget.part(1.0, later), first)
        if complete and ready and budget.limited and not (scheduler.changing or gatherer.basis.moved):
            complete = gatherer.probe_new(shadows, budget.part(1.0, later))
        return replace(state, view=view), Round(
            camera, shadows, gbuffer, screen.splats, self.progress(view, new, complete, renewed)
        )

    def frozen(self, camera: Camera) -> Round:
        """Return the round of a view by the present records: without a gather, and without temporal accumulation."""
        state = replace(self.state, view=ViewState((camera, *self.state.view_subject)))  # the cache may lack limits of radii
        return replace(self.round(state, camera, Budget(None), gather=False)[1], frozen=True)

    def view_state(self, state: State, camera: Camera) -> ViewState:
        """Return the progress of this view. It restarts if an input of its requests differs."""
        view, subject = state.view, (camera, *state.view_subject)
        if view.subject == subject:
            return view
        # coarse splats are interpolated between pixels, which loses the detail of normal maps
        whole = any(run.appearance.normal is not None for run in self.stages.world.runs)
        return ViewState(subject, pixel_stride=1 if whole else first_stride(state.settings, state.size))

    def _screen(self, state: State, camera: Camera, stride: int, stages: Stages) -> Screen:
        """Return the view for the examination, with the splats of all records at every `stride`-th pixel."""
        if state.tile:
            return tile_screen(self.stages, self._tiles, state, camera, stride)
        gbuffer = stages.draw_gbuffer(state, camera)
        splats = stages.splats(state).update(self.cache, gbuffer, camera, state.settings, stride)
        return self.scheduler.screen(gbuffer, splats, camera)

    def _probe_holes(
        self, filling: HoleFilling, view: ViewState, screen: Screen, shadows: ShadowMaps, budget: Budget, first: bool
    ) -> ViewState:
        """Gather probes of a view's holes within the budget. first: True for probes in half of the cells, for a first picture."""
        gatherer, probes, gbuffer, splats = self.scheduler.gatherer, self.scheduler.hole_probes, screen.gbuffer, screen.splats
        assert gbuffer is not None and splats is not None  # ticks draw whole views alone
        if (holes := view.holes) is None:
            with checked_by(never):  # the round's records are in the cache, and not yet in the returned state
                light = HoleLight(probes, gatherer.surface_uniforms, gatherer.provisional)
                holes = filling.sites(gbuffer, splats, screen.camera, light)
        some, budget = (holes[: CELLS // 2], Budget(None)) if first else (holes, budget)
        return replace(view, holes=holes[gatherer.gather(some, shadows, budget, LEAST_SIDE, probes=probes.cache) :])

    def progress(self, view: ViewState, new: int = 0, complete: bool = True, renewed: int = 0) -> Progress:
        """Return the progress of a view by a round with so many `new` and `renewed` records. complete: True if no site waits."""
        gathers, refiner = self.state.settings.most_bounces > 0, self.refiner
        stale, made = (self.cache.waiting, self.scheduler.gatherer.surface_share) if gathers else (0, 1.0)
        full = view.full or (self.refines and self.scheduler.room == 0)
        shares = view.coverage, renewed, stale, complete, made, full
        return Progress(view.rounds, self.cache.count, new, *shares, error=refiner.error, refined=refiner.ended)

    def _inputs(self, camera: Camera) -> tuple[object, ...]:
        """Return all inputs of a picture except the records."""
        return camera, *self.state.view_subject, self.state.settings, self.scheduler.gatherer.surface_result

    def _waiting_picture(self, camera: Camera) -> Shown | None:
        """Return the last picture if it can stay: only records differ, and drawing takes time from gathering."""
        state, shown = self.state, self.state.shown
        if shown is None or shown.inputs != self._inputs(camera) or self.stages.picture is not shown.view:
            return None
        splat, picture = state.splat_seconds, state.picture_seconds
        # gathering gets half of the time, and three quarters once probes have corrected all stale records
        share = 0.0 if not len(self.cache.stale) else 1.0 if self.scheduler.gatherer.basis.moved else 3.0
        least = share * (splat + picture)
        waits = now() - shown.time < max(min(_PICTURE_SHARE * picture, _OLDEST_PICTURE), least)
        return shown if waits else None

    def check_present(self, view: View) -> None:
        """Raise InputError for a view of an earlier camera or size, whose buffers hold another one."""
        check_type("a view", view, View)
        held = view.gbuffer in (self.stages.gbuffer, self.small.gbuffer)
        if not held or is_gone(view.direct):  # other kinds of lights have another pass
            raise InputError("this view's buffers hold another view by now; use a view before the next frame is drawn")

    def stops(self, view: View) -> float:
        """Return the exposure of a view in stops, see Renderer.stops."""
        exposure = self.state.settings.exposure
        if exposure != "auto":
            return float(exposure)
        unshadowed = unshadowed_luminance(self.state.scene)
        return self.composite_pass(view).exposure(view.image, view.gbuffer, unshadowed)

    def composite_pass(self, view: View) -> CompositePass:
        """Return the pass that makes pictures of the size of a `view` that `frame` gave."""
        size = view.image.size
        return (self.stages if size == self.state.size else self.small).composite_pass(size)

    # ---- progressive refinement ------------------------------------------------------------------------------------

    def refine(
        self, camera: Camera, target: float, seconds: float | None, on_part: Callable[[Progress], None] | None = None
    ) -> tuple[View, Progress]:
        """Return the picture and the progress after a step of refinement, see Renderer.refine. on_part: called between parts."""
        budget, refiner, state = Budget(seconds), self.refiner, self.state
        if self.refines and (refiner.broken or not self._is_unchanged(camera)):
            refiner.leave()
        if not self.refines:
            ended = state.view.stalled or state.view.settled
            shown = self.view_state(state, camera) is state.view and ended and state.view.pixel_stride == 1
            if not shown or not self.can_refine:
                return self.frame(camera, seconds)
            gbuffer = self.stages.draw_gbuffer(state, camera)
            refiner.begin(self.stages.splats(state).update(self.cache, gbuffer, camera, state.settings, 1), camera)
        gbuffer, shadows = self.stages.draw_gbuffer(state, camera), self.stages.draw_shadows(state)
        on_pause = None if on_part is None else lambda: on_part(self.progress(state.view))
        refiner.advance(target, gbuffer, shadows, budget, on_pause)
        return self.refined_view(camera)

    @property
    def can_refine(self) -> bool:
        """True if these settings allow `refine`."""
        settings = self.state.settings
        return settings.placement == "tiles" and settings.most_bounces > 0

    @property
    def refines(self) -> bool:
        """True while a view is refined."""
        return self.refiner.splats is not None

    def _is_unchanged(self, camera: Camera) -> bool:
        """True if the present view is the unchanged view of `camera` and no record is stale."""
        return self.view_state(self.state, camera) is self.state.view and not len(self.cache.stale)

    def refined_view(self, camera: Camera) -> tuple[View, Progress]:
        """Return the picture of a refined view, and its progress."""
        state, stages, progress = self.state, self.stages, self.progress(self.state.view)
        done = Round(camera, stages.draw_shadows(state), stages.draw_gbuffer(state, camera), self.refiner.splats, progress)
        return stages.draw_picture(state, done), progress

    # ---- changes ---------------------------------------------------------------------------------------------------

    def change_to(self, state: State) -> None:
        """Change to another scene, size or settings that have been validated."""
        if state.view_subject != self.state.view_subject:
            self.refiner.leave()
        dimming = self.scheduler.apply(state.settings, state.scene, self.stages.shadows(self.state)).dimming
        if dimming is not None:
            state = replace(state, view=self._dimmed_view(state))
            self.stages.forget_last_picture()
        self.state = state

    def _dimmed_view(self, after: State) -> ViewState:
        """Return the progress of the present view after a dimming of all lights, which scales the records."""
        view = self.state.view
        if view.subject[1:] != self.state.view_subject:
            return view
        subject = view.subject[0], *replace(self.state, scene=after.scene).view_subject
        return replace(view, subject=subject, settled=False, stalled_rounds=0, examined=())

    def forget(self, shadows: bool) -> None:
        """Draw every buffer of the view again next time; the shadow maps only with `shadows`."""
        self.refiner.leave()
        self.stages.forget(shadows=shadows)
        self.small.forget(shadows=shadows)
        self.state = replace(self.state, view=ViewState())


def divisor_after(divisor: int, took: float, seconds: float) -> int:
    """Return the divisor of the next view, where the last one took so many seconds to draw, in a tick of `seconds`.

    The time is taken as proportional to the number of pixels. A part of it is not: a smaller picture takes longer than expected,
    and a larger one less. So the divisor may grow again in the next view, and never alternates.
    """
    share = max(_DRAWN * seconds, 1e-9)  # a tick without any time draws the smallest picture
    if took > share:
        return min(_SMALLEST, math.ceil(divisor * math.sqrt(took / share)))
    return min(divisor, max(1, math.ceil(divisor * math.sqrt(took / (_MARGIN * share)))))
