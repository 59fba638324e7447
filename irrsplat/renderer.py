"""The frame: shadows, g-buffer, then splat, examine and gather until every pixel is served, then direct and composite.

This is the only place where the passes meet; read `Renderer.frame` first.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Unpack, cast

import moderngl
import numpy as np

from irrsplat.core import files
from irrsplat.core.buffers import GBuffer, ShadowMaps, SplatBuffer
from irrsplat.core.errors import InputError
from irrsplat.gpu import context, program
from irrsplat.gpu.geometry import Geometry
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.image.antialias import Antialiaser, FrameInputs, FramePasses, OnProgress
from irrsplat.image.composite import CompositePass
from irrsplat.image.figures.paper_figures import PaperFigures
from irrsplat.image.frame import Frame
from irrsplat.image.gbuffer import GBufferPass
from irrsplat.image.statistics import Statistics, describe
from irrsplat.image.view import Progress, View, read, sample_progress
from irrsplat.indirect.scheduler import RecordScheduler, RoundResult
from irrsplat.indirect.splat_buffer import Splatting
from irrsplat.lighting import gl_limits
from irrsplat.lighting.direct import DirectPass
from irrsplat.lighting.light_table import light_defines
from irrsplat.lighting.shadow_maps import ShadowPass
from irrsplat.records import cache_file
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.flatten import flatten
from irrsplat.scene.model import Camera, Light, Scene
from irrsplat.scene.motion import moved
from irrsplat.settings import Settings, SettingValues
from irrsplat.settings import preset as settings_of

_IDLE = 8  # rounds without any gain in coverage after which nothing more is to be hoped for
_RENEWAL = 0.6  # of the time for gathering that stale records may take where new ones are wanted too


class Renderer(Owner):
    """Renders views of one scene and keeps the irradiance records that they asked for.

    scene: what `irrsplat.load` returns. size: (width, height) in pixels. preset: a name of settings.PRESETS, and any
    setting by name on top of it. ctx: a moderngl context to use, which its owner makes current (default: a new one without a
    window, current after every call).
    Raises InputError for a size or setting that cannot be, GLError where there is no OpenGL 3.3.
    Use it in a `with` block, or call `release`, to free what it holds on the GPU.
    """

    def __init__(
        self,
        scene: Scene,
        size: tuple[int, int] = (800, 800),
        preset: str = "default",
        ctx: moderngl.Context | None = None,
        **settings: Unpack[SettingValues],
    ) -> None:
        if not isinstance(scene, Scene):
            raise InputError(f"a Renderer takes a Scene, as irrsplat.load returns it, not {type(scene).__name__}")
        self.scene, self._loaded = scene, scene.meshes
        self.settings: Settings = settings_of(preset, **settings)
        self.preset = preset
        self.size = gl_limits.checked(size)
        self._owns_ctx = ctx is None
        self.ctx = ctx or context.create()
        self.about = context.describe(self.ctx)
        gl_limits.check(self.ctx, self.size, scene, self.settings.shadow_size)
        self.timers = Timers(self.ctx, self.about["software"], enabled=True)
        self.geometry = Geometry(self.ctx, *flatten(scene))
        self.cache = RecordCache(self.ctx)
        self.shadow_pass = ShadowPass(self.ctx)
        self.gbuffer_pass = GBufferPass(self.ctx, self.size)
        self.splatting = Splatting(self.ctx, self.size, self.settings, self.timers)
        self.scheduler = RecordScheduler(self.ctx, scene, self.size, self.settings, self.geometry, self.cache, self.timers)
        self.direct_pass = DirectPass(self.ctx, self.size, light_defines(scene))
        self.composite_pass = CompositePass(self.ctx, self.size)
        self.accumulator = Antialiaser(self.ctx, self.timers)
        self._made_of: dict[str, tuple[Any, ...]] = {}  # what each stage's present result was made of
        self.shadows: ShadowMaps | None = None  # the present ones
        self._gbuffer: Any = None  # a GBuffer
        self._direct: moderngl.Texture | None = None
        self._view: View | None = None
        self._settled: tuple[Any, ...] | None = None  # the state of the splat buffer that asks for nothing
        self._round = 0  # whole ones of this view
        self._coverage = 0.0  # at the present round's begin
        self._idle = 0  # rounds that gained nothing
        self._reserve = 0.0, 0.0  # seconds that splatting, and all that follows gathering, took in the last tick

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        passes = self.shadow_pass, self.gbuffer_pass, self.direct_pass, self.composite_pass
        return (self.geometry, self.cache, self.splatting, self.scheduler, self.accumulator, *passes)

    # ---- the frame -------------------------------------------------------------------------------------------------

    def _use(self) -> None:
        """Make this renderer's own OpenGL context the current one; a given one is its owner's to make current."""
        if self._owns_ctx:
            self.ctx.__enter__()

    def _other(self, stage: str, *made_of: Any) -> bool:
        """Whether the stage's present result was made of anything else than this, and is to be made again."""
        same = self._made_of.get(stage) == made_of
        self._made_of[stage] = made_of
        return not same

    def frame(
        self, camera: Camera | str | None = None, seconds: float | None = None, gather: bool = True
    ) -> tuple[View, Progress]:
        """One round: draw what the camera sees, splat what is new, and gather where nothing speaks for a pixel yet.

        seconds: the wall time that all of it may take; what does not fit is gathered in the next call (None: a whole round).
        gather: False leaves the cache as it is. What has not changed since the last call is not drawn again.
        """
        self._use()
        self.timers.clear()
        budget = Budget(seconds)
        progress = self._advance(self.scene.camera(camera), budget, gather)
        start = time.perf_counter()
        view = self._compose()
        if budget.limited:
            self.ctx.finish()
            self._reserve = self._reserve[0], time.perf_counter() - start
        return view, progress

    def _advance(self, camera: Camera, budget: Budget, gather: bool = True) -> Progress:
        """All of a round but the picture."""
        shadows = self._lit()
        gbuffer = self._seen(camera)
        bounces, renewed = self.settings.most_bounces > 0, 0
        ready = gather and bounces and self.scheduler.ready(shadows, budget.part(1.0, sum(self._reserve)))
        if ready:
            share = 1.0 if self._coverage == 1.0 else _RENEWAL
            renewed = self.scheduler.renew(shadows, gbuffer, camera, budget.part(share, sum(self._reserve)))
        start = time.perf_counter()
        self.scheduler.adapt()
        if self._idle >= _IDLE and self.splatting.refine():
            self._idle = 0
        splats = self.splatting(self.cache, gbuffer, camera, self.settings, self._made_of["gbuffer"])
        self._reserve = time.perf_counter() - start, self._reserve[1]
        asked = RoundResult(0, 0.0, True)
        if not bounces:
            self._coverage = 1.0
        elif not ready:
            if self._other("looked at", self.splatting.state, self.settings.asking):
                self._coverage = 1.0 - self.scheduler.missing(gbuffer, splats, self.splatting.every)
            asked = RoundResult(0, 0.0, gather or not self.splatting.refine())
        elif self._idle < _IDLE and (self.splatting.state, self.settings.asking) != self._settled:
            asked = self._ask(gbuffer, splats, shadows, camera, budget)
        stale, made = (len(self.cache.stale), self.scheduler.bounced) if bounces else (0, 1.0)
        full = self.scheduler.full
        return Progress(self._round, self.cache.count, asked.new, self._coverage, renewed, stale, asked.complete, made, full)

    def _lit(self) -> ShadowMaps:
        """The shadow maps, drawn again only for other lights."""
        if self._other("shadow", self.scene.lights, self.settings.shadow_size) or self.shadows is None:
            with self.timers("shadow"):
                self.shadows = self.shadow_pass(self.scene, self.geometry, self.settings.shadow_size)
        return self.shadows

    def _seen(self, camera: Camera) -> GBuffer:
        """The g-buffer, drawn again only for another camera."""
        if self._other("gbuffer", camera, self.size) or self._gbuffer is None:
            with self.timers("gbuffer"):
                self._gbuffer = self.gbuffer_pass(self.scene, self.geometry, camera)
            self.scheduler.new_view()
            self.splatting.start(self.settings)
            self._round, self._coverage, self._idle = 0, 0.0, 0
        return self._gbuffer

    def _ask(self, gbuffer: GBuffer, splats: SplatBuffer, shadows: ShadowMaps, camera: Camera, budget: Budget) -> RoundResult:
        """Gather where the view lacks records, as far as the budget goes."""
        asked = self.scheduler.ask(gbuffer, splats, shadows, camera, budget.part(1.0, self._reserve[1]), self.splatting.every)
        before, self._coverage = self._coverage, 1.0 - asked.missing
        if asked.complete:
            self._idle = 0 if self._coverage > before else self._idle + 1
            self._round += 1
            if not asked.new:
                limited = self.scheduler.adapt(last=True)
                if self.splatting.refine() or limited:
                    return replace(asked, complete=False)
                self._settled = self.splatting.state, self.settings.asking
        return asked

    def _compose(self) -> View:
        """The picture from what there is: direct light, normalised indirect light, their blend."""
        (camera, _), gbuffer = self._made_of["gbuffer"], self._gbuffer
        splats = self.splatting.whole(self.cache, gbuffer, camera)
        if self._other("direct", self._made_of["gbuffer"], self._made_of["shadow"]) or self._direct is None:
            with self.timers("direct"):
                self._direct = self.direct_pass(gbuffer, self._lit())
        settings, state = self.settings, (self._made_of["direct"], self.splatting.state)
        filling = settings.fill_holes and self._coverage < 1.0 and settings.most_bounces > 0
        if self._other("composite", *state, settings.blend, settings.smooth, filling) or self._view is None:
            with self.timers("composite"):
                image, sums = self.composite_pass(splats, self._direct, gbuffer, self.scene.sky, camera, settings, filling)
            self._view = View(camera, gbuffer, self._direct, splats, sums, image)
        return self._view

    def accumulate(self, view: View, samples: int, seconds: float | None = None, told: OnProgress | None = None) -> View:
        """The `view` that `frame` gave last, with `samples` a pixel, or as many more than last time as `seconds` allow, one at
        least; the cache is left as it is. told: called with the share done, 0..1, after each."""
        self._use()
        passes = FramePasses(self.gbuffer_pass, self.splatting.splat_pass, self.direct_pass, self.composite_pass)
        seen = FrameInputs(self.scene, self.geometry, self._lit(), self.cache, self.settings)
        return self.accumulator(view, samples, Budget(seconds), passes, seen, told)

    # ---- what changes ----------------------------------------------------------------------------------------------

    def change(self, settings: Settings, preset: str = "") -> None:
        """Go on with other settings (called `preset` in the stats): what depends on those that differ is made again, records in
        place; they are forgotten only where their places depend on one. Raises InputError for what OpenGL does not take here."""
        self._use()
        gl_limits.check(self.ctx, self.size, self.scene, settings.shadow_size)
        if settings.gradients != self.settings.gradients:
            self.splatting.release()
            self.splatting = Splatting(self.ctx, self.size, settings, self.timers)
        self.splatting.start(settings)
        self.settings, self.preset, self._idle = settings, preset or self.preset, 0
        self.scheduler.change(settings, self.scene)

    def relight(self, lights: Sequence[Light]) -> None:
        """Go on with other lights; records are gathered again in place. Raises InputError for too many of them."""
        self._go_on(replace(self.scene, lights=tuple(lights)))

    def move(self, mesh: int | str, transform: Any) -> None:
        """Go on with a mesh (its index in scene.meshes, or its name) where a 4×4 or 3×4 matrix takes it from where it was loaded.

        Records on it move along; those close to it, before or after, are made anew; of the others those that it concerns are
        gathered again in place. Raises InputError for a mesh that is not there, and a matrix that is not affine, or singular.
        """
        self._go_on(moved(self.scene, self._loaded, mesh, transform))

    def _go_on(self, scene: Scene) -> None:
        """Go on with the same scene, lit otherwise, or with meshes elsewhere."""
        self._use()
        gl_limits.check(self.ctx, self.size, scene, self.settings.shadow_size)
        before, self.scene, self._idle = self.scene, scene, 0
        self.splatting.start(self.settings)
        self.scheduler.change(self.settings, scene, self.shadows)  # which looks once more at what was there before
        self.direct_pass.fit(light_defines(scene))
        if before.meshes is not scene.meshes:
            self.geometry.update(*flatten(scene)[:2])
            self.forget(records=False)

    def resize(self, size: tuple[int, int]) -> None:
        """Views are of another size (width, height) from now on; the records stay. Raises InputError for one that cannot be."""
        self._use()
        size = gl_limits.checked(size)
        gl_limits.check(self.ctx, size, self.scene, self.settings.shadow_size)
        self.size = size
        for one in (self.gbuffer_pass, self.splatting, self.direct_pass, self.composite_pass):
            one.release()
        self.gbuffer_pass = GBufferPass(self.ctx, self.size)
        self.splatting = Splatting(self.ctx, self.size, self.settings, self.timers)
        self.direct_pass = DirectPass(self.ctx, self.size, light_defines(self.scene))
        self.composite_pass = CompositePass(self.ctx, self.size)
        self.scheduler.resize(self.size)
        self._gbuffer = self._direct = self._view = None

    def reload(self) -> None:
        """Read the shaders' files again and draw with them; raises ShaderError, and goes on as before, where one is wrong."""
        self._use()
        program.reload(program.programs_of(self))
        self.renew()

    def renew(self) -> None:
        """Draw everything again, and gather all records again in place."""
        self.scheduler.expire()
        self.forget(records=False)

    def forget(self, records: bool = True, lights: bool = True) -> None:
        """Draw every buffer of the view again next time; without the `records` made so far, and the `lights`' shadow maps."""
        self._made_of = {stage: key for stage, key in self._made_of.items() if stage == "shadow" and not lights}
        self._settled = None
        self.splatting.forget()
        if records:
            self.cache.truncate(0)

    # ---- files -----------------------------------------------------------------------------------------------------

    def save_cache(self, path: files.Pathlike) -> None:
        """Write the records to a file, whole or not at all; `load_cache` goes on from it bit for bit, as if nothing had happened.

        Raises InputError where `path` cannot be written to, IrrsplatError where writing fails.
        """
        self._use()
        files.check_file(path)
        scheduler = self.scheduler
        # a change of the scene or the surface cache that the records have not been held against yet: all of them are stale then
        stale = scheduler.moved or (scheduler.resumed is None and scheduler.bounced < 1.0)
        state = cache_file.CacheState(
            self.cache.state(stale), scheduler.adaptation.state(), scheduler.bounces(scheduler.settings)
        )
        cache_file.write(path, cache_file.key(scheduler.scene, scheduler.settings), state)

    def load_cache(self, path: files.Pathlike) -> None:
        """Take the records of a file in place of those that there are.

        Raises InputError, and changes nothing, where it is missing, no record cache or damaged, or where its records belong to
        another scene, other lights or other settings than this renderer's (those that cache_file.key lists).
        """
        self._use()
        scheduler = self.scheduler
        state = cache_file.read(path, cache_file.key(scheduler.scene, scheduler.settings))
        self.cache.restore(state.records)
        scheduler.adaptation.restore(state.adapted, scheduler.settings)
        scheduler.resume(dict(state.bounces))
        self.forget(records=False)

    # ---- whole renders ---------------------------------------------------------------------------------------------

    def converge(
        self, camera: Camera | str | None = None, progress: Callable[[Progress], None] | None = None
    ) -> tuple[View, Statistics]:
        """Rounds until the examination finds nothing, or `max_rounds`; returns the view and its statistics.

        "seconds" among them is the wall time to full coverage, before direct light and composite. progress is called after
        each round. Ctrl-C ends the rounds: the last whole one counts, "interrupted" is True.
        """
        self._use()
        camera = self.scene.camera(camera)
        self.timers.clear()
        self._idle, start = 0, time.perf_counter()
        stats: Statistics = {"rounds": 0, "converged": False, "full": False, "interrupted": False, "coverage": 0.0}
        whole, ended, budget = self.cache.count + self.cache.evicted, False, Budget(None)
        try:
            while not ended and stats["rounds"] < self.settings.max_rounds and self._idle < _IDLE:
                now = self._advance(camera, budget)
                whole, ended = self.cache.count + self.cache.evicted, now.new == 0 and now.complete
                stats["rounds"] += 1
                stats["coverage"], stats["full"], stats["converged"] = now.coverage, now.full, ended and not now.full
                if progress is not None:
                    progress(now)
        except KeyboardInterrupt:
            stats["interrupted"] = True
            self.cache.truncate(whole - self.cache.evicted)
        if not stats["converged"]:  # what the last round gathered is still to be splatted
            self.scheduler.adapt(last=True)
            self.splatting.refine()
            stats["coverage"] = self._advance(camera, budget, gather=False).coverage
        self.ctx.finish()
        stats |= {"records": self.cache.count, "seconds": time.perf_counter() - start}
        return self._compose(), stats

    def render(
        self,
        camera: Camera | str | None = None,
        progress: Callable[[Progress], None] | None = None,
        figures: bool = False,
    ) -> Frame:
        """The view from `camera` (or the scene's of that name; default: its first), refined until every pixel is served.

        Returns a Frame of numpy arrays that the caller owns. Records of earlier views are used again: only what is new is
        gathered. progress is called after each round. figures: fill Frame.figures with the paper's figures 1, 3 and 4 too.
        Ctrl-C ends the rounds, or the samples, early: stats["converged"] is False then.
        """
        album = PaperFigures(self._splatted, progress)
        view, stats = self.converge(camera, album if figures else progress)
        view = self.accumulate(view, 1 if stats["interrupted"] else self.settings.samples, told=sample_progress(progress, stats))
        if view.samples < self.settings.samples:  # Ctrl-C
            stats |= {"interrupted": True, "converged": False}
        frame = read(view, self.scene.sky, self.cache.read(), stats | self.stats(view))
        return replace(frame, figures=album.figures(frame, view.camera, self.settings)) if figures else frame

    def _splatted(self, count: int) -> np.ndarray:
        """The sums of the first so many records (H, W, 4), of every pixel of the present view."""
        records = replace(self.cache.records, count=count)
        return self.splatting.read(records, self._gbuffer, self._made_of["gbuffer"][0], self.settings)

    def stats(self, view: View) -> Statistics:
        """What is known of the view's picture, the rounds that led to it aside."""
        exposure, settings = self.settings.exposure, self.settings
        stops = self.composite_pass.exposure(view.image) if exposure == "auto" else float(exposure)
        made: Statistics = {"samples": view.samples, "stages_ms": self.timers.milliseconds(), "clock": self.timers.clock}
        made |= cast(Statistics, self.scheduler.bounces(settings))
        return made | describe(self.about, self.scene, self.size, self.preset, settings, stops)

    def release(self) -> None:
        """Free everything on the GPU, the context too where this renderer made it."""
        if self._owns_ctx:
            self.ctx.release()
        else:
            super().release()


def render(
    scene: Scene,
    size: tuple[int, int] = (800, 800),
    camera: Camera | str | None = None,
    preset: str = "default",
    **settings: Unpack[SettingValues],
) -> Frame:
    """One view of `scene`, headless, refined until every pixel is served; arguments and errors as `Renderer`."""
    with Renderer(scene, size, preset, **settings) as renderer:
        return renderer.render(camera)
