"""The frame: shadows, g-buffer, then splat, examine and gather until every pixel is served, then direct and composite.

This is the only place where the passes meet; read `Renderer.frame` first.
"""

from __future__ import annotations

import operator
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import moderngl
import numpy as np

from irrsplat import figure, paper
from irrsplat.buffers import GBuffer, ShadowMaps, SplatBuffer
from irrsplat.cache import RecordCache
from irrsplat.errors import InputError
from irrsplat.gpu import context
from irrsplat.gpu.geometry import Geometry
from irrsplat.gpu.program import Program
from irrsplat.gpu.target import Target, pixels
from irrsplat.gpu.timers import Timers
from irrsplat.lights import light_defines
from irrsplat.output import Frame
from irrsplat.passes.composite import CompositePass
from irrsplat.passes.direct import DirectPass
from irrsplat.passes.examine import ExaminePass, choose, spacing
from irrsplat.passes.gather import GatherPass
from irrsplat.passes.gbuffer import GBufferPass
from irrsplat.passes.reduce import ReducePass
from irrsplat.passes.shadow import ShadowPass
from irrsplat.passes.splat import SplatPass
from irrsplat.scene.flat import flatten
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings, preset
from irrsplat.view import Progress, View, read

_IDLE = 8  # rounds without any gain in coverage after which nothing more is to be hoped for
_REACH = 8.0  # percent of the image height by which the first sites lie apart where radii have no upper limit


class Renderer:
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
        **settings: Any,
    ) -> None:
        if not isinstance(scene, Scene):
            raise InputError(f"a Renderer takes a Scene, as irrsplat.load returns it, not {type(scene).__name__}")
        self.scene = scene
        self.settings: Settings = _preset(preset, **settings)
        self.preset = preset
        self.size = _checked(size)
        self._owns_ctx = ctx is None
        self.ctx = ctx or context.create()
        self.about = context.describe(self.ctx)
        if max(self.size) > self.about["max_texture_size"]:
            raise InputError(
                f"size {self.size[0]}x{self.size[1]} is beyond the limit here, {self.about['max_texture_size']} pixels a side"
            )
        most = int(self.ctx.info["GL_MAX_FRAGMENT_UNIFORM_VECTORS"]) // 8 - 8  # eight rows of the light table a light
        if len(scene.lights) > most:
            raise InputError(f"the scene has {len(scene.lights)} lights, and this OpenGL takes {most}: leave some out")
        self.timers = Timers(self.ctx, self.about["software"], enabled=True)
        lights = light_defines(scene)
        self.geometry = Geometry(self.ctx, *flatten(scene))
        self.cache = RecordCache(self.ctx)
        self.shadow_pass = ShadowPass(self.ctx)
        self.gbuffer_pass = GBufferPass(self.ctx, self.size)
        self.gather_pass = GatherPass(
            self.ctx,
            "plane" if self.settings.gather == "plane" else "raster",
            self.settings.gather_size,
            scene.diagonal,
            lights,
            capacity=1 if self.settings.placement == "scan" else None,  # the paper: one at a time
        )
        self.reduce_pass = ReducePass(self.ctx, self.settings.gradients)
        self.splat_pass = SplatPass(self.ctx, self.size, self.settings.gradients)
        self.examine_pass = ExaminePass(self.ctx, self.size)
        self.direct_pass = DirectPass(self.ctx, self.size, lights)
        self.composite_pass = CompositePass(self.ctx, self.size)
        self._shadows: ShadowMaps | None = None
        self._camera: Camera | None = None
        self._gbuffer: GBuffer | None = None
        self._direct: moderngl.Texture | None = None
        self._on_cpu: paper.Seen | None = None  # the g-buffer as the paper's algorithm reads it back
        self._splatted = 0  # how many of the cache's records the splat buffer holds
        self._round = 0  # of this view
        self._pattern = 0  # how far its sites have come from coarse to fine

    # ---- the frame -------------------------------------------------------------------------------------------------

    def _use(self) -> None:
        """Make this renderer's own OpenGL context the current one; a given one is its owner's to make current."""
        if self._owns_ctx:
            self.ctx.__enter__()

    def _chosen(self, camera: Camera | str | None) -> Camera:
        if isinstance(camera, Camera):
            return camera
        if camera is None or isinstance(camera, str):
            return self.scene.camera(camera)
        raise InputError(f"a camera is a Camera or the name of one of the scene's, not {type(camera).__name__}")

    def frame(self, camera: Camera | str | None = None) -> tuple[View, Progress]:
        """One round: draw what the camera sees, splat what is new, and gather where nothing speaks for a pixel yet."""
        self._use()
        progress = self._advance(self._chosen(camera))
        return self._compose(), progress

    def _advance(self, camera: Camera) -> Progress:
        shadows = self._lit()
        gbuffer = self._seen(camera)
        splats = self._splat(gbuffer, camera)
        if self.settings.bounces == 0:
            return Progress(self._round, 0, 0, 1.0)
        if self.settings.placement == "scan":
            new, missing = self._scan(gbuffer, splats, shadows, camera)
        else:
            new, missing = self._ask(gbuffer, splats, shadows)
        self._round += 1
        return Progress(self._round, self.cache.count, new, 1.0 - missing)

    def _lit(self) -> ShadowMaps:
        """The shadow maps, drawn once: lights do not move."""
        if self._shadows is None:
            with self.timers("shadow"):
                self._shadows = self.shadow_pass(self.scene, self.geometry, self.settings.shadow_size)
        return self._shadows

    def _seen(self, camera: Camera) -> GBuffer:
        """The g-buffer, drawn again only for another camera."""
        if self._gbuffer is None or camera != self._camera:
            with self.timers("gbuffer"):
                self._gbuffer = self.gbuffer_pass(self.scene, self.geometry, camera)
            self._camera, self._direct, self._on_cpu = camera, None, None
            self._round, self._pattern, self._splatted = 0, 0, -1
        return self._gbuffer

    def _splat(self, gbuffer: GBuffer, camera: Camera) -> SplatBuffer:
        """The splat buffer with every record of the cache in it; the sums are additive, so that only new ones are drawn."""
        with self.timers("splat"):
            if self._splatted < 0:
                self.splat_pass.clear(gbuffer)
                self._splatted = 0
            splats = self.splat_pass(self.cache.records, self._splatted, gbuffer, camera, self.settings)
        self._splatted = self.cache.count
        return splats

    def _ask(self, gbuffer: GBuffer, splats: SplatBuffer, shadows: ShadowMaps) -> tuple[int, float]:
        """Examine the splat buffer and gather where it asks: how many records are new, and the share of pixels without."""
        settings = self.settings
        with self.timers("examine"):
            found = self.examine_pass(gbuffer, splats, settings.threshold, settings.seed)
            reach = (settings.radius_max or _REACH) / 100.0 * self.size[1] / self.examine_pass.side  # tiles
            asking = int(np.count_nonzero(found.asking))
            tiles = choose(found.asking, *spacing(self._pattern, reach, asking), settings.seed)
            while asking and not len(tiles[0]):  # these fields of the chess board ask for nothing: the next ones
                self._pattern += 1
                tiles = choose(found.asking, *spacing(self._pattern, reach, asking), settings.seed)
            self._pattern += 1
            sites = found.at(tiles)
        for start in range(0, len(sites), self.gather_pass.capacity):
            batch = sites[start : start + self.gather_pass.capacity]
            with self.timers("gather"):
                atlas = self.gather_pass(self.geometry, shadows, batch, self.cache.count, settings.seed)
            with self.timers("reduce"):
                first = self.cache.append(batch)
                self.reduce_pass(atlas, self.cache.records, first, self.scene.sky, self.gather_pass.radii)
        return len(sites), found.missing

    def _scan(self, gbuffer: GBuffer, splats: SplatBuffer, shadows: ShadowMaps, camera: Camera) -> tuple[int, float]:
        """The same by the paper's own algorithm: random warm-up records, then a traversal in scan order on the CPU."""
        if self._on_cpu is None:
            with self.timers("gbuffer"):
                self._on_cpu = paper.read_back(gbuffer)
        seen = self._on_cpu
        recorder = paper.Recorder(self.gather_pass, self.geometry, shadows, self.scene.sky)
        warm_up = self.cache.count == 0 and self.settings.warmup > 0
        with self.timers("gather" if warm_up else "examine"):
            if warm_up:
                sites, values = paper.warm_up(seen, recorder, self.settings)
                missing = float(seen.mask.any())
            else:
                weight = pixels(splats.weight)[..., 0]
                sites, values, missing = paper.traverse(seen, weight, recorder, camera, self.settings)
        if len(sites):
            self.cache.append(sites, values)
        return len(sites), missing

    def _compose(self) -> View:
        """The picture from what there is: direct light, normalised indirect light, their blend."""
        assert self._camera is not None and self._gbuffer is not None
        gbuffer, splats = self._gbuffer, SplatBuffer(*self.splat_pass.target.textures)
        if self._direct is None:
            with self.timers("direct"):
                self._direct = self.direct_pass(gbuffer, self._lit())
        with self.timers("composite"):
            image, sums = self.composite_pass(splats, self._direct, gbuffer, self.scene.sky, self._camera, self.settings)
        return View(self._camera, gbuffer, self._direct, splats, sums, image)

    # ---- whole renders ---------------------------------------------------------------------------------------------

    def converge(
        self, camera: Camera | str | None = None, progress: Callable[[Progress], None] | None = None
    ) -> tuple[View, dict[str, Any]]:
        """Rounds until the examination finds nothing, or `max_rounds`; returns the view and its statistics.

        "seconds" among them is the wall time to full coverage, before direct light and composite. progress is called after
        each round. Ctrl-C ends the rounds: the last whole one counts, "interrupted" is True.
        """
        self._use()
        camera = self._chosen(camera)
        self.timers.clear()
        start = time.perf_counter()
        stats: dict[str, Any] = {"rounds": 0, "converged": False, "interrupted": False, "coverage": 0.0}
        whole, idle = self.cache.count, 0
        try:
            while not stats["converged"] and stats["rounds"] < self.settings.max_rounds and idle < _IDLE:
                now = self._advance(camera)
                idle = 0 if now.coverage > stats["coverage"] else idle + 1
                whole = self.cache.count
                stats["rounds"] += 1
                stats["coverage"], stats["converged"] = now.coverage, now.new == 0
                if progress is not None:
                    progress(now)
        except KeyboardInterrupt:
            stats["interrupted"] = True
            self.cache.truncate(whole)
            self._splatted = -1
        if not stats["converged"]:  # what the last round gathered is still to be splatted
            gbuffer = self._seen(camera)
            splats = self._splat(gbuffer, camera)
            if self.settings.bounces:
                found = self.examine_pass(gbuffer, splats, self.settings.threshold, self.settings.seed)
                stats["coverage"] = 1.0 - found.missing
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

        Returns a Frame of numpy arrays that the caller owns.

        Records of earlier views are used again: only what is new is gathered. progress is called after each round with
        round, records, new and coverage (0..1). figures: fill Frame.figures with the paper's figures 1, 3 and 4 too.
        Ctrl-C ends the rounds early: stats["converged"] is False then.
        """
        first: list[np.ndarray] = []

        def watch(now: Progress) -> None:
            if now.round <= 2:  # the second round splats what the first one gathered
                first[:] = [self.splat_pass.target.read(0)]
            if progress is not None:
                progress(now)

        view, stats = self.converge(camera, watch if figures else progress)
        frame = read(view, self.scene.sky, self.cache.read(), stats | self._statistics(view))
        if not figures:
            return frame
        splats = {"first_samples": first[0] if first else self.splat_pass.target.read(0)}
        splats["splat_buffer"] = self.splat_pass.target.read(0)
        pictures = {name: frame.albedo / np.float32(np.pi) * sums[..., :3] for name, sums in splats.items()}
        return replace(frame, figures=pictures | {"quad": figure.diagram(frame, view.camera, self.settings)})

    def _statistics(self, view: View) -> dict[str, Any]:
        settings = self.settings
        exposure = self.composite_pass.exposure(view.image) if settings.exposure == "auto" else float(settings.exposure)
        return {
            "stages_ms": self.timers.milliseconds(),
            "clock": self.timers.clock,
            "renderer": self.about["renderer"],
            "version": self.about["version"],
            "preset": self.preset,
            "settings": asdict(settings),
            "exposure": float(exposure),
            "size": list(self.size),
            "triangles": self.scene.triangles,
            "scene": self.scene.name,
        }

    def forget(self, records: bool = True, lights: bool = True) -> None:
        """Draw every buffer of the view again next time; without the `records` made so far, and the `lights`' shadow maps."""
        self._gbuffer = self._camera = None
        if lights:
            self._shadows = None
        if records:
            self.cache.truncate(0)

    def release(self) -> None:
        """Free everything on the GPU, the context too where this renderer made it."""
        if self._owns_ctx:
            self.ctx.release()
            return
        for holder in (self, *vars(self).values()):
            for thing in vars(holder).values() if hasattr(holder, "__dict__") else ():
                if isinstance(thing, (Target, Program, Geometry, RecordCache, moderngl.Texture, moderngl.Buffer)):
                    thing.release()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


def render(
    scene: Scene, size: tuple[int, int] = (800, 800), camera: Camera | str | None = None, preset: str = "default", **settings: Any
) -> Frame:
    """One view of `scene`, headless, refined until every pixel is served; arguments and errors as `Renderer`."""
    with Renderer(scene, size, preset, **settings) as renderer:
        return renderer.render(camera)


_preset = preset  # Renderer's argument has the same name


def _checked(size: tuple[int, int]) -> tuple[int, int]:
    try:
        width, height = (operator.index(n) for n in size)
    except (TypeError, ValueError):
        raise InputError(f"size takes two whole numbers, width and height, not {size!r}") from None
    if width < 1 or height < 1:
        raise InputError(f"size must be at least 1x1 pixels, not {width}x{height}")
    return width, height
