"""The benchmark's cases of one scene, preset and size, each timed from a stated state of the cache to its last pixel."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from irrsplat.app.bench import gather_truth, machine
from irrsplat.scene.model import Camera, Light, Scene

if TYPE_CHECKING:
    from irrsplat.image.view import Progress
    from irrsplat.records.cache_file import CacheState
    from irrsplat.renderer import Renderer

REPETITIONS = 3
SLOW = 3.0  # seconds: what takes longer is timed once
TURN = 5.0  # degrees, of the case "moved"
SHIFT = 0.05  # of the scene's diagonal, of the case "light"
LEGEND = """\
seconds: wall clock from the loaded scene and compiled shaders to full coverage (every pixel has its records); median of up to 3
picture: the same to the finished picture on the GPU, with direct light and the final pass; not read back
cases: empty, nothing is known; warm, the same view drawn anew with the records kept; moved, the camera turned by 5° with them;
light, a lamp moved by a twentieth of the scene's diagonal: until all records are gathered again and nothing more is asked for
rmse: of irradiance, relative to its mean, at 2000 smooth pixels with a fine gather of their own each; of more bounces than one
against what `irrsplat verify` of this view has path-traced and kept
MiB: the greatest resident set of the process, and all textures and buffers together on the GPU\
"""
QUICK = {"a": 2.0, "warmup": 8, "spread": 0.0}  # a picture that compiles everything, and is cheap


@dataclass(frozen=True)
class Run:
    """One measured case, as the benchmark's JSON has it."""

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
    memory_mib: dict[str, float | None] = field(default_factory=dict)  # "process", "gpu"


@dataclass(frozen=True)
class Timing:
    """One timed picture: wall time in seconds to full coverage and to the picture, the records in the cache at its end,
    milliseconds by stage at its end, and by round so far: (records, milliseconds by stage)."""

    seconds: float
    picture: float
    records: int
    stages: dict[str, float]
    rounds: list[tuple[int, dict[str, float]]]


def measure(renderer: Renderer, tell: Callable[[str], object] = lambda words: None) -> Iterator[tuple[Run, Timing]]:
    """The cases of one renderer, one after the other, from its scene's first camera; tell: called with words on what goes on."""
    scene, camera = renderer.scene, renderer.scene.camera()
    turned_camera, name = turned(camera, TURN), f"{renderer.scene.name} {renderer.preset}"

    def result(case: str, timings: list[Timing], seen: Camera) -> tuple[Run, Timing]:
        memory = {"process": _mib(machine.peak_memory()), "gpu": _mib(machine.gpu_memory(renderer))}
        tell(f"{name}: error of {case}")
        found = _run(renderer, case, timings, memory, error(renderer, seen)), middle(timings)
        machine.forget_peak()  # that of the truth is not the next case's
        return found

    tell(f"{name}: compiling, and a first run that does not count")
    machine.forget_peak()
    warm_up(renderer, camera)
    tell(f"{name}: empty")
    empty = from_records(renderer, camera)
    kept = records_of(renderer)
    yield result("empty", empty, camera)
    tell(f"{name}: warm")
    yield result("warm", from_records(renderer, camera, kept), camera)
    tell(f"{name}: moved")
    yield result("moved", from_records(renderer, turned_camera, kept), turned_camera)
    if scene.lights:
        tell(f"{name}: light")
        _restore(renderer, kept)
        renderer.converge(camera)
        yield result("light", relit(renderer, camera), camera)
        renderer.relight(scene.lights)
    tell("")


def warm_up(renderer: Renderer, camera: Camera) -> None:
    """A cheap picture that has everything compiled and the surface cache made; the renderer is as empty as before."""
    settings = renderer.settings
    renderer.change(settings.with_values(QUICK))
    picture(renderer, camera)
    renderer.change(settings)
    renderer.forget()


def turned(camera: Camera, degrees: float) -> Camera:
    """`camera` turned to the left about its own up axis."""
    right, up, _ = camera.axes
    forward = np.subtract(camera.target, camera.eye)
    angle = np.radians(degrees)
    x, y, z = np.asarray(camera.eye) + np.cos(angle) * forward - np.sin(angle) * np.linalg.norm(forward) * right
    return replace(camera, target=(float(x), float(y), float(z)), up=(float(up[0]), float(up[1]), float(up[2])))


def shifted(scene: Scene) -> tuple[Light, ...]:
    """The scene's lights, the first of them moved by SHIFT of the diagonal towards the middle of the scene (or, of one that has
    a direction alone, turned by as many radians)."""
    first, *others = scene.lights
    place = np.asarray(first.position, float)
    if first.directional:
        length = np.linalg.norm(place)
        moved = place / length + SHIFT * np.cross(place / length, np.eye(3)[np.abs(place).argmin()])
    else:
        toward = scene.bounds.mean(0) - place
        moved = place + toward * min(SHIFT * scene.diagonal / max(float(np.linalg.norm(toward)), 1e-9), 1.0)
    x, y, z = (float(v) for v in moved)
    return replace(first, position=(x, y, z)), *others


def from_records(renderer: Renderer, camera: Camera, kept: CacheState | None = None) -> list[Timing]:
    """Some pictures, each from the records that are `kept`; None: from nothing at all."""

    def prepare(_: int) -> None:
        if kept is None:
            renderer.scheduler.expire()  # of further bounces, what surfaces send to each other
        renderer.forget(records=kept is None, lights=kept is None)
        if kept is not None:
            _restore(renderer, kept)

    return _repeated(renderer, camera, prepare)


def records_of(renderer: Renderer) -> CacheState:
    """The records that there are, and what goes with them."""
    with renderer.ctx:
        return renderer.scheduler.state()


def _restore(renderer: Renderer, kept: CacheState) -> None:
    """Go on with these records."""
    with renderer.ctx:
        renderer.scheduler.restore(kept)


def relit(renderer: Renderer, camera: Camera) -> list[Timing]:
    """Some pictures, each after the first lamp has gone to its other place and nothing else has changed."""
    places = renderer.scene.lights, shifted(renderer.scene)
    return _repeated(renderer, camera, lambda count: renderer.relight(places[1 - count % 2]))


def _repeated(renderer: Renderer, camera: Camera, prepare: Callable[[int], object]) -> list[Timing]:
    timings: list[Timing] = []
    while len(timings) < REPETITIONS and (not timings or timings[0].seconds < SLOW):
        prepare(len(timings))
        timings.append(picture(renderer, camera))
    return timings


def middle(timings: list[Timing]) -> Timing:
    """The one that took the median time."""
    seconds = statistics.median_low(t.seconds for t in timings)
    return next(t for t in timings if t.seconds == seconds)


def picture(renderer: Renderer, camera: Camera) -> Timing:
    """One picture, timed to its last pixel; raises KeyboardInterrupt where the user ended it."""
    rounds: list[tuple[int, dict[str, float]]] = []

    def watch(progress: Progress) -> None:
        if progress.round <= 2:  # the second one splats the first one's records
            rounds.append((progress.records, renderer.timers.milliseconds()))

    start = time.perf_counter()
    _, stats = renderer.converge(camera, watch)
    with renderer.ctx:
        renderer.ctx.finish()
        seconds = time.perf_counter() - start
        if stats["interrupted"]:  # converge keeps what it has; here that is worth nothing
            raise KeyboardInterrupt
        return Timing(stats["seconds"], seconds, stats["records"], renderer.timers.milliseconds(), rounds)


def error(renderer: Renderer, camera: Camera) -> float | None:
    """The relative RMSE of irradiance against `gather_truth.truth`; None where there is none, or no light."""
    irradiance = renderer.render(camera).irradiance
    truth = gather_truth.truth(renderer, camera)
    return None if truth is None else truth.error(irradiance)


def _run(renderer: Renderer, case: str, timings: list[Timing], memory: dict[str, float | None], rmse: float | None) -> Run:
    timing = middle(timings)
    return Run(
        scene=renderer.scene.name,
        preset=renderer.preset,
        size=list(renderer.size),
        case=case,
        seconds=timing.seconds,
        records=timing.records,
        rmse=rmse,
        stages_ms=timing.stages,
        clock=renderer.timers.clock,
        bounces=renderer.settings.bounces,
        seconds_all=sorted(t.seconds for t in timings),
        picture_seconds=timing.picture,
        memory_mib=memory,
    )


def _mib(size: int | None) -> float | None:
    return None if size is None else round(size / (1 << 20), 1)
