"""The frame: shadows, g-buffer, then splat, examine and gather until every pixel is served, then direct light and composite.

This is the only place where the stages meet; read `Renderer.frame` first, and `Renderer._refine`, which is all of it but the
picture.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Unpack, cast

import moderngl
import numpy as np
import numpy.typing as npt

from irrsplat.core import files
from irrsplat.core.buffers import GBuffer, ShadowMaps, SplatBuffer
from irrsplat.core.errors import InputError
from irrsplat.core.memo import Memo
from irrsplat.gpu import context, program, self_test
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.target import pixels
from irrsplat.gpu.time_budget import Budget, now
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.image.antialias import Antialiaser, FrameInputs, FramePasses, OnProgress
from irrsplat.image.backdrop import backdrop_of
from irrsplat.image.composite import CompositePass
from irrsplat.image.emitter_light import EmitterLightPass
from irrsplat.image.figures.paper_figures import PaperFigures
from irrsplat.image.frame import Frame, check_names
from irrsplat.image.gbuffer import GBufferPass
from irrsplat.image.statistics import Statistics, describe
from irrsplat.image.texture_maps import TextureMaps
from irrsplat.image.view import Progress, View, read, sample_progress
from irrsplat.indirect.refinement import Refinement, Refiner
from irrsplat.indirect.scheduler import NOTHING_ASKED, RecordScheduler, RoundResult
from irrsplat.indirect.splat_buffer import ViewSplats, first_stride
from irrsplat.indirect.temporal_filter import TemporalFilter
from irrsplat.indirect.view_state import ViewState
from irrsplat.lighting import gl_limits
from irrsplat.lighting.direct import DirectPass, Headlamp
from irrsplat.lighting.emitter_table import emitter_table
from irrsplat.lighting.light_table import light_defines
from irrsplat.lighting.shadow_maps import ShadowPass
from irrsplat.lighting.sky import sky_maps
from irrsplat.records import cache_file
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.change import SceneChange, is_elsewhere
from irrsplat.scene.model import Camera, Light, Material, Mesh, Scene
from irrsplat.scene.motion import moved, repainted
from irrsplat.settings import Settings, SettingValues
from irrsplat.settings import preset as settings_of

_PICTURE_SHARE = 2.0  # how many times as long as a picture takes pass before the next one, while a view fills in ticks
_OLDEST_PICTURE = 0.3  # seconds after which the next one comes in any case
_TOLD = 1.0  # seconds after which progress is told while a render is refined
_RENEWAL = 0.6  # of the time for gathering that stale records may take while pixels without a record wait too


@dataclass(frozen=True)
class Costs:
    """Seconds that parts of a limited tick took when they were last done: splatting, and the picture with direct light."""

    splat: float = 0.0
    picture: float = 0.0


@dataclass(frozen=True)
class Shown:
    """The last picture: of what it is, apart from the records, and how many seconds of ticks ago it was made."""

    view: View
    subject: tuple[object, ...]
    age: float = 0.0


@dataclass(frozen=True)
class State:
    """What a renderer shows, and how far it has come: the one value that changes from frame to frame.

    view: the progress of the present view. shown: None before the first picture. headlamp: W/sr of the lamp at the eye.
    refinement: of the present view, None while it is as its settings have it.
    """

    scene: Scene
    settings: Settings
    preset: str
    size: tuple[int, int]
    view: ViewState = ViewState()
    costs: Costs = Costs()
    shown: Shown | None = None
    headlamp: float = 0.0
    refinement: Refinement | None = None


@dataclass(frozen=True)
class Round:
    """What one round of a view leaves for its picture. sparing: nothing but the picture is wanted, and the splat buffer is freed
    once it is made of another."""

    camera: Camera
    shadows: ShadowMaps
    gbuffer: GBuffer
    splats: SplatBuffer
    progress: Progress
    sparing: bool = False


class Renderer(Owner):
    """Renders views of one scene and keeps the irradiance records that they asked for.

    scene: what `irrsplat.load` returns. size: (width, height) in pixels. preset: a name of settings.PRESETS, and any
    setting by name on top of it. ctx: a moderngl context to use, which its owner makes current (default: a new one without a
    window, current after every call).
    Raises InputError for a size or setting that cannot be, GLError where there is no OpenGL 3.3, or one
    that fails the self-test.
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
        self._state = State(scene, settings_of(preset, **settings), preset, gl_limits.checked(size))
        self._loaded = scene.meshes  # as they were before any of them moved
        self._owns_ctx = ctx is None
        self.ctx = ctx or context.create()
        self.about = context.describe(self.ctx)
        self_test.check(self.ctx)
        gl_limits.check(self.ctx, self.size, scene, self.settings.shadow_size)
        gl_limits.check_memory(self.size, self.scene, self.settings, self.about["software"])
        self.timers = Timers(self.ctx, bool(self.about["software"]), enabled=True)
        self.world = World(self.ctx, scene, self.settings.texture_memory)
        self.cache = RecordCache(self.ctx)
        self.scheduler = RecordScheduler(self.world, self.settings, self.cache, self.timers)
        self.antialiaser = Antialiaser(self.ctx, self.timers)
        self._passes = Workshop()  # those that depend on size, lights or settings
        self._memo = Memo()  # the results of the stages that are drawn whole

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees; the context is apart."""
        return (self.world, self.cache, self.scheduler, self.antialiaser, self._passes)

    def release(self) -> None:
        """Free everything on the GPU, the context too where this renderer made it."""
        if self._owns_ctx:
            self.ctx.release()
        elif not context.is_gone(self.ctx):
            super().release()

    # ---- what it is about ------------------------------------------------------------------------------------------

    @property
    def scene(self) -> Scene:
        """The scene as it is now: its lights and meshes may have changed since it was loaded."""
        return self._state.scene

    @property
    def settings(self) -> Settings:
        """The present settings."""
        return self._state.settings

    @property
    def preset(self) -> str:
        """What the settings are called."""
        return self._state.preset

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a view in pixels."""
        return self._state.size

    @property
    def shadows(self) -> ShadowMaps | None:
        """The shadow maps of the scene as it is now; None before they are drawn."""
        current = self._memo.holds("shadows", self._shadow_inputs)
        return self._memo.current("shadows", ShadowMaps) if current else None

    @property
    def _shadow_inputs(self) -> tuple[object, ...]:
        return self.scene.lights, self.scene.meshes, self.settings.shadow_size

    @property
    def gbuffer(self) -> GBuffer | None:
        """The g-buffer of the present view; None before it is drawn."""
        return self._memo.current("gbuffer", GBuffer)

    @property
    def headlamp(self) -> float:
        """The radiant intensity of the lamp at the eye, W/sr; 0: there is none."""
        return self._state.headlamp

    def _headlamp_of(self, camera: Camera) -> Headlamp | None:
        return Headlamp(camera.eye, self.headlamp) if self.headlamp else None

    @property
    def shadow_pass(self) -> ShadowPass:
        """Draws the shadow maps."""
        return self._passes.get("shadows", (), lambda: ShadowPass(self.ctx))

    @property
    def gbuffer_pass(self) -> GBufferPass:
        """Draws g-buffers of the present size."""
        maps = self.texture_maps
        return self._passes.get("gbuffer", (self.size, maps), lambda: GBufferPass(self.ctx, self.size, maps))

    @property
    def texture_maps(self) -> TextureMaps:
        """The images that the g-buffer's surfaces wear, within the settings' memory."""
        memory = self.settings.texture_memory
        return self._passes.get("textures", memory, lambda: TextureMaps(self.ctx, memory))

    @property
    def notices(self) -> tuple[str, ...]:
        """One-line remarks for a user on what cannot be shown of the scene as it is; the scene has notices of its own."""
        return *self.texture_maps.notices(self.world.runs), *self.world.materials.notices

    @property
    def splats(self) -> ViewSplats:
        """Keeps the splat buffer of the present view."""
        made_of = self.size, self.settings.gradients
        return self._passes.get("splats", made_of, lambda: ViewSplats(self.ctx, *made_of, self.timers))

    @property
    def refiner(self) -> Refiner:
        """Refines the present view while it rests."""
        made_of = self.size, self.settings.gradients
        return self._passes.get("refiner", made_of, lambda: Refiner(self.ctx, *made_of, self.scheduler, self.timers))

    @property
    def direct_pass(self) -> DirectPass:
        """Draws direct light of the present size, by such lights as there are."""
        defines = light_defines(self.scene)
        return self._passes.get("direct", (self.size, defines), lambda: DirectPass(self.ctx, self.size, defines))

    def lamp_irradiance(self, camera: Camera | str | None = None) -> np.ndarray:
        """(H, W, 3) W/m², top row first: the irradiance of the scene's lamps at pixels' centres, without the headlamp, whatever
        the surface reflects; 0 where none is seen. camera: as for `render`."""
        self._use()
        seen = self.scene.camera(camera)
        found: np.ndarray = pixels(self._lamp_irradiance(self.draw_gbuffer(seen)))[..., :3].copy()
        return found

    def direct_irradiance(self, view: View) -> moderngl.Texture:
        """The irradiance of the scene's lamps at every pixel of the present `view`, W/m², without the headlamp: a texture."""
        return self._lamp_irradiance(view.gbuffer)

    def _lamp_irradiance(self, gbuffer: GBuffer) -> moderngl.Texture:
        size, defines, shadows = gbuffer.position.size, light_defines(self.scene), self.draw_shadows()
        lamps = self._passes.get(
            "direct irradiance", (size, defines), lambda: DirectPass(self.ctx, size, defines, irradiance=True)
        )
        return self._memo.get("direct irradiance", (gbuffer, shadows, lamps), lambda: lamps(gbuffer, shadows))

    @property
    def emitter_pass(self) -> EmitterLightPass | None:
        """Samples the light of emitters at pixels of the present size; None where the records hold it, or there are none."""
        if not self.settings.emitters_apart or not self.settings.most_bounces or emitter_table(self.world) is None:
            return None
        defines = self.world.material_defines
        return self._passes.get("emitters", self.size, lambda: EmitterLightPass(self.ctx, self.size, defines))

    @property
    def composite_pass(self) -> CompositePass:
        """Makes pictures of the present size."""
        return self._passes.get("composite", self.size, lambda: CompositePass(self.ctx, self.size))

    @property
    def temporal_filter(self) -> TemporalFilter:
        """Blends the irradiance of pictures of the present size with that of those before."""
        return self._passes.get("temporal", self.size, lambda: TemporalFilter(self.ctx, self.size))

    def _use(self) -> None:
        """Make this renderer's own OpenGL context the current one; a given one is its owner's to make current."""
        context.check_alive(self.ctx)
        if self._owns_ctx:
            context.make_current(self.ctx)

    # ---- the frame -------------------------------------------------------------------------------------------------

    def frame(
        self, camera: Camera | str | None = None, seconds: float | None = None, gather: bool = True
    ) -> tuple[View, Progress]:
        """One round: draw what the camera sees, splat what is new, gather where no record speaks for a pixel yet, and composite.

        seconds: the wall time that all of it may take; what does not fit is gathered in the next call (None: a complete round).
        gather: False leaves the cache as it is. What has not changed since the last call is not drawn again. While new records
        are all that changes, and pictures take much of the `seconds`, some ticks only gather and return the last view.
        """
        self._use()
        self.timers.clear()
        budget, camera = Budget(seconds), self.scene.camera(camera)
        if self._state.refinement is not None:
            if self._rests(camera):
                return self._refined_view(camera)
            self._leave_refinement()
        start = now()
        shown = self._state.shown if gather and budget.limited and self._picture_may_wait(camera) else None
        done = self._refine(camera, budget, gather, picture=shown is None)
        if budget.limited:
            self.ctx.finish()
        if shown is not None and not done.progress.still:
            older = replace(shown, age=shown.age + now() - start)
            self._state = replace(self._state, shown=older)
            return shown.view, done.progress
        start = now()
        view = self._picture(done, fading=budget.limited and self.settings.fade)
        if budget.limited and (self._state.shown is None or view is not self._state.shown.view):
            self.ctx.finish()
            self._state = replace(self._state, costs=replace(self._state.costs, picture=now() - start))
        self._state = replace(self._state, shown=Shown(view, self._subject(camera)))
        return view, replace(done.progress, fading=view.fading)

    def refine(self, camera: Camera | str | None, target: float, seconds: float | None = None) -> tuple[View, Progress]:
        """Go on with a view that `frame` or `converge` found complete: records are added and gathered more finely until its
        estimated error, the relative RMSE of indirect irradiance, is at most `target`; the view, and how far it has come.

        seconds: the wall time that this may take; None: until it is done. The picture changes a step at a time. The records that
        are added go when anything else is shown. A view by the paper's placement, or without bounces, is left as it is.
        """
        self._use()
        budget, camera = Budget(seconds), self.scene.camera(camera)
        if self._state.refinement is None or not self._rests(camera):
            if self._view_state(camera) is not self._state.view or self._state.view.pixel_stride > 1 or not self.can_refine:
                return self.frame(camera, seconds)
            splats = self.splats.update(self.cache, self.draw_gbuffer(camera), camera, self.settings, 1)
            self._state = replace(self._state, refinement=self.refiner.begin(splats, camera))
        shadows, gbuffer, step = self.draw_shadows(), self.draw_gbuffer(camera), self._state.refinement
        assert step is not None
        try:
            while True:
                step = self.refiner.advance(step, target, gbuffer, shadows, budget)
                self._state = replace(self._state, refinement=step)
                if step.ended or budget.left <= 0.0:
                    break
        except BaseException:  # what the cache holds is no longer what the step says: it is not gone on with
            self._state = replace(self._state, refinement=replace(step, ended=True, check=None))
            raise
        return self._refined_view(camera)

    @property
    def can_refine(self) -> bool:
        """Whether `refine` has anything to do in views by these settings."""
        return self.settings.placement == "tiles" and self.settings.most_bounces > 0

    def _rests(self, camera: Camera) -> bool:
        """Whether the view that is refined is the one of `camera`, with nothing of it changed."""
        return self._view_state(camera) is self._state.view and not len(self.cache.stale)

    def _refined_view(self, camera: Camera) -> tuple[View, Progress]:
        """The picture of a refined view, and how far it has come."""
        refined, state = self._state.refinement, self._state.view
        assert refined is not None
        full = state.full or self.scheduler.room == 0
        progress = Progress(
            state.rounds, self.cache.count, 0, state.coverage, full=full, error=refined.last_error, refined=refined.ended
        )
        done = Round(camera, self.draw_shadows(), self.draw_gbuffer(camera), refined.splats, progress)
        return self._picture(done), progress

    def _leave_refinement(self) -> None:
        """Go back to the view as its settings have it."""
        if self._state.refinement is not None:
            self.refiner.leave(self._state.refinement)
            self._state = replace(self._state, refinement=None)

    def _subject(self, camera: Camera) -> tuple[object, ...]:
        """All that a picture is made of but the records."""
        scene = self.scene
        return camera, self.size, scene.lights, scene.sky_parts, scene.meshes, self.settings, self.headlamp

    def _picture_may_wait(self, camera: Camera) -> bool:
        """Whether the last picture stays for another tick, so that pictures take but a share of the time while they change by
        nothing but new records."""
        shown = self._state.shown
        if shown is None or shown.subject != self._subject(camera) or self._memo.current("picture", View) is not shown.view:
            return False
        return shown.age < min(_PICTURE_SHARE * self._state.costs.picture, _OLDEST_PICTURE)

    def _refine(self, camera: Camera, budget: Budget, gather: bool = True, picture: bool = True) -> Round:
        """A round without its picture: every stage with what it depends on, in the paper's order. picture: time is kept back
        for one."""
        scheduler, settings, costs = self.scheduler, self.settings, self._state.costs
        later = costs.picture if picture else 0.0  # seconds
        scheduler.follow(settings, self.scene, self.shadows)
        shadows = self.draw_shadows()
        gbuffer = self.draw_gbuffer(camera)
        state = self._view_state(camera)

        bounces = settings.most_bounces > 0
        ready = gather and bounces and scheduler.prepare(shadows, budget.part(1.0, costs.splat + later))
        renewed = 0
        if ready:
            share = 1.0 if state.coverage == 1.0 else _RENEWAL
            renewed = scheduler.renew(shadows, gbuffer, camera, budget.part(share, costs.splat + later))
        if renewed or len(self.cache.stale):
            state = replace(state, stalled_rounds=0)  # what stalled by the old light may be served by the new
        start = now()
        state, _ = scheduler.limit_radii(state)
        if state.stalled and state.pixel_stride > 1:
            state = replace(state, pixel_stride=1, stalled_rounds=0)
        splats = self.splats.update(self.cache, gbuffer, camera, settings, state.pixel_stride)
        costs = replace(costs, splat=now() - start)

        requests = NOTHING_ASKED
        if not bounces:
            state = replace(state, coverage=1.0)
        elif not ready:
            state, requests = self._look_only(state, gbuffer, splats, gather)
        elif not state.stalled and state.settled != (splats, settings.asking):
            state, requests = scheduler.gather_missing(state, gbuffer, splats, shadows, camera, budget.part(1.0, later))
        if requests.new and picture and budget.limited and len(self.cache.stale):  # a frame later, what moves has moved on
            splats = self.splats.update(self.cache, gbuffer, camera, settings, state.pixel_stride)
        self._state = replace(self._state, view=state, costs=costs)

        waiting = self.cache.waiting
        if ready and budget.limited and not requests.new and not renewed:
            scheduler.gatherer.learn(shadows, budget.part(1.0, later))
            waiting += scheduler.gatherer.to_learn
        stale, made = (waiting, scheduler.gatherer.surface_share) if bounces else (0, 1.0)
        progress = Progress(
            state.rounds, self.cache.count, requests.new, state.coverage, renewed, stale, requests.complete, made, state.full
        )
        return Round(camera, shadows, gbuffer, splats, progress)

    def draw_shadows(self) -> ShadowMaps:
        """The shadow maps: by the lights, the meshes and the maps' size."""
        side = self.settings.shadow_size

        def draw() -> ShadowMaps:
            with self.timers("shadow"):
                return self.shadow_pass(self.world, side)

        return self._memo.get("shadows", self._shadow_inputs, draw)

    def draw_gbuffer(self, camera: Camera) -> GBuffer:
        """What `camera` sees: by the camera, the meshes, the size and the textures."""
        scene = self.scene

        def draw() -> GBuffer:
            with self.timers("gbuffer"):
                return self.gbuffer_pass(self.world, camera)

        return self._memo.get("gbuffer", (camera, scene.meshes, self.size, *self.settings.of("gbuffer")), draw)

    def _view_state(self, camera: Camera) -> ViewState:
        """How far this view has come; a new one begins where anything differs that decides which records it asks for."""
        subject, settings, state = self._view_subject(self._state), self.settings, self._state.view
        if state.camera == camera and state.subject == subject:
            return state
        # coarse splats are interpolated between pixels, which would lose what normal maps add
        whole = any(run.look.normal is not None for run in self.world.runs)
        return ViewState(camera, subject, 1 if whole else first_stride(settings, self.size))

    @staticmethod
    def _view_subject(state: State) -> tuple[object, ...]:
        """What decides which records a view asks for, apart from its camera."""
        scene, settings = state.scene, state.settings
        criteria = (
            *settings.of("shadow", "gather", "splat"),
            settings.asking,
            settings.placement,
            settings.warmup,
            settings.emitters_apart,
        )
        return state.size, scene.meshes, scene.lights, scene.sky_parts, criteria

    def _look_only(self, state: ViewState, gbuffer: GBuffer, splats: SplatBuffer, gather: bool) -> tuple[ViewState, RoundResult]:
        """How much of the view is covered, while nothing may be gathered for it; where `gather` is False for good, every pixel is
        splatted next."""
        looked_at = splats, self.settings.asking
        if state.looked_at != looked_at:
            state = replace(state, looked_at=looked_at, coverage=1.0 - self.scheduler.missing(gbuffer, splats))
        if gather or state.pixel_stride == 1:
            return state, NOTHING_ASKED
        return replace(state, pixel_stride=1), replace(NOTHING_ASKED, complete=False)

    def _picture(self, done: Round, fading: bool = False) -> View:
        """The picture of a round: direct light, normalised indirect light, and their blend.

        fading: what the records say comes in over several pictures."""
        settings, gbuffer, shadows, camera = self.settings, done.gbuffer, done.shadows, done.camera
        filling = settings.fill_holes and done.progress.coverage < 1.0 and settings.most_bounces > 0
        surface = self.scheduler.gatherer.surface_now if filling and not settings.emitters_apart else None
        backdrop, headlamp = backdrop_of(self.scene, settings, sky_maps(self.world)), self._headlamp_of(camera)
        emitter_pass, sampled_by = self.emitter_pass, (settings.pixel_light_samples, settings.seed)
        held = None if surface is None else surface.result
        subject = gbuffer, shadows, done.splats, settings.blend, settings.smooth, filling, held, backdrop, headlamp, sampled_by
        temporal_filter = self.temporal_filter
        if not fading:
            temporal_filter.forget()
        left = temporal_filter.left(subject)

        def light() -> moderngl.Texture:
            with self.timers("direct"):
                return self.direct_pass(gbuffer, shadows, headlamp=headlamp)

        def sample_emitters() -> moderngl.Texture:
            assert emitter_pass is not None
            with self.timers("emitters"):
                return emitter_pass(gbuffer, self.world, settings)

        def compose() -> View:
            splats = done.splats
            if fading or surface is not None:
                with self.timers("composite"):
                    found = None if surface is None else surface.uniforms()["scene"]
                    splats = temporal_filter(splats, gbuffer, camera, subject, shadows, found)
            splats = self.splats.at_every_pixel(splats, gbuffer, camera)
            sums = splats.sums
            if done.sparing:
                self._spare(splats if sums is done.splats.sums else None)
            direct = self._memo.get("direct", (gbuffer, shadows, headlamp), light)
            emitters = None if emitter_pass is None else self._memo.get("emitters", (gbuffer, *sampled_by), sample_emitters)
            with self.timers("composite"):
                if filling and surface is None:
                    sums = self.composite_pass.filled(sums, direct, gbuffer, backdrop)
                image, alpha, sums = self.composite_pass(sums, direct, gbuffer, backdrop, camera, settings, emitters)
            return View(camera, gbuffer, direct, splats, sums, image, alpha, backdrop=backdrop, fading=left > 0)

        return self._memo.get("picture", (subject, left), compose)

    def accumulate(self, view: View, samples: int, seconds: float | None = None, on_progress: OnProgress | None = None) -> View:
        """The `view` that `frame` gave last, with `samples` a pixel, or as many more than last time as `seconds` allow, one at
        least; the cache is left as it is. on_progress: called with the share done, 0..1, after each."""
        if samples <= 1:
            return view
        self._use()
        passes = FramePasses(self.gbuffer_pass, self.splats.splat_pass, self.direct_pass, self.composite_pass, self.emitter_pass)
        inputs = FrameInputs(self.world, self.draw_shadows(), self.cache, self.settings, self._headlamp_of(view.camera))
        return self.antialiaser(view, samples, Budget(seconds), passes, inputs, on_progress)

    # ---- what changes ----------------------------------------------------------------------------------------------

    def change(self, settings: Settings, preset: str = "") -> None:
        """Go on with other settings (called `preset` in the stats): what depends on those that differ is made again, records in
        place; they are forgotten only where their places depend on one. Raises InputError for what OpenGL does not take here."""
        self._go_on(replace(self._state, settings=settings, preset=preset or self.preset))

    def carry_headlamp(self, intensity: float) -> None:
        """Go on with a lamp of so many W/sr at the eye, which goes where that goes; 0: without.

        It adds direct light to the picture and nothing else: no record depends on it, so that the camera may move."""
        self._state = replace(self._state, headlamp=intensity)

    def relight(self, lights: Sequence[Light]) -> None:
        """Go on with other lights. Where all light changes by a factor in each channel, as where a lone lamp is dimmed, records
        hold at once what they are to; else they are gathered again in place. Raises InputError for too many lights."""
        self._go_on(replace(self._state, scene=replace(self.scene, lights=tuple(lights))))

    def move(self, mesh: int | str, transform: npt.ArrayLike) -> None:
        """Go on with a mesh (its index in scene.meshes, or its name) where a 4×4 or 3×4 matrix takes it from where it was loaded,
        in the material that it has now.

        Records on it move along, those within it go, and of the others those that it concerns are gathered again in place. Raises
        InputError for a mesh that is not there, and a matrix that is not affine, or singular.
        """
        self._go_on(replace(self._state, scene=moved(self.scene, self._loaded, mesh, transform)))

    def repaint(self, mesh: int | str, material: Material) -> None:
        """Go on with another material on a mesh (its index in scene.meshes, or its name): other colours, another emission.

        All records are gathered again in place, and hold what they held until then; what shines now becomes an area light. Raises
        InputError for a mesh that is not there, and for a material by which the mesh would wear other textures, let light through
        otherwise, or be drawn otherwise: for these the scene is loaded anew.
        """
        self._go_on(replace(self._state, scene=repainted(self.scene, mesh, material)))

    def pose(self, scene: Scene) -> None:
        """Go on with the renderer's scene in another pose: the same meshes elsewhere, of other materials or hidden (see
        scene.motion.hidden), other lights and another sky. As `move`, `repaint` and `relight` at once; raises InputError for a
        scene of other meshes, and as these."""
        pairs = zip(scene.meshes, self.scene.meshes, strict=False)
        if len(scene.meshes) != len(self.scene.meshes) or any(len(a.faces) != len(b.faces) for a, b in pairs):
            raise InputError("a pose has the same meshes as the renderer's scene, in the same order")
        meshes = tuple(_posed(a, b) for a, b in zip(scene.meshes, self.scene.meshes, strict=True))
        same = all(a is b for a, b in zip(meshes, self.scene.meshes, strict=True))
        around = {name: getattr(scene, name) for name in ("sky", "sky_gradient", "environment", "own_sky")}
        posed = replace(self.scene, lights=scene.lights, meshes=self.scene.meshes if same else meshes, **around)
        self._go_on(replace(self._state, scene=posed))

    def resize(self, size: tuple[int, int]) -> None:
        """Views are of another size (width, height) from now on; the records stay. Raises InputError for one that cannot be."""
        self._go_on(replace(self._state, size=gl_limits.checked(size)))

    def _go_on(self, state: State) -> None:
        """Go on with another scene, size or settings: with all of it, or, where it is refused, as before."""
        self._use()
        gl_limits.check(self.ctx, state.size, state.scene, state.settings.shadow_size)
        if state.size != self.size:
            gl_limits.check_memory(state.size, state.scene, state.settings, self.about["software"])
        if self._view_subject(state) != self._view_subject(self._state):
            self._leave_refinement()
            state = replace(state, refinement=None)
        dimming = SceneChange.between(self.scene, state.scene).dimming
        answered = state.settings == self.settings and self.scheduler.gatherer.answers(state.scene)
        self.scheduler.follow(state.settings, state.scene, self.shadows)
        if dimming is not None or answered:
            state = replace(state, view=self._dimmed_view(state))
            temporal_filter = self._passes.find("temporal", TemporalFilter)
            if temporal_filter is not None and dimming is not None:
                temporal_filter.dim(dimming)
            elif temporal_filter is not None:
                temporal_filter.forget()
        self._state = state

    def _dimmed_view(self, after: State) -> ViewState:
        """The progress of the present view, which goes on where lamps are dimmed and light follows at once, if that is all."""
        view = self._state.view
        if view.subject != self._view_subject(self._state):
            return view
        subject = self._view_subject(replace(self._state, scene=after.scene))
        return replace(view, subject=subject, limited=False, settled=None, looked_at=None)

    def reload(self) -> None:
        """Read the shaders' files again and draw with them; raises ShaderError, and goes on as before, where one is wrong."""
        self._use()
        program.reload(program.programs_of(self))
        self.renew()

    def renew(self) -> None:
        """Draw everything again, and gather all records again in place."""
        self._leave_refinement()
        self.scheduler.expire()
        self.forget(records=False)

    def forget(self, records: bool = True, lights: bool = True) -> None:
        """Draw every buffer of the view again next time; without the `records` made so far, and the `lights`' shadow maps."""
        self._leave_refinement()
        self._memo.forget(but=() if lights else ("shadows",))
        self.splats.forget()
        temporal_filter = self._passes.find("temporal", TemporalFilter)
        if temporal_filter is not None:
            temporal_filter.forget()
        self._state = replace(self._state, view=ViewState())
        if records:
            self.cache.truncate(0)

    # ---- files -----------------------------------------------------------------------------------------------------

    def save_cache(self, path: files.Pathlike) -> None:
        """Write the records to a file, whole or not at all; `load_cache` goes on from it bit for bit, as if nothing had happened.

        Raises InputError where `path` cannot be written to, IrrsplatError where writing fails.
        """
        self._use()
        files.check_file(path)
        cache_file.write(path, cache_file.key(self.scene, self.scheduler.settings), self.scheduler.state())

    def load_cache(self, path: files.Pathlike) -> None:
        """Take the records of a file in place of those that there are.

        Raises InputError, and changes nothing, where it is missing, no record cache or damaged, or where its records belong to
        another scene, other lights or other settings than this renderer's (those that cache_file.key lists).
        """
        self._use()
        self._leave_refinement()
        self.scheduler.restore(cache_file.read(path, cache_file.key(self.scene, self.scheduler.settings)))
        self.forget(records=False)

    # ---- whole renders ---------------------------------------------------------------------------------------------

    def converge(
        self,
        camera: Camera | str | None = None,
        progress: Callable[[Progress], None] | None = None,
        sparing: bool = False,
    ) -> tuple[View, Statistics]:
        """Rounds until the examination finds nothing, or `max_rounds`; returns the view and its statistics.

        "seconds" among them is the wall time to full coverage, before direct light and composite. progress is called after
        each round. Ctrl-C ends the rounds: the last complete one counts, "interrupted" is True. sparing: of the view nothing is
        looked at but its image and alpha, so that the memory for others can be freed before they are made.
        """
        self._use()
        self._leave_refinement()
        camera = self.scene.camera(camera)
        self.timers.clear()
        self._state = replace(self._state, view=replace(self._state.view, stalled_rounds=0))
        start, budget, done = time.perf_counter(), Budget(None), None
        stats: Statistics = {"rounds": 0, "converged": False, "full": False, "interrupted": False, "coverage": 0.0}
        stats["error"] = None
        complete, ended = self.cache.count + self.cache.evicted, False
        try:
            while not ended and stats["rounds"] < self.settings.max_rounds and not self._state.view.stalled:
                done = self._refine(camera, budget)
                now = done.progress
                complete, ended = self.cache.count + self.cache.evicted, now.new == 0 and now.complete
                stats["rounds"] += 1
                stats["coverage"], stats["full"], stats["converged"] = now.coverage, now.full, ended and not now.full
                if progress is not None:
                    progress(now)
        except KeyboardInterrupt:
            stats["interrupted"] = True
            self.cache.truncate(complete - self.cache.evicted)
        if done is None or not stats["converged"]:  # what the last round gathered is still to be splatted
            view, _ = self.scheduler.limit_radii(self._view_state(camera), last=True)
            self._state = replace(self._state, view=replace(view, pixel_stride=1))
            done = self._refine(camera, budget, gather=False)
            stats["coverage"] = done.progress.coverage
        self.ctx.finish()
        stats |= {"records": self.cache.count, "seconds": time.perf_counter() - start}
        return self._picture(replace(done, sparing=sparing)), stats

    def render(
        self,
        camera: Camera | str | None = None,
        progress: Callable[[Progress], None] | None = None,
        figures: bool = False,
        buffers: Collection[str] | None = None,
    ) -> Frame:
        """The view from `camera` (or the scene's of that name; default: its first), until every pixel is served, and then, where
        the settings give a `quality`, until its estimated error is no greater.

        Returns a Frame of numpy arrays that the caller owns. Records of earlier views are used again: only what is new is
        gathered. progress is called after each round. figures: fill Frame.figures with the paper's figures 1, 3 and 4 too.
        buffers: names of those that the frame holds (default: all); the others are empty, and of image and alpha alone a large
        picture takes half as much memory.
        Ctrl-C ends the rounds, or the samples, early: stats["converged"] is False then.
        """
        check_names(buffers)
        album = PaperFigures(self._splatted, progress)
        refined = self.settings.quality or self.settings.samples > 1
        alone = buffers is not None and not figures and gl_limits.PICTURE.issuperset(buffers)
        sparing = alone and not refined and self.size[0] * self.size[1] >= gl_limits.LARGE
        if self.gbuffer is None:
            wanted = gl_limits.PICTURE if alone else buffers
            gl_limits.check_memory(self.size, self.scene, self.settings, self.about["software"], wanted)
        view, stats = self.converge(camera, album if figures else progress, sparing)
        if self.settings.quality and stats["converged"]:
            view, stats = self._improved(view, stats, progress)
        samples = 1 if stats["interrupted"] else self.settings.samples
        view = self.accumulate(view, samples, on_progress=sample_progress(progress, stats))
        if view.samples < self.settings.samples:  # Ctrl-C
            stats |= {"interrupted": True, "converged": False}
        stats |= self.stats(view)
        if self._owns_ctx:
            context.check_errors(self.ctx)
        if sparing:
            self._free_buffers()
        frame = read(view, self.cache.read(), stats, buffers)
        return replace(frame, figures=album.figures(frame, view.camera, self.settings)) if figures else frame

    def _spare(self, splats: SplatBuffer | None) -> None:
        """Free what is not needed for the picture alone: all by which records are made, of the splats all but their sums, or,
        for None, these as well."""
        self.scheduler.gatherer.free_passes()
        if splats is not None:
            self.splats.free_all_but_sums()
        else:
            self._passes.drop("splats")

    def _free_buffers(self) -> None:
        """Free all that a view is made of but its image and alpha, to be made again when it is wanted."""
        self._memo.forget(but=("shadows",))
        self._state = replace(self._state, view=ViewState(), shown=None)
        for name in ("gbuffer", "splats", "refiner", "direct", "direct irradiance", "emitters", "temporal"):
            self._passes.drop(name)

    def _improved(self, view: View, stats: Statistics, on_progress: Callable[[Progress], None] | None) -> tuple[View, Statistics]:
        """A converged view refined to the settings' `quality`, and its statistics. Ctrl-C ends it with the picture that there
        is."""
        start, progress = time.perf_counter(), None
        try:
            while progress is None or not progress.refined:
                view, progress = self.refine(view.camera, 0.01 * self.settings.quality, seconds=_TOLD)
                if on_progress is not None:
                    on_progress(progress)
                if self._state.refinement is None:  # none that can be refined
                    return view, stats
        except KeyboardInterrupt:
            stats |= {"interrupted": True, "converged": False}
            if self._state.refinement is None:
                return view, stats
            view, progress = self._refined_view(view.camera)
        stats["seconds"] += time.perf_counter() - start
        return view, stats | {"records": self.cache.count, "error": progress.error}

    def _splatted(self, count: int) -> np.ndarray:
        """(H, W, 4) the sums of the first `count` records at every pixel of the present view."""
        camera = self._state.view.camera
        assert camera is not None
        records = replace(self.cache.records, count=count)
        return self.splats.read(records, self.draw_gbuffer(camera), camera, self.settings)

    def stats(self, view: View) -> Statistics:
        """What a frame's statistics say of where, what and how, apart from what `converge` counts."""
        exposure, settings = self.settings.exposure, self.settings
        stops = self.composite_pass.exposure(view.image) if exposure == "auto" else float(exposure)
        made: Statistics = {"samples": view.samples, "stages_ms": self.timers.milliseconds(), "clock": self.timers.clock}
        made |= cast(Statistics, self.scheduler.gatherer.bounces(settings))
        return made | describe(self.about, self.scene, self.size, self.preset, settings, stops)


def _posed(mesh: Mesh, present: Mesh) -> Mesh:
    """The `mesh`, as far as it differs from the `present` state of the same mesh: that itself where it does not."""
    if mesh is present:
        return present
    if is_elsewhere(mesh, present) and not (
        np.array_equal(mesh.positions, present.positions) and np.array_equal(mesh.faces, present.faces)
    ):
        return mesh
    return present if mesh.material == present.material else replace(present, material=mesh.material)


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
