"""The stages of a picture, each drawn after a change of its inputs: shadows, g-buffer, direct light, composite."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, ShadowMaps
from irrsplat.core.memo import Memo
from irrsplat.core.timing.input_waits import stop_for_input
from irrsplat.gather.kinds import shadow_caster
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import bands
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.image.antialias import Antialiaser, OnProgress, SampleBuffers, jittered, sample_offset
from irrsplat.image.backdrop import backdrop_of
from irrsplat.image.composite import CompositePass
from irrsplat.image.gbuffer import GBufferPass
from irrsplat.image.texture_maps import TextureMaps
from irrsplat.image.view import Reader, View
from irrsplat.indirect.hole_filling import HoleFilling, HoleLight
from irrsplat.indirect.scheduler import COVERED, RecordScheduler
from irrsplat.indirect.splat import ViewSplats, batches
from irrsplat.indirect.temporal_filter import TemporalFilter
from irrsplat.lighting.direct import DirectPass
from irrsplat.lighting.light_table import focus_of, light_defines
from irrsplat.lighting.shadow_maps import ShadowPass
from irrsplat.lighting.sky import sky_maps
from irrsplat.records.culling import reaching
from irrsplat.renderer.state import Round, State
from irrsplat.scene.model import Camera


class Stages(Owner):
    """The stages of the `world`'s pictures. Each result is kept until an input changes.

    maps: the textures of its surfaces. reader: see View.
    """

    def __init__(self, world: World, scheduler: RecordScheduler, maps: TextureMaps, timers: Timers, reader: Reader) -> None:
        self.ctx, self.world, self.scheduler, self.maps = world.ctx, world, scheduler, maps
        self.timers, self.reader = timers, reader
        self.antialiaser = self.own(Antialiaser(self.ctx, timers))
        self._passes = self.own(Workshop())  # passes by their size, lights and settings
        self._memo = Memo()  # the results of the stages

    # ---- the passes ------------------------------------------------------------------------------------------------

    def _gbuffer_pass(self, state: State) -> GBufferPass:
        size = state.size
        return self._passes.get("gbuffer", size, lambda: GBufferPass(self.ctx, size, self.maps))

    def _direct_pass(self, state: State, size: tuple[int, int], irradiance: bool = False) -> DirectPass:
        made_of = size, {**light_defines(state.scene), **self.world.material_defines}
        name = "direct irradiance" if irradiance else "direct"
        return self._passes.get(name, made_of, lambda: DirectPass(self.ctx, *made_of, irradiance))

    def _casting(self, state: State, hurried: bool = False) -> World | None:
        """Return the world of shadow rays, see `shadow_caster`; None for a scene without lights."""
        return shadow_caster(self.world, state.settings, hurried) if state.scene.lights else None

    def splats(self, state: State) -> ViewSplats:
        """Return the splat buffer of the present view."""
        return self._passes.get("splats", state.size, lambda: ViewSplats(self.world, state.size, self.timers))

    def composite_pass(self, size: tuple[int, int]) -> CompositePass:
        """Return the pass that composites pictures of this size."""
        return self._passes.get("composite", size, lambda: CompositePass(self.ctx, size))

    def hole_filling(self, state: State) -> HoleFilling:
        """Return the passes that fill holes."""
        return self._passes.get("holes", state.size, lambda: HoleFilling(self.ctx, state.size))

    # ---- the results -----------------------------------------------------------------------------------------------

    def draw_shadows(self, state: State) -> ShadowMaps:
        """Return the shadow maps; they depend on the lights, the meshes, the maps' size and the eye."""

        def draw() -> ShadowMaps:
            with self.timers("shadow"):
                shadow_pass = self._passes.get("shadows", (), lambda: ShadowPass(self.ctx))
                return shadow_pass(self.world, state.settings.shadow_size)

        return self._memo.get("shadows", self._shadow_inputs(state), draw)

    def shadows(self, state: State) -> ShadowMaps | None:
        """Return the shadow maps of the scene in `state`; None before they are drawn."""
        current = self._memo.holds("shadows", self._shadow_inputs(state))
        return self._memo.current("shadows", ShadowMaps) if current else None

    def _shadow_inputs(self, state: State) -> tuple[object, ...]:
        return state.scene.lights, state.scene.meshes, state.settings.shadow_size, focus_of(state.scene, self.world.eyes)

    def draw_gbuffer(self, state: State, camera: Camera) -> GBuffer:
        """Return the g-buffer of `camera`; it depends on the camera, the meshes, the size and the textures."""

        def draw() -> GBuffer:
            with self.timers("gbuffer"):
                return self._gbuffer_pass(state)(self.world, camera)

        inputs = camera, state.scene.meshes, state.size
        return self._memo.get("gbuffer", inputs, draw)

    @property
    def gbuffer(self) -> GBuffer | None:
        """The g-buffer of the present view; None before it is drawn."""
        return self._memo.current("gbuffer", GBuffer)

    @property
    def picture(self) -> View | None:
        """The present picture; None before it is drawn."""
        return self._memo.current("picture", View)

    def direct_irradiance(self, state: State, gbuffer: GBuffer) -> moderngl.Texture:
        """Return the direct irradiance by the scene's lights at every pixel of a g-buffer, W/m²."""
        draw, shadows = self._direct_pass(state, gbuffer.position.size, irradiance=True), self.draw_shadows(state)
        world = self._casting(state)
        return self._memo.get("direct irradiance", (gbuffer, shadows, draw), lambda: draw(gbuffer, shadows, world=world))

    def draw_picture(
        self, state: State, done: Round, accumulating: bool = False, hurried: bool = False, moving: bool = False
    ) -> View:
        """Return the picture of a round: direct light, normalised indirect light, and their blend.

        accumulating: True if temporal accumulation blends it with earlier pictures. hurried: True if direct light waits for no
        tree of rays. moving: True if shadow maps alone decide the shadows.
        """
        settings, gbuffer, splats = state.settings, done.gbuffer, done.splats
        assert gbuffer is not None and splats is not None
        gatherer = self.scheduler.gatherer
        coarse = accumulating and gatherer.provisional and gatherer.may_probe_holes
        filling = settings.fill_holes and (coarse or done.progress.coverage < 1.0) and settings.most_bounces > 0
        held = gatherer.surface_result if filling and not done.frozen else None
        lit_by = done.shadows, None if moving else self._casting(state, hurried)
        backdrop = backdrop_of(state.scene, settings, sky_maps(self.world))
        probed = filling and accumulating and (coarse or done.progress.coverage < COVERED)
        probes = self.scheduler.hole_probes if probed else None
        light = HoleLight(probes, {} if held is None else gatherer.surface_uniforms, coarse)
        probe_state = probes and (probes.light, probes.cache.revision, probes.cache.count)
        subject = gbuffer, lit_by, splats, settings.blend, filling, held, probe_state, backdrop
        temporal_filter = self._passes.get("temporal", state.size, lambda: TemporalFilter(self.ctx, state.size))
        if not accumulating:
            temporal_filter.forget()
        left = temporal_filter.left(subject)

        def draw() -> View:
            stop_for_input()
            shown = splats
            if filling:
                fill = self.hole_filling(state)
                with self.timers("composite"):
                    if light.surface and not accumulating:
                        shown = fill.by_surface(gbuffer, splats, light.surface)
                    else:
                        shown = fill(gbuffer, splats, done.camera, light)
            if accumulating:
                scene, other = (held, gatherer.basis), gatherer.provisional or gatherer.basis.moved
                with self.timers("composite"):
                    shown = temporal_filter(shown, gbuffer, done.camera, subject, scene, filling, other)
                stop_for_input()
            shown = self.splats(state).at_every_pixel(shown, gbuffer, done.camera)
            direct = self._memo.get("direct", (gbuffer, lit_by), lambda: self._direct(state, gbuffer, *lit_by))
            composite_pass = self.composite_pass(state.size)
            with self.timers("composite"):
                image, alpha = composite_pass(shown.sums, direct, gbuffer, backdrop, done.camera, settings)
            buffers = gbuffer, direct, shown, image, alpha
            return View(done.camera, *buffers, backdrop=backdrop, accumulating=left > 0, reader=self.reader)

        return self._memo.get("picture", (subject, left), draw)

    def _direct(self, state: State, gbuffer: GBuffer, shadows: ShadowMaps, casting: World | None) -> moderngl.Texture:
        """Return the direct outgoing radiance of a view. casting: the world of shadow rays; None for shadow maps alone."""
        draw = partial(self._direct_pass(state, state.size), gbuffer, shadows, world=casting)
        with self.timers("direct"):
            for band in bands(state.size):
                direct = draw(band=band)
                stop_for_input(self.ctx)
        return direct

    def accumulate(
        self, state: State, view: View, samples: int, budget: Budget | None = None, on_progress: OnProgress | None = None
    ) -> View:
        """Return the last picture with more `samples` a pixel, see Renderer.accumulate."""
        draw = partial(self._draw_sample, state, view)
        return self.antialiaser(view, samples, budget or Budget(None), state.settings.mix, draw, on_progress)

    def _draw_sample(self, state: State, view: View, number: int, buffers: SampleBuffers) -> Iterator[None]:
        """Draw sample `number` of a view, and blend it into the means; yield between the stages."""
        x, y, rotation = sample_offset(number)
        camera, settings, cache = jittered(view.camera, (x, y), buffers.size), state.settings, self.scheduler.cache
        gbuffer = self._gbuffer_pass(state)(self.world, camera, buffers.gbuffer)
        yield
        splat_pass = self.splats(state).splat_pass
        splat_pass.clear(gbuffer, target=buffers.splat)
        if settings.most_bounces > 0 and cache.count:
            for some in batches(reaching(cache, 0, camera, buffers.size, settings), buffers.size):
                splat_pass(cache.records, some, gbuffer, camera, settings, target=buffers.splat, reach=view.splats.reach)
                yield
        lit_by = self.draw_shadows(state), rotation, buffers.direct, self._casting(state)
        for band in bands(buffers.size):
            direct = self._direct_pass(state, state.size)(gbuffer, *lit_by, band)
            yield
        behind = view.backdrop.uniforms(camera, buffers.size)
        for band in bands(buffers.size):
            if band[1]:
                yield
            sums = buffers.splat.textures[0]
            buffers.mean(number + 1, gbuffer, direct, sums, view.splats.sums, behind, settings.mix, band)

    def splatted(self, state: State, camera: Camera, count: int) -> np.ndarray:
        """Return (H, W, 4) the sums of the first `count` records at every pixel of a view."""
        records = replace(self.scheduler.cache.records, count=count)
        return self.splats(state).read(records, self.draw_gbuffer(state, camera), camera, state.settings)

    # ---- changes ---------------------------------------------------------------------------------------------------

    def free_buffers(self) -> None:
        """Free the buffers of a view except image and alpha; the next use makes them again."""
        self._memo.forget(but=("shadows",))
        for name in ("gbuffer", "splats", "direct", "direct irradiance", "temporal", "holes"):
            self._passes.drop(name)

    def forget(self, shadows: bool) -> None:
        """Draw everything again next time; the shadow maps only with `shadows`."""
        self._memo.forget(but=() if shadows else ("shadows",))
        shadow_pass = self._passes.find("shadows", ShadowPass)
        if shadows and shadow_pass is not None:
            shadow_pass.forget()
        splats = self._passes.find("splats", ViewSplats)
        if splats is not None:
            splats.forget()
        self.forget_last_picture()

    def forget_last_picture(self) -> None:
        """Blend the next picture with no earlier one."""
        temporal_filter = self._passes.find("temporal", TemporalFilter)
        if temporal_filter is not None:
            temporal_filter.forget()
