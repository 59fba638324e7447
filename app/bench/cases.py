"""Benchmark cases of one scene, preset and size: time from a defined cache state to the last pixel; and the machine."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from irrsplat import __version__
from irrsplat.app.bench import gather_truth
from irrsplat.app.common.terminal import doing
from irrsplat.core.vectors import vector
from irrsplat.records.cache_file import CacheState
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera, Light, Scene

REPETITIONS = 3
SLOW = 3.0  # seconds: longer cases run once
TURN = 5.0  # degrees, of the case "moved"
SHIFT = 0.05  # share of the scene's diagonal, of the case "light"
LEGEND = """\
seconds: wall time from the loaded scene and compiled shaders to full coverage (every pixel has its records); median of up to 3
picture: wall time to the finished picture on the GPU, with direct light and the final pass, without read-back
cases: empty, without records; warm, the same view with records; moved, the camera turned by 5° with records;
light, a light moved by a twentieth of the scene's diagonal: until all records are gathered again and no pixel requests one
rmse: of irradiance, relative to its mean, at 2000 smooth pixels, against fine gathers; for several bounces, against
the paths that `irrsplat verify` has traced of this view\
"""
QUICK = {"a": 2.0, "warmup": 8, "spread": 0.0}  # a cheap picture that compiles all shaders


@dataclass(frozen=True)
class Run:
    """One measured case, an entry of the benchmark's JSON."""

    scene: str
    preset: str
    size: list[int]
    case: str
    seconds: float
    records: int
    rmse: float | None
    stages_ms: dict[str, float]
    clock: str
    bounces: int | str = 1
    seconds_all: list[float] = field(default_factory=list)  # of every repetition
    picture_seconds: float | None = None


@dataclass(frozen=True)
class Timing:
    """Timing of one picture.

    seconds: wall time to full coverage. picture: wall time to the picture; processor: in processor time. records: final cache
    size. stages: milliseconds by stage.
    """

    seconds: float
    picture: float
    records: int
    stages: dict[str, float]
    processor: float


def measure(renderer: Renderer) -> Iterator[Run]:
    """Yield the cases of one renderer from its scene's first camera."""
    scene, camera = renderer.scene, renderer.scene.camera()
    turned_camera, name = turned(camera, TURN), f"{renderer.scene.name} {renderer.preset}"
    doing(f"{name}: compiling, and a first run that does not count")
    warm_up(renderer, camera)
    doing(f"{name}: empty")
    empty = from_records(renderer, camera)
    kept = records_of(renderer)
    yield _run(renderer, "empty", empty, camera)
    doing(f"{name}: warm")
    yield _run(renderer, "warm", from_records(renderer, camera, kept), camera)
    doing(f"{name}: moved")
    yield _run(renderer, "moved", from_records(renderer, turned_camera, kept), turned_camera)
    if scene.lights:
        doing(f"{name}: light")
        _restore(renderer, kept)
        renderer.converge(camera)
        yield _run(renderer, "light", relit(renderer, camera), camera)
        renderer.relight(scene.lights)
    doing("")


def warm_up(renderer: Renderer, camera: Camera, surface: bool = True) -> None:
    """Render a cheap picture to compile all shaders and build the surface cache, unless `surface` is False; leave the renderer
    empty."""
    settings = renderer.settings
    renderer.change(settings.with_values(QUICK if surface else {**QUICK, "bounces": 1}))
    picture(renderer, camera)
    renderer.change(settings)
    renderer.forget()


def turned(camera: Camera, degrees: float) -> Camera:
    """Return `camera` turned to the left about its up axis."""
    right, up, _ = camera.axes
    forward = np.subtract(camera.target, camera.eye)
    angle = np.radians(degrees)
    target = np.asarray(camera.eye) + np.cos(angle) * forward - np.sin(angle) * np.linalg.norm(forward) * right
    return replace(camera, target=vector(target), up=vector(up))


def shifted(scene: Scene) -> tuple[Light, ...]:
    """Return the scene's lights with the first one moved by SHIFT of the diagonal towards the scene's centre.

    A directional light is turned by as many radians.
    """
    first, *others = scene.lights
    place = np.asarray(first.position, float)
    if first.directional:
        length = np.linalg.norm(place)
        moved = place / length + SHIFT * np.cross(place / length, np.eye(3)[np.abs(place).argmin()])
    else:
        toward = scene.bounds.mean(0) - place
        moved = place + toward * min(SHIFT * scene.diagonal / max(float(np.linalg.norm(toward)), 1e-9), 1.0)
    return replace(first, position=vector(moved)), *others


def from_records(renderer: Renderer, camera: Camera, kept: CacheState | None = None) -> list[Timing]:
    """Time several pictures, each from the records `kept`, or from an empty cache for None."""

    def prepare(_: int) -> None:
        if kept is None:
            renderer.scheduler.expire()  # light between surfaces, for further bounces
        renderer.forget(records=kept is None, lights=kept is None)
        if kept is not None:
            _restore(renderer, kept)

    return _repeated(renderer, camera, prepare)


def records_of(renderer: Renderer) -> CacheState:
    with renderer.ctx:
        return renderer.scheduler.state()


def _restore(renderer: Renderer, kept: CacheState) -> None:
    with renderer.ctx:
        renderer.scheduler.restore(kept)


def relit(renderer: Renderer, camera: Camera) -> list[Timing]:
    """Time several pictures, each after a move of the first light and no other change."""
    places = renderer.scene.lights, shifted(renderer.scene)
    return _repeated(renderer, camera, lambda count: renderer.relight(places[1 - count % 2]))


def _repeated(renderer: Renderer, camera: Camera, prepare: Callable[[int], object]) -> list[Timing]:
    timings: list[Timing] = []
    while len(timings) < REPETITIONS and (not timings or timings[0].seconds < SLOW):
        prepare(len(timings))
        timings.append(picture(renderer, camera))
    return timings


def middle(timings: list[Timing]) -> Timing:
    """Return the timing with the median time."""
    return sorted(timings, key=lambda timing: timing.seconds)[(len(timings) - 1) // 2]


def picture(renderer: Renderer, camera: Camera) -> Timing:
    """Time one picture to its last pixel; raise KeyboardInterrupt if the user interrupts."""
    start, processor = time.perf_counter(), time.process_time()
    _, stats = renderer.converge(camera)
    with renderer.ctx:
        renderer.ctx.finish()
        seconds = time.perf_counter() - start
        if stats["interrupted"]:  # converge keeps a partial result, which is useless here
            raise KeyboardInterrupt
        processor = time.process_time() - processor
        return Timing(stats["seconds"], seconds, stats["records"], renderer.timers.milliseconds(), processor)


def _run(renderer: Renderer, case: str, timings: list[Timing], camera: Camera) -> Run:
    """Return a measured case, with the error against `gather_truth.truth`."""
    doing(f"{renderer.scene.name} {renderer.preset}: error of {case}")
    irradiance = renderer.render(camera).irradiance
    truth = gather_truth.truth(renderer, camera)
    timing = middle(timings)
    return Run(
        scene=renderer.scene.name,
        preset=renderer.preset,
        size=list(renderer.size),
        case=case,
        seconds=timing.seconds,
        records=timing.records,
        rmse=None if truth is None else truth.error(irradiance),
        stages_ms=timing.stages,
        clock=renderer.timers.clock,
        bounces=renderer.settings.bounces,
        seconds_all=sorted(t.seconds for t in timings),
        picture_seconds=timing.picture,
    )


def machine(gl: Mapping[str, object]) -> dict[str, object]:
    """Return the machine for the benchmark's JSON; gl: result of `gpu.context.describe`."""
    return {
        **{key: gl[key] for key in ("renderer", "vendor", "version", "software")},
        "platform": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "cpus": os.cpu_count(),
        "python": platform.python_version(),
        "irrsplat": __version__,
    }
