"""References of a view, from a path tracer or a fine gather."""

from __future__ import annotations

import time
from argparse import Namespace
from collections.abc import Callable
from typing import TYPE_CHECKING

from irrsplat.app.common.terminal import say
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.reference.truth import NOTHING, Traced, traced
from irrsplat.settings import preset

if TYPE_CHECKING:
    from irrsplat.reference import fine_gather
    from irrsplat.renderer import Renderer
    from irrsplat.scene.model import Camera, Scene

GATHERED, SECONDS = 1000, 60.0  # of --truth gather: pixels, and the time limit after which fewer suffice

Notify = Callable[[float, str], None]  # takes the completed share 0..1 and a message


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
        notify(share, "tracing the reference")

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


def percent(share: float | None, sign: str = "") -> str:
    """Return a share in percent, or "no light" for None."""
    return "no light" if share is None else f"{100.0 * share:{sign}.2f} %"
