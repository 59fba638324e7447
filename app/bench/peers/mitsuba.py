"""Mitsuba as a peer: the path tracer of `verify`, which uses its intersections, and Open Image Denoise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from irrsplat.app.bench.peers import judging
from irrsplat.app.bench.peers.judging import Series
from irrsplat.app.bench.peers.table import Notify
from irrsplat.reference import worker
from irrsplat.reference.timed_levels import JudgedView, TimedLevels
from irrsplat.reference.truth import vertices
from irrsplat.scene.model import Scene
from irrsplat.settings import All

_NAME = "Mitsuba"
_COLOURS = (130, 80, 160), (180, 110, 210), (90, 40, 120)


def measure(
    scene: Scene, size: tuple[int, int], bounces: int | All, views: Sequence[JudgedView], notify: Notify
) -> Iterator[Series]:
    """Yield the path tracer's measurements with growing sample counts, and the same with each filter of Open Image Denoise."""
    notify(_NAME)
    found: TimedLevels = worker.call("timed", (scene, vertices(bounces), views[0]))
    yield from judging.by_samples(_NAME, found, _COLOURS)
