"""The library's renderer: frames, whole renders and scene changes, in world space and any OpenGL context.

Read `Frames.frame` (frames.py) for the frame, and `render` (whole_renders.py) for a render.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Unpack, cast
from weakref import WeakMethod

import moderngl
import numpy as np
import numpy.typing as npt

from irrsplat.core import files
from irrsplat.core.buffers import GBuffer, ShadowMaps
from irrsplat.core.errors import InputError
from irrsplat.core.paths import named
from irrsplat.gpu import context, self_test
from irrsplat.gpu.resource import Tenant
from irrsplat.gpu.target import Screen, pixels
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.image.antialias import OnProgress
from irrsplat.image.frame import Frame
from irrsplat.image.statistics import Statistics
from irrsplat.image.view import Progress, View
from irrsplat.indirect.scheduler import RecordScheduler
from irrsplat.indirect.splat import ViewSplats
from irrsplat.lighting import gl_limits
from irrsplat.records import cache_file
from irrsplat.records.record_cache import RecordCache
from irrsplat.renderer import tiles, whole_renders
from irrsplat.renderer.frames import Frames
from irrsplat.renderer.state import State
from irrsplat.scene.model import Camera, Light, Material, Scene
from irrsplat.scene.model.checks import check_callback, check_type, checked_number
from irrsplat.scene.motion import moved, posed, repainted
from irrsplat.settings import Settings, SettingValues
from irrsplat.settings import preset as settings_of


class Renderer(Tenant):
    """Renderer of the views of one scene, with the irradiance records that these views requested.

    scene: a result of `irrsplat.load`. size: (width, height) in pixels. preset: a name of settings.PRESETS, and any
    setting by name on top of it. ctx: a moderngl context to use, which its owner makes current before each call (default: a new
    one without a window, current after every call). tile_size: pixels along a side of the tiles that `render` draws pictures in,
    with the same records and pixels, in less memory; 0: it draws them whole. Default: tiles where memory, or OpenGL's largest
    texture, is too small for anything else. All calls but `render` need whole views.
    A scene that lies far from 0 0 0 is drawn relative to an origin near by (Scene.origin): buffers of a View and the cache's
    records are relative to that; cameras, lights, moves and the Frame of `render` are in world space.
    Raises InputError for an unsupported size or setting. Raises GLError without OpenGL 3.3, if OpenGL fails the self-test, and in
    every call while another context than `ctx` is current.
    It works in the thread and the process that made it; elsewhere, and in a process forked from one that uses OpenGL, calls raise
    GLError. Each thread, and each process that was spawned, may make its own.
    Use it in a `with` block, or call `release`, to free its GPU memory.
    """

    def __init__(
        self,
        scene: Scene,
        size: tuple[int, int] = (800, 800),
        preset: str = "default",
        ctx: moderngl.Context | None = None,
        tile_size: int | None = None,
        **settings: Unpack[SettingValues],
    ) -> None:
        tile_size = tiles.checked_tile_size(tile_size)
        if not isinstance(scene, Scene):
            raise InputError(f"a Renderer takes a Scene, as irrsplat.load returns it, not {type(scene).__name__}")
        scene = scene.recentred
        self._origin, scene = scene.origin, scene.local  # only the callers' values are not relative to the origin
        state = State(scene, settings_of(preset, **settings), preset, tiles.checked_size(size), tile_size=tile_size)
        self._loaded = scene.meshes  # as they were before any of them moved
        with self._moving_in(ctx):
            self_test.numbers_triangles(self.ctx)
            state = tiles.checked(state, self.ctx, again=True)
            self.timers = Timers(self.ctx, bool(self.about["software"]), enabled=True)
            self.world = self.own(World(self.ctx, scene))
            self.cache = self.own(RecordCache(self.ctx))
            self.scheduler = self.own(RecordScheduler(self.world, state.settings, self.cache, self.timers))
            self._frames = self.own(Frames(self.world, self.scheduler, self.timers, state, WeakMethod(self._read)))
            self.stages = self._frames.stages

    # ---- the present state ------------------------------------------------------------------------------------------

    @property
    def scene(self) -> Scene:
        """The scene as it is now: its lights and meshes may have changed since it was loaded."""
        return self._frames.state.scene.placed(self._origin)

    @property
    def settings(self) -> Settings:
        """The present settings."""
        return self._frames.state.settings

    @property
    def preset(self) -> str:
        """The preset's name."""
        return self._frames.state.preset

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a view in pixels."""
        return self._frames.state.size

    @property
    def shadows(self) -> ShadowMaps | None:
        """The shadow maps of the scene as it is now; None before they are drawn."""
        return self.stages.shadows(self._frames.state)

    @property
    def gbuffer(self) -> GBuffer | None:
        """The g-buffer of the present view; None before it is drawn."""
        return self.stages.gbuffer

    @property
    def notices(self) -> tuple[str, ...]:
        """One-line remarks for a user on parts of the scene that cannot be shown; the scene has notices of its own."""
        return (
            *tiles.notices(self._frames.state),
            *gl_limits.shadow_notices(self.ctx, self._frames.state.scene, self.settings.shadow_size),
            *self.stages.maps.notices(self.world.runs),
            *self.world.materials.notices,
        )

    @property
    def splats(self) -> ViewSplats:
        """The splat buffer of the present view."""
        return self.stages.splats(self._frames.state)

    def draw_shadows(self) -> ShadowMaps:
        """Return the shadow maps of the present scene."""
        return self.stages.draw_shadows(self._frames.state)

    def draw_gbuffer(self, camera: Camera) -> GBuffer:
        """Return the g-buffer of `camera`; its positions are relative to the scene's origin."""
        check_type("a camera", camera, Camera)
        return self.stages.draw_gbuffer(self._frames.state, self._seen_by(camera))

    def read_direct_irradiance(self, camera: Camera | str | None = None) -> np.ndarray:
        """Return (H, W, 3) the direct irradiance at pixels' centres, W/m², top row first; 0 without a surface.

        The reflectance does not matter. camera: see `render`.
        """
        self._use_whole()
        gbuffer = self.draw_gbuffer(self.scene.camera(camera))
        return pixels(self.stages.direct_irradiance(self._frames.state, gbuffer))[..., :3].copy()

    def direct_irradiance(self, view: View) -> moderngl.Texture:
        """Return the direct irradiance at every pixel of the present `view`, W/m²: a texture."""
        check_type("a view", view, View)
        return self.stages.direct_irradiance(self._frames.state, view.gbuffer)

    def _use_whole(self) -> None:
        """Make its context the current one, to draw whole views; raises InputError where they are drawn in tiles."""
        self._use()
        tiles.check_whole(self._frames.state)

    def _seen_by(self, camera: Camera | str | None) -> Camera:
        """Return a caller's camera relative to the origin."""
        found = self.scene.camera(camera)
        return found.shifted(np.negative(self._origin)) if any(self._origin) else found

    # ---- the frame -------------------------------------------------------------------------------------------------

    def frame(
        self,
        camera: Camera | str | None = None,
        seconds: float | None = None,
        gather: bool = True,
        moving: bool = False,
    ) -> tuple[View, Progress]:
        """Draw one round: the g-buffer, splats of new records, a gather where no record covers a pixel, and the composite.

        seconds: the frame budget in wall time; the remaining records are gathered in the next call (None: a complete round).
        gather: False leaves the cache as it is. Unchanged buffers are not drawn again. Some ticks only gather, and return the
        last view, while only new records differ and pictures take much of the budget.
        moving: True if the camera moves on; the view is then smaller than `size` if pictures take longer than `seconds`.
        """
        self._use_whole()
        return self._frames.frame(self._seen_by(camera), seconds, gather, moving)

    @property
    def size_in_motion(self) -> tuple[int, int]:
        """Width and height of the next view of a moving camera, pixels."""
        return self._frames.size_in_motion

    def refine(self, camera: Camera | str | None, target: float, seconds: float | None = None) -> tuple[View, Progress]:
        """Refine a complete view until its estimated relative RMSE of indirect irradiance is at most `target`.

        Return the view and its progress. An incomplete view gets its next `frame`. seconds: the limit of wall time; None: no
        limit. The picture changes step by step. The added records are removed when another view is drawn. A view by the paper's
        placement, or without bounces, stays as it is.
        """
        self._use_whole()
        target = checked_number("target", target, 0.0)
        return self._frames.refine(self._seen_by(camera), target, seconds)

    @property
    def can_refine(self) -> bool:
        """True if these settings allow `refine`."""
        return self._frames.can_refine

    def _read(self, view: View) -> Frame:
        """Return a view's frame, see View.read."""
        self._use()
        return whole_renders.read(self._frames, view).placed(self._origin)

    def accumulate(self, view: View, samples: int, seconds: float | None = None, on_progress: OnProgress | None = None) -> View:
        """Return the `view` that `frame` gave last with `samples` a pixel, or with as many more than last time as `seconds` has.

        At least one stage of a sample is drawn, and the next call continues there. The cache is left as it is.
        on_progress: called with the share done, 0..1, after each sample. Raises InputError for a view of an earlier camera or of
        another size.
        """
        self._use()
        self._frames.check_present(view)
        check_callback("on_progress", on_progress)
        samples = int(checked_number("samples", samples, 0.0))
        return self.stages.accumulate(self._frames.state, view, samples, Budget(seconds), on_progress)

    def show(self, view: View, framebuffer: moderngl.Framebuffer, exposure: float | None = None) -> None:
        """Draw the image of a `view` that `frame` gave last into a framebuffer of the same size, such as a window's: exposed,
        filmic, sRGB. exposure: stops; None: by the settings; "auto" among them waits for the GPU.

        Pixels without a surface show a sky, or black. Framebuffer, viewport, depth test and blending are left changed. Raises
        InputError for a framebuffer of another size.
        """
        self._use()
        check_type("a view", view, View)
        check_type("a framebuffer", framebuffer, moderngl.Framebuffer)
        if tuple(framebuffer.size) != view.image.size:
            raise InputError(f"the framebuffer has {framebuffer.size} pixels and the view {view.image.size}; resize the renderer")
        if exposure is None:
            exposure = self.stops(view)
        self._frames.composite_pass(view).show(view.image, checked_number("an exposure", exposure), Screen(framebuffer))

    def stops(self, view: View) -> float:
        """Return the exposure of a view in stops by the settings."""
        check_type("a view", view, View)
        return self._frames.stops(view)

    # ---- changes ---------------------------------------------------------------------------------------------------

    def change(self, settings: Settings, preset: str = "") -> None:
        """Apply other settings (called `preset` in the stats).

        Records are gathered again in place if their light depends on a change, and removed if their places do. Raises InputError
        for settings that this OpenGL does not support.
        """
        check_type("what a renderer changes to", settings, Settings)
        self._change_to(replace(self._frames.state, settings=settings, preset=preset or self.preset))

    def relight(self, lights: Sequence[Light]) -> None:
        """Apply other lights.

        Records are scaled if all light changes by one factor per channel. Otherwise probes correct them, and those that change
        by more than 2 % are gathered again in place. Raises InputError for too many lights.
        """
        self._change_to(replace(self._frames.state, scene=replace(self.scene, lights=cast(tuple[Light, ...], lights)).local))

    def move(self, mesh: int | str, transform: npt.ArrayLike) -> None:
        """Move a mesh (its index in scene.meshes, or its name) by a 4×4 or 3×4 matrix from its loaded position.

        Records on the mesh move along. Records within the mesh are removed. Other affected records are gathered again in place.
        Raises InputError for an unknown mesh, and for a matrix that is not affine, or singular.
        """
        self._change_to(replace(self._frames.state, scene=moved(self.scene, self._loaded, mesh, transform).local))

    def repaint(self, mesh: int | str, material: Material) -> None:
        """Apply another material to a mesh (its index in scene.meshes, or its name): other colours or another emission.

        Probes correct the records, and those that change by more than 2 % are gathered again in place. An emissive mesh becomes
        an area light.
        Raises InputError for an unknown mesh, and for a material with other textures, transmission or faces: load such a scene
        anew.
        """
        check_type("what a mesh is repainted with", material, Material)
        self._change_to(replace(self._frames.state, scene=repainted(self._frames.state.scene, mesh, material)))

    def pose(self, scene: Scene) -> None:
        """Apply another pose of the scene: meshes moved, repainted or hidden (scene.motion.hidden), other lights, another sky.

        One call replaces `move`, `repaint` and `relight`, with their errors. Raises InputError for a scene of other meshes.
        """
        check_type("a pose", scene, Scene)
        self._change_to(replace(self._frames.state, scene=posed(self.scene, scene.relative_to(self._origin)).local))

    def resize(self, size: tuple[int, int]) -> None:
        """Change the size (width, height) of views; the records stay. Raises InputError for an unsupported size."""
        self._change_to(replace(self._frames.state, size=tiles.checked_size(size)))

    def _change_to(self, state: State) -> None:
        """Change scene, size or settings; if the change is refused, all of them stay as before."""
        self._use()
        self._frames.change_to(tiles.checked(state, self.ctx, again=state.size != self.size))

    def forget(self, records: bool = True, lights: bool = True) -> None:
        """Draw every buffer of the view again next time; without the present `records`, and the `lights`' shadow maps."""
        self._use()
        self._frames.forget(shadows=lights)
        if records:
            self.cache.truncate(0)

    # ---- files -----------------------------------------------------------------------------------------------------

    def save_cache(self, path: files.Pathlike) -> None:
        """Write the records to a file, whole or not at all; `load_cache` continues from it bit for bit.

        Raises InputError for a path that cannot be written, IrrsplatError if writing fails.
        """
        self._use()
        files.check_file(named(path))
        cache_file.write(path, cache_file.key(self._frames.state.scene, self.scheduler.settings), self.scheduler.state())

    def load_cache(self, path: files.Pathlike, update: bool = False) -> str:
        """Replace the records by those of a file.

        update: accept records of another state of the scene, or of other materials or lights. Records on meshes that have moved
        or are gone are removed; all others are gathered again when a view is rendered. Return the difference as a text; empty if
        there is none.
        Raises InputError, and changes nothing, for a file that is missing, damaged or no record cache. The same holds for records
        of other settings (cache_file.key lists them) and, without `update`, of another scene or other lights.
        """
        self._use()
        self._frames.refiner.leave()
        key = cache_file.key(self._frames.state.scene, self.scheduler.settings)
        found, reason = cache_file.read(named(path), key, update)
        self.scheduler.restore(cache_file.carried_over(found, key) if reason else found.state)
        if reason:
            self.cache.invalidate()
        self.forget(records=False)
        return reason

    # ---- whole renders ---------------------------------------------------------------------------------------------

    def converge(
        self,
        camera: Camera | str | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> tuple[View, Statistics]:
        """Draw rounds until the examination finds no request, at most MOST_ROUNDS; return the view and its statistics.

        "seconds" among them is the wall time to full coverage, before direct light and composite. progress is called after
        each round. Ctrl-C ends the rounds: the last complete one counts, "interrupted" is True.
        """
        self._use_whole()
        check_callback("progress", progress)
        self._frames.refiner.leave()
        done, stats = whole_renders.filled(self._frames, self._seen_by(camera), progress)
        return self.stages.draw_picture(self._frames.state, done), stats

    def render(
        self,
        camera: Camera | str | None = None,
        progress: Callable[[Progress], None] | None = None,
        figures: bool = False,
        buffers: Collection[str] | None = None,
        gather: bool = True,
    ) -> Frame:
        """Render the view from `camera` (or the scene's of that name; default: its first) until records cover every pixel.

        With a `quality` in the settings, refine the view until its estimated error is no greater. Return a Frame of numpy arrays
        that the caller owns. Records of earlier views are used again: only missing records are gathered.

        progress: called after each round. figures: True fills Frame.figures with the paper's figures 1, 3 and 4 too.
        buffers: names of those that the frame holds (default: all); the others are empty.
        gather: False leaves the cache as it is, so that the view depends on records, camera and settings alone, to the bit, and
        not on earlier views; stats["uncovered"] counts the pixels that no record covers, which take the light around
        them unless the setting `fill_holes` is off.
        Ctrl-C ends the rounds, or the samples, early: stats["converged"] is False then. The remaining tiles of a picture in
        tiles get one sample a pixel; a second Ctrl-C ends the render without a frame.
        Raises InputError for `figures`, or a `quality` among the settings, without `gather`: both need further records.
        """
        self._use()
        frame = whole_renders.render(self._frames, self._seen_by(camera), progress, figures, buffers, gather)
        if self._owns_ctx:  # nobody else causes errors in it
            context.check_errors(self.ctx)
        return frame.placed(self._origin)

    def coverage(self, camera: Camera | str | None = None) -> float:
        """Return the share of the pixels with a surface, 0..1, at which `camera` requests no record; the cache stays as it is."""
        self._use_whole()
        self._frames.refiner.leave()
        return self._frames.frozen(self._seen_by(camera)).progress.coverage


def render(
    scene: Scene,
    size: tuple[int, int] = (800, 800),
    camera: Camera | str | None = None,
    preset: str = "default",
    **settings: Unpack[SettingValues],
) -> Frame:
    """Render one view of `scene`, headless, until records cover every pixel; arguments and errors: see `Renderer`."""
    with Renderer(scene, size, preset, **settings) as renderer:
        return renderer.render(camera)
