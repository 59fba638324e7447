"""Error of a rendering: a view's reference from a path tracer or a fine gather, compared with a fresh rendering."""

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

GATHERED, SECONDS = 1000, 60.0  # of --truth gather: pixels, and the time limit after which fewer suffice

Notify = Callable[[float, str], None]  # takes the completed share 0..1 and a message


@dataclass(frozen=True)
class Measured:
    """Records of a rendering, wall time to full coverage in `seconds`, and errors as in `reference.traced.compare`.

    The errors are None without light; rmse excludes the reference's own noise. values: settings on top of the `preset`.
    """

    preset: str
    values: SettingValues
    records: int
    rmse: float | None
    bias: float | None
    outliers: float | None
    seconds: float


# Renders with a new renderer, by preset, settings on top of it and progress (share of covered pixels, and a message); raises
# KeyboardInterrupt if the user interrupts.
Measure = Callable[[str, SettingValues, Notify], Measured]


def silent(share: float, words: str) -> None:
    """Ignore progress."""


def trace(scene: Scene, camera: Camera, args: Namespace, notify: Notify) -> tuple[Traced, str]:
    """Return the path-traced reference for the command line `args`, and its origin in words.

    Raises InputError without comparable pixels, IrrsplatError without a path tracer.
    """
    start = time.perf_counter()
    was_traced: list[float] = []

    def show(share: float) -> None:
        was_traced[:] = [share]
        notify(share, "tracing the truth")

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
    """Return the renderer's fine gather of one bounce at random pixels; raise InputError without comparable pixels."""
    from irrsplat.indirect import paper_scan
    from irrsplat.reference import fine_gather

    view, _ = renderer.frame(camera, gather=False)
    seen, size = paper_scan.read_back(view.gbuffer), renderer.settings.shadow_size
    truth = fine_gather.gather(renderer.world, seen, size, GATHERED, SECONDS)
    if not len(truth.pixels):
        raise InputError(NOTHING)
    return truth


def measurer(scene: Scene, camera: Camera, args: Namespace, notify: Notify) -> Measure:
    """Return the function that measures renderings for the size, view and reference of the command line `args`.

    notify: progress while the reference is made.
    """
    import irrsplat

    size, judge = tuple(args.size), _judge(scene, camera, args, notify)

    def measure(preset: str, values: SettingValues, notify: Notify) -> Measured:
        with irrsplat.Renderer(scene, size=size, preset=preset, tile_size=0, **values) as renderer:
            frame = renderer.render(camera, progress=lambda now: notify(now.coverage, f"{now.records} records"))
        stats = frame.stats
        if stats.get("interrupted"):
            raise KeyboardInterrupt
        if not stats.get("converged", True):
            say(f"notice: {in_flags(preset, values)}: stopped before every pixel was covered; raise --a")
        found = judge(frame)
        rmse = found.get("net", found["rmse"])
        records, seconds = stats.get("records", 0), stats.get("seconds", 0.0)
        return Measured(preset, values, records, rmse, found["bias"], found["outliers"], seconds)

    return measure


def _judge(scene: Scene, camera: Camera, args: Namespace, notify: Notify) -> Callable[[Frame], dict[str, float | None]]:
    """Return the function that computes the errors of a frame."""
    if args.truth == "trace":
        traced_truth, _ = trace(scene, camera, args, notify)
        return lambda frame: compare(frame, traced_truth)
    import irrsplat

    with irrsplat.Renderer(scene, size=tuple(args.size), preset=args.preset, tile_size=0, **args.values) as renderer:
        notify(0.0, "gathering the truth")
        truth = gather(renderer, camera)
    return lambda frame: errors(frame.irradiance[tuple(truth.pixels.T)], truth.irradiance)


def in_flags(preset: str, values: SettingValues) -> str:
    """Return a preset and settings as flags of the command line."""
    words = [f"--preset {preset}"]
    for name, value in values.items():
        word = ("on" if value else "off") if isinstance(value, bool) else f"{value:.4g}" if isinstance(value, float) else value
        words.append(f"--{name.replace('_', '-')} {word}")
    return " ".join(words)


def percent(share: float | None, sign: str = "") -> str:
    """Return a share in percent, or "no light" for None."""
    return "no light" if share is None else f"{100.0 * share:{sign}.2f} %"
