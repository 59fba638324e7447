"""Mitsuba as a peer: its path tracer, and the path tracer of `verify`, which uses Mitsuba's intersections."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, cast

from irrsplat.app.bench.peers import judging
from irrsplat.app.bench.peers.judging import JudgedView, Measurement, Series
from irrsplat.app.bench.peers.table import Notify
from irrsplat.image.figures.pen import Colour
from irrsplat.reference import worker
from irrsplat.reference.truth import vertices
from irrsplat.scene.model import Scene
from irrsplat.settings import All

if TYPE_CHECKING:  # importing it needs Mitsuba
    from irrsplat.reference.trace_points import TimedLevels

_FILTERS = "fast", "high"  # qualities of Open Image Denoise
_PROCESS = "from irrsplat.reference.trace_points import main; main()"


def measure_path(
    scene: Scene, size: tuple[int, int], bounces: int | All, views: Sequence[JudgedView], notify: Notify
) -> Iterator[Series]:
    """Measure Mitsuba's own integrator."""
    yield from _traced("Mitsuba", "path", ((60, 140, 60), (110, 190, 60), (20, 100, 20)), scene, bounces, views[0], notify)


def measure_joined(
    scene: Scene, size: tuple[int, int], bounces: int | All, views: Sequence[JudgedView], notify: Notify
) -> Iterator[Series]:
    """Measure the integrator of `verify`, with next-event estimation at every vertex."""
    colours = (130, 80, 160), (180, 110, 210), (90, 40, 120)
    yield from _traced("Mitsuba, lights joined", "joined", colours, scene, bounces, views[0], notify)


def _traced(
    name: str,
    method: str,
    colours: Sequence[Colour],
    scene: Scene,
    bounces: int | All,
    view: JudgedView,
    notify: Notify,
) -> Iterator[Series]:
    """Yield a path tracer's measurements with growing sample counts, and the same with each filter of Open Image Denoise.

    Further views are the same, as it keeps no data.
    """
    notify(name)
    filters = _FILTERS if importlib.util.find_spec("pyoidn") is not None else ()
    answer = worker.call(
        _PROCESS,
        (
            scene,
            (view.position, view.normal, view.geometric),
            view.judged,
            view.truth.irradiance.astype(float),
            method,
            vertices(bounces),
            judging.ENOUGH,
            judging.SECONDS / 4.0,
            view.mask,
            filters,
        ),
    )
    found = cast("TimedLevels", answer)
    about = f"after {found['load']:.2f} s of loading, compiled; {found['threads']} threads"
    for (quality, levels), colour in zip(found["levels"].items(), colours, strict=False):
        system = f"{name} + OIDN {quality}" if quality else name
        rows = [
            Measurement(system, f"{count} samples", seconds, rmse, seconds, rmse)
            for count, seconds, rmse in levels
            if seconds > 0.0
        ]
        yield Series(tuple(rows), about, colour, keeps_nothing=not quality)
    if not filters:
        yield Series((), f"{name} + OIDN: Open Image Denoise (pyoidn) is not installed")
