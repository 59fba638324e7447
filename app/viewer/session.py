"""What the viewer shows and does, without window or interface: scene, renderers, camera, overlays, and a tick of it all."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import moderngl

from irrsplat.app.viewer.auto_exposure import AutoExposure
from irrsplat.app.viewer.background_truth import Truths
from irrsplat.app.viewer.input.free_camera import FreeCamera
from irrsplat.app.viewer.input.path_recorder import PathRecorder
from irrsplat.app.viewer.show import record_inspector
from irrsplat.app.viewer.show.buffer_view import BufferView
from irrsplat.app.viewer.show.legend import SHOWINGS
from irrsplat.app.viewer.show.markers import By, Markers
from irrsplat.app.viewer.show.screen import Region, clear
from irrsplat.core.errors import IrrsplatError
from irrsplat.gpu import program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target
from irrsplat.image.frame import Frame
from irrsplat.image.statistics import Statistics
from irrsplat.image.view import Progress, View, read
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera, Light, Scene
from irrsplat.settings import SETTINGS, Settings, preset

Split = Literal["off", "buffers", "presets"]
SPLITS: tuple[Split, ...] = ("off", "buffers", "presets")

_KEPT = ("budget", "exposure")  # settings that a change of the preset leaves alone


@dataclass
class ViewOptions:
    """What is shown, and over what; the interface reads and writes it."""

    buffers: list[str] = field(default_factory=lambda: ["image", "irradiance"])  # of the left side, and of the right one
    split: Split = "off"
    divider: float = 0.5  # of the window's width
    points: bool = False
    discs: bool = False
    normals: bool = False
    by_age: bool = False
    sites: bool = False
    wire: bool = False
    inspect: bool = False
    frozen: bool = False


class Session(Owner):
    """One scene on show in a context of the caller's. size: pixels. values: settings on top of the preset.

    Raises what Renderer raises; whatever fails later leaves all as it was.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        scene: Scene,
        size: tuple[int, int],
        preset: str = "default",
        values: dict[str, Any] | None = None,
        camera: Camera | None = None,
    ) -> None:
        self.ctx, self.size, self.scene = ctx, size, scene
        self.options = ViewOptions()
        self.renderers = [Renderer(scene, size, preset, ctx=ctx, **(values or {}))]  # of the left side; of the right one too
        self.buffer_view, self.markers, self.inspector = BufferView(ctx), Markers(ctx), record_inspector.RecordInspector(ctx)
        self.free_camera = FreeCamera(scene.camera(), scene.diagonal)
        if camera is not None:
            self.free_camera.go(camera)
        self.views: list[View] = []
        self.progress: list[Progress] = []
        self.ms: dict[str, float] = {}  # of the last tick by stage
        self.auto_exposure = AutoExposure()
        self._centres: list[View] = []  # the views as they were before samples beside the pixels' centres came to them
        self.path_recorder, self.truths = PathRecorder(), Truths(ctx)
        self._stepping = False
        self.held: tuple[int, int] | None = None  # the side and the name of the record that a click holds
        self._tables: dict[int, tuple[tuple[int, int], record_inspector.Table]] = {}

    # ---- a tick ----------------------------------------------------------------------------------------------------

    @property
    def active(self) -> list[Renderer]:
        """The renderers at work: two where two presets are compared."""
        return self.renderers[: 2 if self.options.split == "presets" else 1]

    @property
    def camera(self) -> Camera:
        """What is looked through now: the tape's camera while it plays, else the flight's."""
        return self.path_recorder.camera or self.free_camera.camera

    @property
    def at_rest(self) -> bool:
        """Whether another tick would show the same."""
        served = bool(self.views) and all(self._quiet(p) for p in self.progress)
        sampled = all(
            v.samples >= r.settings.viewer_samples
            for v, r in zip(self.views, self.active, strict=False)
            if r.settings.viewer_samples > 1
        )
        return served and sampled and self.auto_exposure.settled and not self._stepping and self.path_recorder.at_rest

    @property
    def exposure(self) -> float:
        """Stops, as shown on both sides; NaN before the first picture."""
        return self.auto_exposure.stops

    def _quiet(self, progress: Progress) -> bool:
        """Whether a side's cache stays as it is."""
        return progress.still or (self.options.frozen and progress.new == 0 and progress.complete)

    def tick(self, dt: float, seconds: float) -> None:
        """Go on by `dt` seconds: play, record, and give the caches `seconds` of time."""
        last = self.path_recorder.tick(dt, self.camera)
        if last is not None:
            self.free_camera.go(last)
        renderers, before = self.active, self._centres
        self.views, self.progress, self.ms, self._centres = [], [], {}, []
        for renderer in renderers:
            gather, end = self._stepping or not self.options.frozen, time.perf_counter() + seconds / len(renderers)
            view, progress = renderer.frame(self.camera, seconds / len(renderers), gather)
            self._centres.append(view)
            if self._quiet(progress) and any(view is one for one in before):  # nothing has moved since
                view = renderer.accumulate(view, renderer.settings.viewer_samples, end - time.perf_counter())
            self.views.append(view)
            self.progress.append(progress)
            for stage, ms in renderer.timers.milliseconds().items():
                self.ms[stage] = self.ms.get(stage, 0.0) + ms
        self._stepping = self._stepping and not all(p.complete for p in self.progress)
        self._let_go()
        self.auto_exposure.tick(self.renderers[0], self._centres[0], dt)

    # ---- the picture -----------------------------------------------------------------------------------------------

    def sides(self) -> Iterator[tuple[int, Region | None]]:
        """The sides on show, 0 and perhaps 1, and the part of the window that each takes (None: all of it)."""
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

    def of(self, side: int) -> tuple[Renderer, View]:
        """The renderer of a side, and its view."""
        i = side if len(self.views) == 2 and self.options.split == "presets" else 0
        return self.renderers[i], self.views[i]

    def draw(self, screen: Target, cursor: tuple[int, int] | None = None) -> record_inspector.InspectedRecord | None:
        """Draw both sides with what lies over them; the record under `cursor` (pixels, from the top left), if that is on show."""
        options = self.options
        by: By = "age" if options.by_age else "radius"
        for side, region in self.sides():
            renderer, view = self.of(side)
            name, settings = options.buffers[side], renderer.settings
            self.buffer_view.draw(
                screen,
                name,
                view,
                settings=settings,
                scene=self.scene,
                exposure=self.exposure,
                shadows=renderer.shadows,
                atlas=renderer.scheduler.gatherer.atlas,
                surface=renderer.scheduler.gatherer.surface_at(view.gbuffer) if name == "surface" else None,
                truth=self.truths.of(self.scene, view.camera, self.size, settings.bounces),
                region=region,
            )
            if SHOWINGS[name].how in ("shadow", "atlas"):
                continue
            if options.wire:
                self.markers.wireframe(screen, view, renderer.world.geometry, region=region)
            marks = (
                (options.discs, self.markers.discs),
                (options.normals, self.markers.normals),
                (options.points, self.markers.points),
            )
            for wanted, draw in marks:
                if wanted:
                    draw(screen, view, renderer.cache.records, settings=settings, scene=self.scene, by=by, region=region)
            if options.sites:
                self.markers.sites(screen, view, renderer.scheduler.gatherer.surface, exposure=self.exposure, region=region)
        found = self._inspect(screen, cursor) if options.inspect else None
        for side, region in list(self.sides())[1:]:
            assert region is not None and side
            clear(screen, (1.0, 1.0, 1.0), (region[0] - 1, 0, 2, region[3]))
        return found

    def _inspect(self, screen: Target, cursor: tuple[int, int] | None) -> record_inspector.InspectedRecord | None:
        held = self.held
        side = held[0] if held is not None else self.side_at(cursor[0]) if cursor is not None else 0
        renderer, view = self.of(side)
        table, number = self.table(renderer), renderer.cache.number_of(held[1]) if held is not None else None
        if number is None and cursor is not None:
            number = record_inspector.pick(self.buffer_view.texel, table, view, renderer.settings, *cursor)
        if number is None or number >= len(table) or renderer.shadows is None:
            return None
        settings, records = renderer.settings, renderer.cache.records
        region = dict(self.sides())[side]
        served = self.markers.serves(screen, view, records, number, settings=settings, region=region)
        site = renderer.cache.sites(slice(number, number + 1))
        world, light = renderer.world, renderer.scheduler.gatherer.light(renderer.shadows)
        gathered_by = renderer.scheduler.settings  # without bounces the last that had some
        picture = self.inspector.hemisphere(number, site, world, light, settings=gathered_by, exposure=self.exposure)
        return record_inspector.InspectedRecord(
            number, side, record_inspector.describe(number, table, view, settings), picture, served
        )

    def table(self, renderer: Renderer) -> record_inspector.Table:
        """The renderer's records on the CPU, read again where they have changed."""
        i, state = self.renderers.index(renderer), (renderer.cache.count, renderer.cache.revision)
        if i not in self._tables or self._tables[i][0] != state:
            self._tables[i] = state, record_inspector.read(renderer.cache.records)
        return self._tables[i][1]

    def hold(self, cursor: tuple[int, int]) -> None:
        """Hold the record under the cursor, or let go of the one that is held."""
        side, was = self.side_at(cursor[0]), self.held
        renderer, view = self.of(side)
        number = (
            record_inspector.pick(self.buffer_view.texel, self.table(renderer), view, renderer.settings, *cursor)
            if was is None
            else None
        )
        self.held = None if number is None else (side, renderer.cache.id_of(number))

    def point_at(self, cursor: tuple[int, int]) -> tuple[float, float, float] | None:
        """The world point seen at the cursor; None where there is none."""
        if not self.views:
            return None
        found = self.buffer_view.value("position", self.of(self.side_at(cursor[0]))[1], *cursor)
        return None if found is None else (float(found[0]), float(found[1]), float(found[2]))

    # ---- what changes ----------------------------------------------------------------------------------------------

    def change(self, side: int, **values: Any) -> None:
        """Change settings of a side; those of _KEPT hold for both. Raises InputError for what cannot be."""
        for renderer in self.renderers:
            mine = {k: v for k, v in values.items() if k in _KEPT or renderer is self._on(side)}
            if mine:
                renderer.change(renderer.settings.with_values(mine))
        self._let_go()

    def use(self, side: int, name: str) -> None:
        """Set a side to the preset `name`."""
        renderer = self._on(side)
        renderer.change(preset(name, **{key: getattr(renderer.settings, key) for key in _KEPT}), name)
        self._let_go()

    def _let_go(self) -> None:
        """Hold a record no longer that is gone."""
        if self.held is not None and self._on(self.held[0]).cache.number_of(self.held[1]) is None:
            self.held = None

    def _on(self, side: int) -> Renderer:
        return self.active[min(side, len(self.active) - 1)]

    def settings(self, side: int) -> tuple[str, Settings]:
        """The preset and settings of a side."""
        renderer = self._on(side)
        return renderer.preset, renderer.settings

    def split(self, way: Split) -> None:
        """One picture, two buffers, or two presets side by side: the left one's, and paper (beside paper: default)."""
        if way == "presets" and len(self.renderers) == 1:
            left = self.renderers[0]
            other = "default" if left.preset == "paper" else "paper"
            kept = {key: getattr(left.settings, key) for key in _KEPT}
            self.renderers.append(Renderer(self.scene, self.size, other, ctx=self.ctx, **kept))
        if way == "presets":
            self.options.buffers[1] = self.options.buffers[0]
        elif way == "buffers" and self.options.buffers[0] == self.options.buffers[1]:
            self.options.buffers[1] = "irradiance" if self.options.buffers[0] != "irradiance" else "image"
        self.options.split, self.held = way, None

    def relight(self, lights: Sequence[Light]) -> None:
        """Other lights: records are gathered again in place, tick by tick."""
        for renderer in self.renderers:
            renderer.relight(lights)
        self.scene = replace(self.scene, lights=tuple(lights))

    def resize(self, size: tuple[int, int]) -> None:
        """The window has another size, pixels."""
        for renderer in self.renderers:
            renderer.resize(size)
        self.size = size

    def open(self, scene: Scene, keep_camera: bool = False) -> None:
        """Show another scene with the same settings, from its own first camera; or from where one is, with tape and speed."""
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
        flown, self.free_camera = self.free_camera, FreeCamera(scene.camera(), scene.diagonal)
        if keep_camera:
            self.free_camera.go(flown.camera)
            self.free_camera.speed = flown.speed
        else:
            self.path_recorder = PathRecorder()
        self.views, self.progress, self.held, self._tables = [], [], None, {}

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
        """Freeze the cache, and gather one whole round in as many ticks as it takes."""
        self.options.frozen = self._stepping = True

    def frame(self) -> Frame:
        """Every buffer of the left side's view as it is now."""
        (renderer, view), progress = self.of(0), self.progress[0]
        stats = Statistics(records=progress.records, rounds=progress.round, coverage=progress.coverage, converged=progress.done)
        stats |= renderer.stats(view)
        stats["exposure"] = self.exposure
        return read(view, self.scene.sky, renderer.cache.read(), stats)

    def owned(self) -> tuple[Resource, ...]:
        """What this frees: all that is on the GPU but the context."""
        return (*self.renderers, self.buffer_view, self.markers, self.inspector, self.truths)


def overrides(name: str, settings: Settings) -> dict[str, Any]:
    """The values in which `settings` differ from the preset `name`."""
    base = preset(name)
    return {key: getattr(settings, key) for key in SETTINGS if getattr(settings, key) != getattr(base, key)}
