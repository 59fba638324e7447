"""The values of a buffer along a line between two points of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from math import dist

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import ViewSource
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.show.screen import Texels
from irrsplat.app.viewer.view_options import Point

COUNT = 200  # points along a line


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
    buffer, share = BUFFERS[name], np.linspace(0.0, 1.0, COUNT)
    places, inside = _pixels(source, np.array(start) + share[:, None] * np.subtract(end, start))
    read = _whole_textures()
    found = [buffer.value(read, source, x, y) if seen else None for (x, y), seen in zip(places.tolist(), inside, strict=True)]
    channels = max((len(value) for value in found if value is not None), default=1)
    values = np.array([np.full(channels, np.nan) if value is None else value for value in found], float)
    if name == "position":
        values = values + source.origin
    names = ("",) if channels == 1 else ("x", "y", "z") if name in ("position", "normal") else ("r", "g", "b")
    return Profile(share * dist(start, end), values, buffer.unit_shown(source), names)


def _pixels(source: ViewSource, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2) pixels of the view, (0, 0) the upper left one, that points (N, 3) lie in; and (N,) whether they lie in any."""
    camera = source.view.camera
    assert camera is not None
    width, height = source.view.gbuffer.position.size
    x, y, z = camera.axes @ (points - np.asarray(camera.eye)).T
    before = z < 0.0
    per_metre = height / camera.screen / np.where(before, -z, 1.0)
    pixels = np.floor(np.stack([0.5 * width + x * per_metre, 0.5 * height - y * per_metre], axis=1))
    inside = before & ((pixels >= 0.0) & (pixels < (width, height))).all(axis=1)
    return np.where(inside[:, None], pixels, 0.0).astype(int), inside


def _whole_textures() -> Texels:
    """Return a reader of texels that reads each texture once, whole."""
    known: dict[int, np.ndarray] = {}  # by the number of the texture

    def texel(texture: moderngl.Texture, x: int, y: int) -> np.ndarray:
        if texture.glo not in known:
            values = np.frombuffer(texture.read(), "u1" if texture.dtype == "f1" else texture.dtype)
            values = values.astype(np.float32) / (255.0 if texture.dtype == "f1" else 1.0)
            known[texture.glo] = values.reshape(texture.height, texture.width, texture.components)[::-1]
        found: np.ndarray = known[texture.glo][y, x]
        return found

    return texel
