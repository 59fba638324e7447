"""`irrsplat bench --profile`: processor time by stage of one render from an empty cache, and of its rays alone.

Functions at the borders of stages are wrapped while a render is profiled; a stage's time excludes that of the stages in it. The
time is that of all threads, so that a software renderer's threads count. Draws are finished at each border.
"""

from __future__ import annotations

import threading
import time
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial, wraps
from importlib import import_module
from typing import Any
from unittest.mock import patch

import numpy as np

from irrsplat.app.common.terminal import columns, doing, out
from irrsplat.core.timing.clock import Clock, use_clock
from irrsplat.core.vectors import unit
from irrsplat.gather.record_frame import offset_of, tangent_frames
from irrsplat.gather.stratified import ray_directions
from irrsplat.gpu.target import pixels
from irrsplat.reference.truth import in_words
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Scene
from irrsplat.settings import All

SIZE = (400, 400)
_PYTHON = "Python (rest)"
_RAYS = "rays alone"
_SIDE = 16  # side² rays from a point of the view, for the limit
_CALL = 1 << 16  # rays per call of Embree
LEGEND = """\
seconds: processor time of all threads for the first view of a new renderer; a stage excludes the stages within it
surface: the part of the surface cache; calls: number of calls of the stage
limit: time of Embree alone, on one thread, for as many cosine-distributed rays from the surfaces of the view\
"""

# The functions of each stage, as module.class.function
_BORDERS: dict[str, tuple[str, ...]] = {
    _RAYS: ("scene.ray_caster.RayCaster.first_hits", "scene.ray_caster.RayCaster.free"),
    "shading of hits": ("gather.trace.TraceGather.__call__", "gather.plane.PlaneGather.__call__"),
    "shadow samples": ("gather.reduce.ReducePass._add", "gather.light_samples.LightSearch.__call__"),
    "sky shares": ("gather.sky_share.SkyShares.__call__",),
    "reduction": ("gather.reduce.ReducePass.__call__",),
    "surface cache": ("surface_cache.cache.SurfaceCache.advance",),
    "transport": (
        "surface_cache.transport.Transport.__init__",
        "surface_cache.transport.Transport.fill",
        "surface_cache.transport.Transport.__call__",
    ),
    "splats": ("indirect.splat.ViewSplats.update", "indirect.splat.ViewSplats.at_every_pixel"),
    "examination": (
        "indirect.examine.ExaminePass.__call__",
        "gather.spot_check.SpotPass.__call__",
        "indirect.scheduler.RecordScheduler._select",
    ),
    "radii": ("records.adaptive_radius.AdaptiveRadius.__call__",),
    "picture": (
        "renderer.stages.Stages.draw_gbuffer",
        "renderer.stages.Stages.draw_shadows",
        "renderer.stages.Stages.draw_picture",
    ),
    "shaders": ("gpu.program.Program._link",),
}
_SURFACE = "surface cache"
_TRANSFERS = "transfer"  # of data between the processor and OpenGL, and new textures
_TRANSFERRING = {
    "Texture": ("read", "write"),
    "Buffer": ("read", "write"),
    "Framebuffer": ("read",),
    "Context": ("texture", "depth_texture", "buffer"),
}


@dataclass
class _Share:
    """A stage's seconds, those within the surface cache, and calls."""

    seconds: float = 0.0
    surface: float = 0.0
    calls: int = 0


@dataclass
class Profile:
    """Processor time of the wrapped functions, of the thread that makes it. finish: waits for draws."""

    finish: Callable[[], object]
    shares: dict[str, _Share] = field(default_factory=dict)
    rays: int = 0
    _stack: list[str] = field(default_factory=lambda: [_PYTHON])
    _since: float = field(default_factory=lambda: time.process_time())  # noqa: PLW0108
    _thread: int = field(default_factory=threading.get_ident)

    def _border(self) -> None:
        """Count the time since the last border for the present stage."""
        self.finish()
        now = time.process_time()
        share = self.shares.setdefault(self._stack[-1], _Share())
        share.seconds += now - self._since
        if _SURFACE in self._stack:
            share.surface += now - self._since
        self._since = now

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the block for the stage `name`; nothing in another thread."""
        if threading.get_ident() != self._thread:
            yield
            return
        self._border()
        self._stack.append(name)
        self.shares.setdefault(name, _Share()).calls += 1
        try:
            yield
        finally:
            self._border()
            self._stack.pop()

    def wrapped(self, function: Callable[..., Any], stage: str) -> Callable[..., Any]:
        """Return the function, counted for a stage. The rays of Embree are counted as well."""

        @wraps(function)
        def call(*args: Any, **kwargs: Any) -> Any:
            with self.stage(stage):
                found = function(*args, **kwargs)
            if stage == _RAYS:
                self.rays += found.size
            return found

        return call

    @contextmanager
    def measuring(self) -> Iterator[None]:
        """Wrap the functions of all stages within the block."""
        import moderngl

        ends = [
            (getattr(import_module(f"irrsplat.{module}"), owner), name, stage)
            for stage, places in _BORDERS.items()
            for module, owner, name in (place.rsplit(".", 2) for place in places)
        ]
        ends += [(getattr(moderngl, owner), name, _TRANSFERS) for owner, names in _TRANSFERRING.items() for name in names]
        with ExitStack() as wrapped:
            for owner, name, stage in ends:
                wrapped.enter_context(patch.object(owner, name, self.wrapped(owner.__dict__[name], stage)))
            self._since = time.process_time()
            yield
            self._border()


class _CountingClock(Clock):
    """The wall clock, which counts the rays of all gathers, whoever traces them."""

    rays = 0.0

    def traced(self, rays: float) -> None:
        """Record the number of rays traced since the last call."""
        self.rays += rays


def run(scenes: Sequence[Scene], args: Namespace, bounces: int | All) -> list[dict[str, object]]:
    """Profile a first view of each scene at each size, print a table for each, and return them for the JSON."""
    return [
        _profiled(scene, (width, height), preset, bounces)
        for scene in scenes
        for width, height in args.size or [SIZE]
        for preset in args.preset or ["default"]
    ]


def _profiled(scene: Scene, size: tuple[int, int], preset: str, bounces: int | All) -> dict[str, object]:
    """Profile one scene, print its table and return it: seconds by stage, rays, limit."""
    title = f"{scene.name}, {size[0]}x{size[1]}, {preset}"
    make = partial(Renderer, scene, size=size, preset=preset, bounces=bounces, tile_size=0)
    doing(f"{title}: a first run that does not count, and one that is not profiled")
    for _ in range(2):
        with make() as renderer:
            plain = _seconds(renderer)
    doing(f"{title}: profiled")
    with make() as renderer, use_clock(clock := _CountingClock()):
        hardware = renderer.timers.clock == "gpu"
        profile = Profile((lambda: None) if hardware else renderer.ctx.finish)
        with profile.measuring():
            whole = _seconds(renderer)
        rays = profile.rays or round(clock.rays)
        gpu = renderer.timers.milliseconds() if hardware else {}
        limit = _limit(renderer, rays) if profile.rays else None
        records = renderer.cache.count
    doing("")
    stages = {name: {"seconds": s.seconds, "surface": s.surface, "calls": s.calls} for name, s in profile.shares.items()}
    out(f"\n{title}, {in_words(bounces)}")
    out("\n".join(_table(profile, whole, plain, rays, limit)))
    for name, ms in gpu.items():
        out(f"on the GPU, {name}: {ms:.1f} ms")
    about: dict[str, object] = {"scene": scene.name, "preset": preset, "size": list(size), "bounces": bounces}
    measured = {"records": records, "rays": rays, "seconds": plain, "profiled_seconds": whole, "limit_seconds": limit}
    return about | measured | {"stages": stages, "gpu_ms": gpu}


def _seconds(renderer: Renderer) -> float:
    """Render the scene's first view; return the seconds of processor time."""
    start = time.process_time()
    renderer.converge()
    with renderer.ctx:
        renderer.ctx.finish()
    return time.process_time() - start


def _limit(renderer: Renderer, rays: int) -> float:
    """Return the seconds in which Embree traces as many rays from the surfaces of the view, on one thread."""
    with renderer.ctx:
        gbuffer = renderer.gbuffer
        assert gbuffer is not None
        position, normal = (pixels(texture)[..., :3].reshape(-1, 3) for texture in (gbuffer.position, gbuffer.normal))
    seen = np.flatnonzero(normal.any(1))
    random, directions = np.random.default_rng(1), ray_directions(_SIDE).reshape(-1, 3).astype(np.float32)
    caster, seconds, left = renderer.world.caster, 0.0, rays
    while left > 0 and len(seen):
        some = random.choice(seen, min(_CALL, left) // len(directions) + 1)
        N = unit(normal[some])
        frames = tangent_frames(N, random.integers(0, 1 << 20, len(some)), 1).astype(np.float32)
        toward = np.ascontiguousarray((directions @ frames).reshape(-1, 3))
        origins = np.repeat(position[some] + N * np.float32(offset_of(renderer.scene)), len(directions), axis=0)
        start = time.process_time()
        caster.run(origins, toward)
        seconds += time.process_time() - start
        left -= len(toward)
    return seconds * rays / (rays - left) if rays else 0.0


def _table(profile: Profile, whole: float, plain: float, rays: int, limit: float | None) -> Iterator[str]:
    """Yield the lines of a profile, the greatest stage first."""
    rows = [("stage", "seconds", "share", "surface", "calls")]
    for name, share in sorted(profile.shares.items(), key=lambda one: -one[1].seconds):
        rows.append((name, f"{share.seconds:.3f}", f"{share.seconds / whole:.0%}", f"{share.surface:.3f}", str(share.calls)))
    rows.append(("all, with the profile", f"{whole:.3f}", "", "", ""))
    rows.append(("all, without it", f"{plain:.3f}", "", "", ""))
    if limit is not None:
        rows.append(("limit", f"{limit:.3f}", "", "", ""))
    yield from columns(rows, left=1)
    ratio = "" if not limit else f"; {plain / limit:.1f} times the limit"
    yield f"{rays} rays{ratio}"
