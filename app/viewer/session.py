"""One scene on show: its renderers, the camera that flies in it, and a tick of them all; it draws nothing and knows no window."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Unpack, cast

import moderngl

from irrsplat.app.viewer.buffers.background_truth import Truth, Truths
from irrsplat.app.viewer.buffers.shown_buffer import ViewSource
from irrsplat.app.viewer.input.free_camera import FreeCamera
from irrsplat.app.viewer.input.path_recorder import PathRecorder
from irrsplat.app.viewer.show.auto_exposure import AutoExposure
from irrsplat.app.viewer.show.screen import Region
from irrsplat.app.viewer.view_options import Split, ViewOptions
from irrsplat.core.errors import IrrsplatError
from irrsplat.gpu import program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.image.frame import Frame
from irrsplat.image.statistics import Statistics
from irrsplat.image.view import Progress, View, read
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera, Light, Scene
from irrsplat.settings import SETTINGS, Settings, SettingValues, preset

_SHARED = ("budget", "exposure")  # settings that both sides share, and that a change of the preset leaves alone


class Session(Owner):
    """One scene on show in a context of the caller's. size: pixels. values: settings on top of the preset.

    A side (0 left, 1 right) is a part of the window; in a split by presets each side has a renderer of its own.
    Raises what Renderer raises; whatever fails later leaves everything as it was.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        scene: Scene,
        size: tuple[int, int],
        preset: str = "default",
        values: SettingValues | None = None,
        camera: Camera | None = None,
    ) -> None:
        self.ctx, self.size, self.scene = ctx, size, scene
        self.options = ViewOptions()
        self.renderers = [Renderer(scene, size, preset, ctx=ctx, **(values or {}))]  # of the left side; of the right one too
        self.free_camera = FreeCamera(scene.camera(), scene.diagonal, scene.up)
        if camera is not None:
            self.free_camera.go(camera)
        self.views: list[View] = []
        self.progress: list[Progress] = []
        self.ms: dict[str, float] = {}  # milliseconds of the last tick by stage
        self.auto_exposure = AutoExposure()
        self.path_recorder, self.truths = PathRecorder(), Truths(ctx)
        self.held: tuple[int, int] | None = None  # the side and the name of the record that a click holds
        self._centres: list[View] = []  # the views of one sample a pixel, before further samples were added
        self._stepping = False

    def owned(self) -> tuple[Resource, ...]:
        """What this frees: all that is on the GPU but the context."""
        return (*self.renderers, self.truths)

    # ---- a tick ----------------------------------------------------------------------------------------------------

    @property
    def active(self) -> list[Renderer]:
        """The renderers at work: two where two presets are compared."""
        return self.renderers[: 2 if self.options.split == "presets" else 1]

    @property
    def camera(self) -> Camera:
        """What is looked through now: the path's camera while it plays, else the free camera."""
        return self.path_recorder.camera or self.free_camera.camera

    @property
    def at_rest(self) -> bool:
        """Whether another tick would show the same."""
        served = bool(self.views) and all(self._at_rest(p) for p in self.progress)
        sampled = all(
            v.samples >= r.settings.viewer_samples
            for v, r in zip(self.views, self.active, strict=False)
            if r.settings.viewer_samples > 1
        )
        refined = all(self._refined(r, p) for r, p in zip(self.active, self.progress, strict=False))
        return served and sampled and refined and self.auto_exposure.settled and not self._stepping and self.path_recorder.at_rest

    @property
    def exposure(self) -> float:
        """Stops, as shown on both sides; NaN before the first picture."""
        return self.auto_exposure.stops

    def _at_rest(self, progress: Progress) -> bool:
        """Whether a side's cache and picture stay as they are."""
        return progress.still or (self.options.frozen and progress.new == 0 and progress.complete and not progress.fading)

    def _refined(self, renderer: Renderer, progress: Progress) -> bool:
        """Whether a side is refined as far as it is to be."""
        aim = renderer.settings.viewer_quality
        known = progress.error is not None and progress.error <= 0.01 * aim
        return not aim or known or progress.refined or self.options.frozen or not renderer.can_refine

    def tick(self, dt: float, seconds: float) -> None:
        """Go on by `dt` seconds: play, record, and give the caches `seconds` of time."""
        played = self.path_recorder.tick(dt, self.camera)
        if played is not None:
            self.free_camera.go(played)
        self._pose(ended=played is not None)
        renderers, before, shown = self.active, self._centres, self.views
        self.views, self.progress, self.ms, self._centres = [], [], {}, []
        for side, renderer in enumerate(renderers):
            gather, end = self._stepping or not self.options.frozen, time.perf_counter() + seconds / len(renderers)
            view, progress = renderer.frame(self.camera, seconds / len(renderers), gather)
            self._centres.append(view)
            if self._at_rest(progress) and any(view is one for one in before):  # nothing has moved since
                view = renderer.accumulate(view, renderer.settings.viewer_samples, end - time.perf_counter())
                if view.samples >= renderer.settings.viewer_samples and not self._refined(renderer, progress):
                    aim = 0.01 * renderer.settings.viewer_quality
                    _, progress = renderer.refine(self.camera, aim, end - time.perf_counter())
            last = shown[side] if side < len(shown) else view
            if progress.error is not None and last.gbuffer is view.gbuffer and view.samples < last.samples:
                view = last  # until the next step of the refinement has as many
            self.views.append(view)
            self.progress.append(progress)
            for stage, ms in renderer.timers.milliseconds().items():
                self.ms[stage] = self.ms.get(stage, 0.0) + ms
        self._stepping = self._stepping and not all(p.complete for p in self.progress)
        self._release_lost_record()
        self.auto_exposure.tick(self.renderers[0], self._centres[0], dt)

    # ---- sides -----------------------------------------------------------------------------------------------------

    def sides(self) -> Iterator[tuple[int, Region | None]]:
        """The sides on show, and the part of the window that each takes (None: all of it)."""
        width, height = self.size
        if self.options.split == "off":
            yield 0, None
            return
        middle = min(max(round(self.options.divider * width), 1), width - 1)
        yield 0, (0, 0, middle, height)
        yield 1, (middle, 0, width - middle, height)

    def side_at(self, x: float) -> int:
        """The side at `x`, pixels from the left."""
        return int(self.options.split != "off" and x >= round(self.options.divider * self.size[0]))

    def renderer(self, side: int) -> Renderer:
        """The renderer whose settings a side has."""
        return self.active[min(side, len(self.active) - 1)]

    def settings(self, side: int) -> tuple[str, Settings]:
        """The preset and the settings of a side."""
        renderer = self.renderer(side)
        return renderer.preset, renderer.settings

    def source(self, side: int) -> ViewSource:
        """What a side's buffers are shown of: the last tick's view."""
        i = side if len(self.views) == 2 and self.options.split == "presets" else 0
        renderer, view = self.renderers[i], self.views[i]
        return ViewSource(renderer, view, self.exposure, self.truth(view.camera, renderer.settings))

    def truth(self, camera: Camera, settings: Settings) -> Truth | None:
        """The traced truth of what `camera` sees by as many bounces as the settings say; None where there is none."""
        return self.truths.of(self.scene, camera, self.size, settings.bounces)

    def frame(self) -> Frame:
        """Every buffer of the left side's view as it is now."""
        source, progress = self.source(0), self.progress[0]
        stats = Statistics(records=progress.records, rounds=progress.round, coverage=progress.coverage, converged=progress.done)
        stats["error"] = progress.error
        stats |= source.renderer.stats(source.view)
        stats["exposure"] = self.exposure
        return read(source.view, source.renderer.cache.read(), stats)

    # ---- what changes ----------------------------------------------------------------------------------------------

    def change(self, side: int, **values: Unpack[SettingValues]) -> None:
        """Change settings of a side, those of _SHARED for both. Raises InputError for a value that cannot be."""
        for renderer in self.renderers:
            own = {k: v for k, v in values.items() if k in _SHARED or renderer is self.renderer(side)}
            if own:
                renderer.change(renderer.settings.with_values(own))
        self._release_lost_record()

    def use_preset(self, side: int, name: str) -> None:
        """Set a side to the preset `name`."""
        renderer = self.renderer(side)
        renderer.change(preset(name, **_values(renderer.settings, _SHARED)), name)
        self._release_lost_record()

    def _release_lost_record(self) -> None:
        """Hold a record no longer once it is gone."""
        if self.held is not None and self.renderer(self.held[0]).cache.number_of(self.held[1]) is None:
            self.held = None

    def split(self, way: Split) -> None:
        """One picture, two buffers, or two presets side by side: the left one's, and paper (beside paper: default)."""
        options = self.options
        if way == "presets" and len(self.renderers) == 1:
            left = self.renderers[0]
            other = "default" if left.preset == "paper" else "paper"
            shared = _values(left.settings, _SHARED)
            self.renderers.append(Renderer(self.scene, self.size, other, ctx=self.ctx, **shared))
            self.renderers[1].carry_headlamp(left.headlamp)
        if way == "presets":
            options.buffers[1] = options.buffers[0]
        elif way == "buffers" and options.buffers[0] == options.buffers[1]:
            options.buffers[1] = "irradiance" if options.buffers[0] != "irradiance" else "image"
        options.split, self.held = way, None

    @property
    def headlamp(self) -> bool:
        """Whether there is a lamp at the eye."""
        return self.renderers[0].headlamp > 0.0

    def _pose(self, ended: bool) -> None:
        """Put what the path moves where it is now; ended: its last frame is. It stays where playing stops."""
        path = self.path_recorder.path
        frame = path.frames - 1.0 if path is not None and ended else self.path_recorder.frame
        if path is not None and frame is not None and path.motions:
            scene = path.motions.at(self.scene, frame)
            for renderer in self.renderers:
                renderer.pose(scene)

    def carry_headlamp(self, on: bool) -> None:
        """Carry a lamp at the eye, or none: as bright that what the camera looks at is lit as well as the exposure is now for."""
        stops = self.exposure if math.isfinite(self.exposure) else 0.0
        distance = math.dist(self.camera.eye, self.camera.target)
        for renderer in self.renderers:
            renderer.carry_headlamp(math.pi * distance**2 * 2.0**-stops if on else 0.0)

    def relight(self, lights: Sequence[Light]) -> None:
        """Use other lights: records are gathered again in place, tick by tick."""
        for renderer in self.renderers:
            renderer.relight(lights)
        self.scene = replace(self.scene, lights=tuple(lights))

    def resize(self, size: tuple[int, int]) -> None:
        """The window has another size, pixels."""
        for renderer in self.renderers:
            renderer.resize(size)
        self.size = size

    def open(self, scene: Scene, keep_camera: bool = False) -> None:
        """Show another scene with the same settings, from its own first camera; or from where one is, with path and speed."""
        made: list[Renderer] = []
        try:
            for r in self.renderers:
                made.append(Renderer(scene, self.size, r.preset, ctx=self.ctx, **overrides(r.preset, r.settings)))
        except IrrsplatError:
            for renderer in made:
                renderer.release()
            raise
        for renderer in self.renderers:
            renderer.release()
        self.renderers, self.scene = made, scene
        before, self.free_camera = self.free_camera, FreeCamera(scene.camera(), scene.diagonal, scene.up)
        if keep_camera:
            self.free_camera.go(before.camera)
            self.free_camera.speed = before.speed
        if not keep_camera or not self.path_recorder.fits(scene):
            self.path_recorder = PathRecorder()
        self.views, self.progress, self.held = [], [], None

    def reload_shaders(self, *others: program.Program) -> None:
        """Read all shaders again, those of `others` too; raises ShaderError, and all goes on as before, where one is wrong."""
        program.reload([*program.programs_of(self), *others])
        for renderer in self.renderers:
            renderer.renew()

    def clear(self) -> None:
        """Forget all records."""
        for renderer in self.active:
            renderer.forget(lights=False)
        self.held = None

    def step(self) -> None:
        """Freeze the cache, and gather one complete round in as many ticks as it takes."""
        self.options.frozen = self._stepping = True


def overrides(name: str, settings: Settings) -> SettingValues:
    """The values in which `settings` differ from the preset `name`."""
    base = preset(name)
    return _values(settings, [key for key in SETTINGS if getattr(settings, key) != getattr(base, key)])


def _values(settings: Settings, names: Sequence[str]) -> SettingValues:
    """Some settings by name."""
    return cast(SettingValues, {name: getattr(settings, name) for name in names})
