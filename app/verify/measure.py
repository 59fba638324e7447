"""The error of a rendering: the truth of a view, by a path tracer or a fine gather, and a fresh rendering compared with it."""

from __future__ import annotations

import time
from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from irrsplat.app.common.terminal import say
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.reference.truth import NOTHING, Traced, compare, errors, traced
from irrsplat.settings import SettingValues, preset

if TYPE_CHECKING:
    from irrsplat.image.frame import Frame
    from irrsplat.reference import fine_gather
    from irrsplat.renderer import Renderer
    from irrsplat.scene.model import Camera, Scene

GATHERED, SECONDS = 1000, 60.0  # of --truth gather: pixels, and the time after which fewer must do

Tell = Callable[[float, str], None]  # takes the share done, 0..1, and words


@dataclass(frozen=True)
class Measured:
    """A rendering's `records`, its wall time to full coverage in `seconds`, and its errors as `reference.traced.compare` has
    them, None where there is no light; rmse: without the truth's own noise. values: what was set on top of the `preset`."""

    preset: str
    values: SettingValues
    records: int
    rmse: float | None
    bias: float | None
    outliers: float | None
    seconds: float


# Renders with a renderer of its own, by preset, settings on top of it and progress (the share of the pixels that are served, and
# words); raises KeyboardInterrupt where the user ended it.
Measure = Callable[[str, SettingValues, Tell], Measured]


def silent(share: float, words: str) -> None:
    """Progress where nobody watches."""


def trace(scene: Scene, camera: Camera, args: Namespace, tell: Tell) -> tuple[Traced, str]:
    """The path-traced truth of what the command line `args` asks for, and in words where it came from.

    Raises InputError where no pixel can be compared, IrrsplatError where nothing can be traced here.
    """
    start = time.perf_counter()
    was_traced: list[float] = []

    def show(share: float) -> None:
        was_traced[:] = [share]
        tell(share, "tracing the truth")

    bounces = preset(args.preset, **args.values).bounces
    try:
        truth = traced(scene, camera, tuple(args.size), bounces, args.samples, show, lambda line: say(f"notice: {line}"))
    except InputError:
        raise
    except IrrsplatError as error:
        raise IrrsplatError(f"{error}; or compare with --truth gather --bounces 1, which does without") from error
    if not truth.valid.any():
        raise InputError(NOTHING)
    return truth, f"traced in {time.perf_counter() - start:.0f} s" if was_traced else "traced before and kept"


def gather(renderer: Renderer, camera: Camera) -> fine_gather.Truth:
    """The renderer's own fine gather of one bounce at random pixels; raises InputError where no pixel can be compared."""
    from irrsplat.indirect import paper_scan
    from irrsplat.reference import fine_gather

    view, _ = renderer.frame(camera, gather=False)
    seen, size = paper_scan.read_back(view.gbuffer), renderer.settings.shadow_size
    truth = fine_gather.gather(renderer.world, seen, size, GATHERED, SECONDS)
    if not len(truth.pixels):
        raise InputError(NOTHING)
    return truth


def measurer(scene: Scene, camera: Camera, args: Namespace, tell: Tell) -> Measure:
    """The function that measures renderings, of the size and view that the command line `args` asks for, by the truth it names.

    tell: progress while that truth is made.
    """
    import irrsplat

    size, judge = tuple(args.size), _judge(scene, camera, args, tell)

    def measure(preset: str, values: SettingValues, tell: Tell) -> Measured:
        with irrsplat.Renderer(scene, size=size, preset=preset, tile_size=0, **values) as renderer:
            frame = renderer.render(camera, progress=lambda now: tell(now.coverage, f"{now.records} records"))
        stats = frame.stats
        if stats.get("interrupted"):
            raise KeyboardInterrupt
        if not stats.get("converged", True):
            say(f"notice: {in_flags(preset, values)}: stopped before every pixel was served; raise --max-rounds or --a")
        found = judge(frame)
        rmse = found.get("net", found["rmse"])
        records, seconds = stats.get("records", 0), stats.get("seconds", 0.0)
        return Measured(preset, values, records, rmse, found["bias"], found["outliers"], seconds)

    return measure


def _judge(scene: Scene, camera: Camera, args: Namespace, tell: Tell) -> Callable[[Frame], dict[str, float | None]]:
    """The function that returns the errors of a frame."""
    if args.truth == "trace":
        traced_truth, _ = trace(scene, camera, args, tell)
        return lambda frame: compare(frame, traced_truth)
    import irrsplat

    with irrsplat.Renderer(scene, size=tuple(args.size), preset=args.preset, tile_size=0, **args.values) as renderer:
        tell(0.0, "gathering the truth")
        truth = gather(renderer, camera)
    return lambda frame: errors(frame.irradiance[tuple(truth.pixels.T)], truth.irradiance)


def in_flags(preset: str, values: SettingValues) -> str:
    """A preset and settings as flags of the command line."""
    words = [f"--preset {preset}"]
    for name, value in values.items():
        word = ("on" if value else "off") if isinstance(value, bool) else f"{value:.4g}" if isinstance(value, float) else value
        words.append(f"--{name.replace('_', '-')} {word}")
    return " ".join(words)


def percent(share: float | None, sign: str = "") -> str:
    """A share in percent, or that there is no light to have a share of."""
    return "no light" if share is None else f"{100.0 * share:{sign}.2f} %"
