"""The values of a buffer along a line between two points of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from math import dist

import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import ViewSource
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.editing.picking import pixel_of
from irrsplat.app.viewer.view_options import Point

COUNT = 100  # points along a line


@dataclass(frozen=True)
class Profile:
    """The values of a buffer along a line.

    metres: (N,) distances from the first end. values: (N, C) in `unit`; NaN where the view has no value. channels: the names of
    the C channels.
    """

    metres: np.ndarray
    values: np.ndarray
    unit: str
    channels: tuple[str, ...]

    @property
    def summary(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """The least, mean and greatest value, each (C,); None if no point has a value."""
        there = self.values[np.isfinite(self.values).all(axis=1)]
        return (there.min(0), there.mean(0), there.max(0)) if len(there) else None


def line_profile(name: str, source: ViewSource, start: Point, end: Point) -> Profile:
    """Return the profile of the buffer `name` between two points. Where a surface hides the line, its values count."""
    buffer, share, view = BUFFERS[name], np.linspace(0.0, 1.0, COUNT), source.view
    points = np.array(start) + share[:, None] * np.subtract(end, start)
    places = [pixel_of(view.camera, view.gbuffer.position.size, (x, y, z)) for x, y, z in points.tolist()]
    found = [None if place is None else buffer.value(source, *place) for place in places]
    channels = max((len(value) for value in found if value is not None), default=1)
    values = np.array([np.full(channels, np.nan) if value is None else value for value in found], float)
    if name == "position":
        values = values + source.origin
    names = ("",) if channels == 1 else ("x", "y", "z") if name in ("position", "normal") else ("r", "g", "b")
    return Profile(share * dist(start, end), values, buffer.legend(source).unit, names)
