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
    """Along a line: (N,) metres from its first end, and (N, C) the values of a buffer there, in `unit`, of so many `channels`
    by name; NaN where the view has none. Its mean, least and greatest value are (C,); None where there is no value at all."""

    metres: np.ndarray
    values: np.ndarray
    unit: str
    channels: tuple[str, ...]

    @property
    def summary(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """(least, mean, greatest), each (C,)."""
        there = self.values[np.isfinite(self.values).all(axis=1)]
        return (there.min(0), there.mean(0), there.max(0)) if len(there) else None


def line_profile(name: str, source: ViewSource, start: Point, end: Point) -> Profile:
    """Return the profile of the buffer `name` between two points; a surface that hides the line counts in its place."""
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
