"""What a buffer shows along a line between two points of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from math import dist

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import ViewSource
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.input.measuring_line import Point
from irrsplat.app.viewer.show.screen import Texels
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target

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

    @property
    def csv(self) -> str:
        """A table of them all."""
        head = ",".join(("along", *(name or "value" for name in self.channels)))
        rows = np.column_stack([self.metres, self.values]).tolist()
        lines = (",".join("" if np.isnan(v) else f"{v:.7g}" for v in row) for row in rows)
        return "\n".join((head, *lines)) + "\n"


class LineProfile(Owner):
    """Reads profiles. At a pixel, the value is what `ShownBuffer.value` finds."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.texels = _LineTexels(ctx)

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.texels,)

    def measure(self, name: str, source: ViewSource, start: Point, end: Point) -> Profile:
        """The profile of the buffer `name` between two points, as the view shows it: what hides the line counts in its place."""
        buffer, share = BUFFERS[name], np.linspace(0.0, 1.0, COUNT)
        pixels, inside = _pixels(source, np.array(start) + share[:, None] * np.subtract(end, start))
        self.texels.place(pixels, source.view.gbuffer.position.size)
        # the values themselves are no loop over textures: each of these is read once, for all pixels
        found = [
            buffer.value(self.texels, source, x, y) if there else None
            for (x, y), there in zip(pixels.tolist(), inside, strict=True)
        ]
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


class _LineTexels(Texels):
    """Reads every texture once at all pixels of a line."""

    def __init__(self, ctx: moderngl.Context) -> None:
        super().__init__(ctx)
        self.along = Program(ctx, "viewer/texels_along", "lib/fullscreen")
        self.row = Target(ctx, (COUNT, 1), (4,))
        self.places = ctx.texture((COUNT, 1), 2, dtype="f4")
        self._size = (0, 0)
        self._number: dict[tuple[int, int], int] = {}  # of a pixel
        self._read: dict[int, np.ndarray] = {}  # texels at all places by the number of the texture

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (*super().owned(), self.along, self.row, self.places)

    def place(self, pixels: np.ndarray, size: tuple[int, int]) -> None:
        """Read at these pixels (COUNT, 2) from now on, of textures of this `size`."""
        self._size, self._read = size, {}
        self._number = {(x, y): i for i, (x, y) in enumerate(pixels.tolist())}
        self.places.write(np.ascontiguousarray(pixels, "f4").tobytes())

    def __call__(self, texture: moderngl.Texture, x: int, y: int) -> np.ndarray:
        """The components of one texel, as `Texels` has them; alone where it is none of the line's, such as a cell of a coarse
        truth."""
        number = self._number.get((x, y))
        if number is None or texture.size != self._size:
            return super().__call__(texture, x, y)
        if texture.glo not in self._read:
            self.along(self.row, values=texture, places=self.places)
            self._read[texture.glo] = self.row.read()[0]
        return self._read[texture.glo][number, : texture.components]
