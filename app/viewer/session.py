"""One scene on show: its renderers, its free camera, and a tick of all parts, without drawing and without a window."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, Unpack, cast

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.background_reference import Reference, Subject
from irrsplat.app.viewer.buffers.shown_buffer import Identity, ViewSource
from irrsplat.app.viewer.input.free_camera import FreeCamera, PathRecorder
from irrsplat.app.viewer.show.exposure import AutoExposure, brightest_light
from irrsplat.app.viewer.show.light.measuring_plane import MeasuringPlane, usual_height
from irrsplat.app.viewer.view_options import ViewOptions
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.core.timing.clock import now
from irrsplat.core.timing.input_waits import InputWaits, checked_by, never
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Region
from irrsplat.image.view import Progress, View
from irrsplat.lighting.light_table import light_defines
from irrsplat.meter.light_scale import LightScale
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import SETTINGS, Settings, SettingValues, preset

_SHARED = ("budget", "exposure")  # settings that both sides share; a change of the preset keeps them
_FEW = 8  # samples per pixel: with fewer, edges are smoothed by their shape
_MOVING = 0.6  # share of a tick's time while the camera moves: input at a tick's begin shows after the next tick


class _Tick(NamedTuple):
    """The results of a tick, by side: views to show, and their progress. centres: the views with one sample a pixel. subject: the
    inputs of the views, see Session._subject."""

    centres: tuple[View, ...] = ()
    views: tuple[View, ...] = ()
    progress: tuple[Progress, ...] = ()
    subject: tuple[object, object] | None = None


class Session(Owner):
    """One scene on show in a context of the caller's. size: pixels. values: settings on top of the preset. camera: world space.

    All positions inside are relative to `origin`, the scene's origin. Input and output of the user are in world space.

    A side (0 left, 1 right) is a part of the window. In a split each side has a renderer of its own.
    Raises the errors of Renderer. A later failure changes nothing.
    """

    extent: float  # metres: the diagonal of the scene's near bounds

    def __init__(
        self,
        ctx: moderngl.Context,
        scene: Scene,
        size: tuple[int, int],
        preset: str = "default",
        values: SettingValues | None = None,
        camera: Camera | None = None,
    ) -> None:
        self.ctx, self.size = ctx, size
        self.options, self.tracing, self.plane = ViewOptions(), Reference(ctx), MeasuringPlane()
        self.renderers: list[Renderer] = []  # of the left side, and of the right side too if there is no second one
        self.brightest = 0.0  # W/m²: brightest_light of the left view, computed while false colours are on show
        self._last = _Tick()
        self._begin(scene, [(preset, values or {})], camera)

    def owned(self) -> tuple[Resource | None, ...]:
        return (*self.renderers, self.tracing, self.plane)

    @property
    def notices(self) -> tuple[str, ...]:
        """The notices about the scene."""
        return *self.scene.notices, *self.renderers[0].notices

    # ---- a tick ----------------------------------------------------------------------------------------------------

    @property
    def views(self) -> tuple[View, ...]:
        """The views to show, by side."""
        return self._last.views

    @property
    def progress(self) -> tuple[Progress, ...]:
        """The progress of the views, by side."""
        return self._last.progress

    @property
    def active(self) -> list[Renderer]:
        """The renderers at work: two while two presets are compared, else one."""
        return self.renderers[: 2 if self.options.split else 1]

    @property
    def camera(self) -> Camera:
        return self.free_camera.camera

    @property
    def at_rest(self) -> bool:
        """True if the next tick would show an equal picture."""
        filled = bool(self.views) and self.whole and all(self._at_rest(p) for p in self.progress)
        sampled = all(v.samples >= r.settings.viewer_samples for v, r in zip(self.views, self.active, strict=False))
        refined = all(self._refined(r, p) for r, p in zip(self.active, self.progress, strict=False))
        return filled and sampled and refined and self.auto_exposure.settled and self.path_recorder.recording is None

    @property
    def moving(self) -> bool:
        """True if the camera has moved since the last tick."""
        return bool(self.views) and self.views[0].camera != self.camera

    @property
    def whole(self) -> bool:
        """True if the views have the window's size. Views of a moving camera may be smaller."""
        return all(view.image.size == self.size for view in self.views)

    def _at_rest(self, progress: Progress) -> bool:
        """Return True if the cache and the picture of a side no longer change."""
        return progress.still or (self.options.frozen and progress.new == 0 and progress.complete and not progress.accumulating)

    def _refined(self, renderer: Renderer, progress: Progress) -> bool:
        """Return True if the refinement of a side has ended."""
        aim = renderer.settings.viewer_quality
        known = progress.error is not None and progress.error <= 0.01 * aim
        return not aim or known or progress.refined or self.options.frozen or not renderer.can_refine

    def tick(self, dt: float, seconds: float, waits: Callable[[], bool] = never, gather: bool = True) -> bool:
        """Advance by `dt` seconds: record the flight, and give the caches `seconds` of time. Return True if the views are new.

        waits: a call that returns True if input waits. The tick then ends early, and the views of the last tick stay. A tick that
        may free buffers of these views never ends early; without views, its budget does. gather: False if the views are drawn
        with the present records.
        """
        self.path_recorder.tick(dt, self.camera)
        subject = self._subject
        kept = self._last.subject is not None and subject[0] == self._last.subject[0]
        sizes = zip(self.views, self.active, strict=False)  # the next view of a moving camera may differ in size
        kept = kept and (self.whole or not self.moving or all(v.image.size == r.size_in_motion for v, r in sizes))
        try:
            with checked_by(waits if kept or not self.views else never, raises=kept):
                made = [self._advance(side, seconds / len(self.active), gather) for side in range(len(self.active))]
        except InputWaits:
            return False
        centres, views, progress = zip(*made, strict=True)
        self._last = _Tick(centres, views, progress, subject)
        self.auto_exposure.tick(self.renderers[0], centres[0], dt, not progress[0].done)
        if self.options.buffer == "light":
            self.brightest = brightest_light(self.renderers[0], views[0])
        return True

    def _advance(self, side: int, seconds: float, gather: bool) -> tuple[View, View, Progress]:
        """Give a side's cache `seconds` of time. Return the view with one sample a pixel, the view to show, and the progress."""
        renderer, end = self.active[side], now() + seconds
        moving = self.moving and not self.options.split
        seconds *= _MOVING if moving else 1.0
        view, progress = renderer.frame(self.camera, seconds, gather and not self.options.frozen, moving)
        centre = view
        refined, samples = self._refined(renderer, progress), renderer.settings.viewer_samples
        if progress.error is not None and not refined:
            samples = min(_FEW, samples)  # between the steps of a refinement
        if self._at_rest(progress) and any(view is one for one in self._last.centres):  # nothing has changed
            view = renderer.accumulate(view, samples, end - now())
            if view.samples >= samples and not refined:
                _, progress = renderer.refine(self.camera, 0.01 * renderer.settings.viewer_quality, end - now())
        last = self.views[side] if side < len(self.views) and self._subject == self._last.subject else view
        if progress.error is not None and last.gbuffer is view.gbuffer and view.samples < min(last.samples, samples):
            view = last  # until the refined view has enough samples
        return centre, view, progress

    @property
    def _subject(self) -> tuple[object, object]:
        """The present inputs of views, without camera and records: the inputs that determine the buffers, and further inputs."""
        renderers = [(Identity(r), r.settings) for r in self.active]
        return (renderers, self.size, light_defines(self.scene)), Identity(self.scene)

    def shows_now(self, any_camera: bool) -> bool:
        """Return True if the views show the present scene, settings and camera. any_camera: True if the camera may differ."""
        aimed = any_camera or all(view.camera == self.camera for view in self.views)
        return bool(self.views) and aimed and self._subject == self._last.subject

    # ---- sides -----------------------------------------------------------------------------------------------------

    def sides(self) -> Iterator[tuple[int, Region | None]]:
        """Yield each side on show, and its part of the window (None: the whole window)."""
        width, height = self.size
        middle = round(self.options.divider * width)
        if not self.options.split or middle in (0, width):
            yield self.side_at(0), None
            return
        yield 0, (0, 0, middle, height)
        yield 1, (middle, 0, width - middle, height)

    def side_at(self, x: float) -> int:
        """Return the side at `x`, pixels from the left."""
        return int(self.options.split and x >= round(self.options.divider * self.size[0]))

    @property
    def chosen(self) -> Renderer:
        """The renderer of the side that keys and panels change."""
        return self.active[min(self.options.side, len(self.active) - 1)]

    def source(self, side: int) -> ViewSource:
        """Return the last tick's view of a side. Raises InputError before the first tick of a scene."""
        if not self.views:
            raise InputError("there is no picture of this scene yet")
        i = side if len(self.views) == 2 and self.options.split else 0
        renderer, view = self.renderers[i], self.views[i]
        reference = self.tracing.of(Subject(self.scene, view.camera, self.size, renderer.settings.bounces))
        smoothed, scale = view.samples < min(_FEW, renderer.settings.viewer_samples), LightScale().up_to(self.brightest)
        return ViewSource(renderer, view, self.auto_exposure.stops, reference, scale, self.origin, smoothed and self.whole)

    @property
    def subject(self) -> Subject:
        """The view of the chosen side, for a reference."""
        return Subject(self.scene, self.camera, self.size, self.chosen.settings.bounces)

    # ---- changes ---------------------------------------------------------------------------------------------------

    def change(self, side: int, **values: Unpack[SettingValues]) -> None:
        """Change settings of a side; settings in _SHARED change on both sides. Raises InputError for an invalid value."""
        for renderer in self.renderers:
            own = {k: v for k, v in values.items() if k in _SHARED or renderer is self.active[min(side, len(self.active) - 1)]}
            if own:
                renderer.change(renderer.settings.with_values(own))

    def use_preset(self, name: str) -> None:
        """Change all settings of the chosen side except those in _SHARED to those of a preset."""
        self.chosen.change(preset(name, **_values(self.chosen.settings, _SHARED)), name)

    def split(self, on: bool) -> None:
        """Show two presets side by side, the present preset and paper or else paper and default; or one picture."""
        if on and len(self.renderers) == 1:
            left = self.renderers[0]
            other = "default" if left.preset == "paper" else "paper"
            shared = _values(left.settings, _SHARED)
            self.renderers.append(Renderer(self.scene, self.size, other, ctx=self.ctx, tile_size=0, **shared))
        self.options.split, self.options.divider = on, 0.5

    def pose(self, scene: Scene) -> None:
        """Show the present scene with other lights, another sky, or moved, repainted or hidden meshes.

        Stale records are gathered again in place, tick by tick. Raises the InputError of Renderer.pose, and then changes nothing.
        """
        for renderer in self.renderers:  # a scene that the first one refuses changes none
            renderer.pose(scene)
        self.scene = scene

    def resize(self, size: tuple[int, int]) -> None:
        """Change the size of the views, in pixels."""
        for renderer in self.renderers:
            renderer.resize(size)
        self.size = size
        self._last = _Tick()

    def open(self, scene: Scene, camera: Camera | None = None) -> None:
        """Show another scene with the present settings, from a camera in world space, or from its own first camera."""
        self._begin(scene, [(r.preset, overrides(r.preset, r.settings)) for r in self.renderers], camera)

    def _begin(self, scene: Scene, sides: Sequence[tuple[str, SettingValues]], camera: Camera | None) -> None:
        """Show another scene. sides: preset and settings of each renderer. camera: in world space, None for the scene's first."""
        scene = scene.recentred
        origin, scene = scene.origin, scene.local
        made: list[Renderer] = []
        try:
            for name, values in sides:
                made.append(Renderer(scene, self.size, name, ctx=self.ctx, tile_size=0, **values))
        except IrrsplatError:
            for renderer in made:
                renderer.release()
            raise
        for renderer in self.renderers:
            renderer.release()
        self.renderers, self.scene, self.origin = made, scene, origin
        self.extent = float(np.linalg.norm(np.ptp(scene.near_bounds, axis=0))) or 1.0
        self.free_camera = FreeCamera(scene.camera(), self.extent, scene.up)
        if camera is not None:
            self.free_camera.camera = camera.shifted(np.negative(origin))
        self.path_recorder, self.options.line, self.options.surface = PathRecorder(), None, None
        self.auto_exposure, self.plane.height = AutoExposure(), usual_height(scene)
        self._last = _Tick()


def overrides(name: str, settings: Settings) -> SettingValues:
    """Return the values in which `settings` differ from the preset `name`."""
    base = preset(name)
    return _values(settings, [key for key in SETTINGS if getattr(settings, key) != getattr(base, key)])


def _values(settings: Settings, names: Sequence[str]) -> SettingValues:
    return cast(SettingValues, {name: getattr(settings, name) for name in names})
