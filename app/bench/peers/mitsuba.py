"""Mitsuba as a peer: the path tracer of `verify`, which uses its intersections, and Open Image Denoise."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from irrsplat.app.bench.peers import judging
from irrsplat.app.bench.peers.judging import JudgedView, Measurement, Series
from irrsplat.app.bench.peers.table import Notify
from irrsplat.reference import worker
from irrsplat.reference.truth import vertices
from irrsplat.scene.model import Scene
from irrsplat.settings import All

if TYPE_CHECKING:  # importing it needs Mitsuba
    from irrsplat.reference.trace_points import TimedLevels

_NAME = "Mitsuba"
_COLOURS = (130, 80, 160), (180, 110, 210), (90, 40, 120)
_FILTERS = "fast", "high"  # qualities of Open Image Denoise


def measure(
    scene: Scene, size: tuple[int, int], bounces: int | All, views: Sequence[JudgedView], notify: Notify
) -> Iterator[Series]:
    """Yield the path tracer's measurements with growing sample counts, and the same with each filter of Open Image Denoise.

    Further views are the same, as it keeps no data.
    """
    view = views[0]
    notify(_NAME)
    filters = _FILTERS if importlib.util.find_spec("pyoidn") is not None else ()
    found: TimedLevels = worker.call(
        "trace_points",
        "timed",
        (
            scene,
            (view.position, view.normal, view.geometric),
            view.judged,
            view.truth.irradiance.astype(float),
            vertices(bounces),
            judging.ENOUGH,
            judging.SECONDS / 4.0,
            view.mask,
            filters,
        ),
    )
    about = f"after {found['load']:.2f} s of loading, compiled; {found['threads']} threads"
    for (quality, levels), colour in zip(found["levels"].items(), _COLOURS, strict=False):
        system = f"{_NAME} + OIDN {quality}" if quality else _NAME
        rows = [
            Measurement(system, f"{count} samples", seconds, rmse, seconds, rmse)
            for count, seconds, rmse in levels
            if seconds > 0.0
        ]
        yield Series(tuple(rows), about, colour, keeps_nothing=not quality)
    if not filters:
        yield Series((), f"{_NAME} + OIDN: Open Image Denoise (pyoidn) is not installed")
