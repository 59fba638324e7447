"""`irrsplat bench`: how long a picture takes, as published and by ours, from an empty cache and from a kept one."""

from __future__ import annotations

import json
import os
import platform
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from irrsplat.app.parser import version
from irrsplat.app.terminal import columns
from irrsplat.scene.model import Camera, Scene

DEFAULT_SCENES = ("cornell-paper",)
PRESETS = ("paper", "default")
REPETITIONS = 3
SLOW = 5.0  # seconds: what takes longer is timed once
TURN = 5.0  # degrees, of the case "moved"
LEGEND = """\
seconds: wall clock from the loaded scene and compiled shaders to full coverage (every pixel has its records); median of up to 3
picture: the same to the finished picture on the GPU, with direct light and the final pass; not read back
one bounce of indirect light, as the paper has it; the flights are the viewer's own, with all of them
cases: empty, nothing is known; warm, the same view drawn anew with the records kept; moved, the camera turned by 5° with them
rmse: of irradiance from empty, relative to its mean, at some hundred smooth pixels with a gather of their own each\
"""
PUBLISHED = "published (Jones 2010: GeForce 8800 GT, 800x800)"
# the paper's rows: name, milliseconds, records (section 4)
ROWS: tuple[tuple[str, float, int | None], ...] = (
    ("first samples", 1110.0, 1000),
    ("direct illumination", 1.95, None),
    ("splat of the first samples", 19.5, 1000),
    ("traversal and new records", 1040.0, 511),
    ("splat of the new records", 1.07, 511),
    ("final pass", 2.03, None),
)


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


@dataclass(frozen=True)
class Timing:
    """One timed picture: wall time in seconds to full coverage and to the picture, the records in the cache at its end,
    milliseconds by stage at its end, and by round so far: (records, milliseconds by stage)."""

    seconds: float
    picture: float
    records: int
    stages: dict[str, float]
    rounds: list[tuple[int, dict[str, float]]]

    @property
    def rows(self) -> list[tuple[float, int | None]]:
        """Milliseconds and records of the paper's ROWS: what the first round gathers are the first samples."""
        first, early = self.rounds[0] if self.rounds else (0, {})
        second = self.rounds[1][1] if len(self.rounds) > 1 else self.stages
        new, end = self.records - first, self.stages

        def ms(stages: dict[str, float], *names: str) -> float:
            return sum(stages.get(name, 0.0) for name in names)

        return [
            (ms(early, "gather", "reduce"), first),
            (ms(end, "direct"), None),
            (ms(second, "splat") - ms(early, "splat"), first),
            (ms(end, "examine", "gather", "reduce", "adapt") - ms(early, "gather", "reduce"), new),
            (ms(end, "splat") - ms(second, "splat"), new),
            (ms(end, "composite"), None),
        ]


def run(scenes: Sequence[str], size: tuple[int, int], json_path: str | None) -> int:
    """Time the scenes (paths or names; none: DEFAULT_SCENES), print tables, write JSON where asked for; the exit status."""
    import irrsplat
    from irrsplat.output import write_text

    loaded = [irrsplat.load(name) for name in scenes or DEFAULT_SCENES]
    machine: dict[str, Any] = {}
    runs: list[Run] = []
    pictures: list[float] = []
    for scene in loaded:
        first = len(runs)
        rows: dict[str, list[tuple[float, int | None]]] = {}
        for preset in PRESETS:
            with irrsplat.Renderer(scene, size=size, preset=preset, bounces=1) as renderer:
                if not machine:
                    machine = _machine(renderer.about)
                    print(f"{size[0]}x{size[1]} on {machine['renderer']}, {machine['cpus']} CPUs")
                    print(LEGEND)
                for result, timing in measure(renderer):
                    runs.append(result)
                    pictures.append(timing.picture)
                    if result.case == "empty":
                        rows[preset] = timing.rows
        print()
        print("\n".join(_cases(runs[first:], pictures[first:])))
        print()
        print("\n".join(_stages(scene.name, rows, runs[first].clock)))
        print()
        flown = _flown(scene, (size[0], max(1, round(0.75 * size[0]))), runs[first].clock)
        for result in flown:
            runs.append(result)
            pictures.append(result.seconds)
    if json_path is not None:
        write_text(json_path, json.dumps({"machine": machine, "runs": [asdict(r) for r in runs]}, indent=2) + "\n")
    return 0


def _flown(scene: Scene, size: tuple[int, int], clock: str) -> list[Run]:
    """The flight through the window: prints its table; two runs a case, the middle frame and the worst one."""
    from irrsplat.app import flythrough

    print(f"{scene.name}, flight of {flythrough.FRAMES} frames, {size[0]}x{size[1]}")
    print(flythrough.LEGEND)
    rows = [("flight", "median ms", "worst ms", "fps", "new records", "records", "first picture s")]
    runs: list[Run] = []
    for flown in flythrough.fly(scene, size, flythrough.FRAMES):
        _say("")
        cells = f"{flown.median:.0f}", f"{flown.worst:.0f}", f"{1e3 / flown.median:.0f}", str(flown.new), str(flown.records)
        rows.append((flown.case, *cells, f"{flown.first:.2f}"))
        for word, ms in (("", flown.median), (" worst", flown.worst)):
            case = f"flight {flown.case}{word}"
            runs.append(Run(scene.name, "default", list(size), case, 1e-3 * ms, flown.records, None, flown.stages, clock))
        _say(f"{scene.name}: filling the cache, then the second flight")
    _say("")
    print("\n".join(columns(rows, left=1)))
    return runs


def measure(renderer: Any) -> Iterator[tuple[Run, Timing]]:
    """The three cases of one scene and preset, one after the other."""
    camera: Camera = renderer.scene.camera()
    name = f"{renderer.scene.name} {renderer.preset}"

    def result(case: str, timing: Timing, rmse: float | None = None) -> tuple[Run, Timing]:
        return (
            Run(
                renderer.scene.name,
                renderer.preset,
                list(renderer.size),
                case,
                timing.seconds,
                timing.records,
                rmse,
                timing.stages,
                renderer.timers.clock,
            ),
            timing,
        )

    _say(f"{name}: compiling, and a first run that does not count")
    _picture(renderer, camera)
    _say(f"{name}: empty")
    empty = _median(renderer, camera, records=0)
    _say(f"{name}: error")
    yield result("empty", empty, _error(renderer, camera))
    _say(f"{name}: warm")
    yield result("warm", _median(renderer, camera, records=empty.records))
    _say(f"{name}: moved")
    yield result("moved", _median(renderer, turned(camera, TURN), records=empty.records))
    _say("")


def turned(camera: Camera, degrees: float) -> Camera:
    """`camera` turned to the left about its own up axis."""
    right, up, _ = camera.axes
    forward = np.subtract(camera.target, camera.eye)
    angle = np.radians(degrees)
    x, y, z = np.asarray(camera.eye) + np.cos(angle) * forward - np.sin(angle) * np.linalg.norm(forward) * right
    return replace(camera, target=(float(x), float(y), float(z)), up=(float(up[0]), float(up[1]), float(up[2])))


def _median(renderer: Any, camera: Camera, records: int) -> Timing:
    """The median of some pictures, each from the first so many `records` of the cache; none: from nothing at all."""
    timings: list[Timing] = []
    while len(timings) < REPETITIONS and (not timings or timings[0].seconds < SLOW):
        renderer.forget(records=records == 0, lights=records == 0)
        renderer.cache.truncate(records)
        timings.append(_picture(renderer, camera))
    middle = statistics.median_low(t.seconds for t in timings)
    return next(t for t in timings if t.seconds == middle)


def _picture(renderer: Any, camera: Camera) -> Timing:
    """One picture, timed to its last pixel."""
    rounds: list[tuple[int, dict[str, float]]] = []

    def watch(progress: Any) -> None:
        if progress.round <= 2:  # the second one splats the first one's records
            rounds.append((progress.records, renderer.timers.milliseconds()))

    start = time.perf_counter()
    _, stats = renderer.converge(camera, watch)
    with renderer.ctx:
        renderer.ctx.finish()
        picture = time.perf_counter() - start
        if stats["interrupted"]:  # converge keeps what it has; here that is worth nothing
            raise KeyboardInterrupt
        return Timing(stats["seconds"], picture, stats["records"], renderer.timers.milliseconds(), rounds)


def _error(renderer: Any, camera: Camera) -> float | None:
    """The relative RMSE of irradiance against gathers without interpolation."""
    from irrsplat import exact, paper

    scene: Scene = renderer.scene
    irradiance = renderer.render(camera).irradiance
    view, _ = renderer.converge(camera)
    with renderer.ctx:
        seen = paper.read_back(view.gbuffer)
        return exact.gather(renderer.ctx, scene, renderer.geometry, seen, renderer.settings.shadow_size).error(irradiance)


def _cases(runs: Sequence[Run], pictures: Sequence[float]) -> Iterator[str]:
    """The table of cases, and what follows from it."""
    rows = [("scene", "preset", "case", "seconds", "picture", "records", "rmse")]
    for r, picture in zip(runs, pictures, strict=True):
        rmse = "-" if r.rmse is None else f"{r.rmse:.1%}"
        rows.append((r.scene, r.preset, r.case, f"{r.seconds:.3f}", f"{picture:.3f}", str(r.records), rmse))
    yield from columns(rows, left=3)
    seconds = {(r.preset, r.case): r.seconds for r in runs}
    yield f"from empty, default is {seconds['paper', 'empty'] / seconds['default', 'empty']:.1f} times faster than paper"
    for case, words in (("moved", f"turned by {TURN:g}°"), ("warm", "the same view")):
        times = ", ".join(f"{seconds[p, 'empty'] / seconds[p, case]:.1f} times ({p})" for p in PRESETS)
        yield f"{words}, faster than from empty: {times}"


def _stages(scene: str, ours: dict[str, list[tuple[float, int | None]]], clock: str) -> Iterator[str]:
    """The paper's own rows, its times beside ours."""
    yield f"{scene} from empty, stage by stage in ms ({clock} clock), with the records of each; first: {PUBLISHED}"
    rows: list[tuple[str, ...]] = [("stage", "published", *PRESETS)]
    for i, (name, ms, records) in enumerate(ROWS):
        rows.append((name, _cell(ms, records), *(_cell(*ours[preset][i]) for preset in PRESETS)))
    yield from columns(rows, left=1)


def _cell(ms: float, records: int | None) -> str:
    return f"{ms:.2f}" + (f" ({records:4d})" if records is not None else " " * 7)


def _machine(about: dict[str, Any]) -> dict[str, Any]:
    return {
        **{key: about[key] for key in ("renderer", "vendor", "version", "software")},
        "platform": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "cpus": os.cpu_count(),
        "python": platform.python_version(),
        "irrsplat": version(),
    }


def _say(words: str) -> None:
    """What goes on, in one line that changes, where stderr is a terminal."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{words}", end="", file=sys.stderr, flush=True)
