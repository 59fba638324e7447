"""Mitsuba as a peer: its path tracer, and the path tracer of `verify`, which uses Mitsuba's intersections."""

from __future__ import annotations

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

_PROCESS = "from irrsplat.reference.trace_points import main; main()"


def measure_path(
    scene: Scene, size: tuple[int, int], bounces: int | All, views: Sequence[JudgedView], notify: Notify
) -> Iterator[Series]:
    """Measure Mitsuba's own integrator."""
    yield _traced("Mitsuba", "path", (60, 140, 60), scene, bounces, views[0], notify)


def measure_joined(
    scene: Scene, size: tuple[int, int], bounces: int | All, views: Sequence[JudgedView], notify: Notify
) -> Iterator[Series]:
    """Measure the integrator of `verify`, with next-event estimation at every vertex."""
    yield _traced("Mitsuba, lamps joined", "joined", (130, 80, 160), scene, bounces, views[0], notify)


def _traced(name: str, method: str, colour: Colour, scene: Scene, bounces: int | All, view: JudgedView, notify: Notify) -> Series:
    """Return a path tracer's measurements with growing sample counts; further views are the same, as it keeps no data."""
    notify(name)
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
        ),
    )
    found = cast("TimedLevels", answer)
    measurements = [
        Measurement(name, f"{count} samples", seconds, rmse, seconds, rmse)
        for count, seconds, rmse in found["levels"]
        if seconds > 0.0
    ]
    about = f"after {found['load']:.2f} s of loading, compiled; {found['threads']} threads"
    return Series(tuple(measurements), about, colour, keeps_nothing=True)
