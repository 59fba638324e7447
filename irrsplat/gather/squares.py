"""Squares of pixels of a picture, each represented by one pixel: a sparse selection of pixels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.scene.model import Part


@dataclass(frozen=True)
class Squares:
    """The squares of a part of a picture.

    side: pixels. first: column and row of the first square in the whole picture. size: numbers of squares across and up.
    """

    part: Part
    side: int
    first: tuple[int, int]
    size: tuple[int, int]

    @classmethod
    def of(cls, part: Part, rows: int) -> Squares:
        """Return the squares that `part` touches, for about `rows` rows of them in the whole picture."""
        side = max(1, round(part.whole[1] / rows))
        first = part.corner[0] // side, part.corner[1] // side
        across, up = (-(-(at + length) // side) - begin for at, length, begin in zip(part.corner, part.size, first, strict=True))
        return cls(part, side, first, (across, up))

    def most(self, size: tuple[int, int]) -> tuple[int, int]:
        """Return the greatest numbers of squares in any part of this `size` (width, height)."""
        return size[0] // self.side + 2, size[1] // self.side + 2

    @property
    def uniforms(self) -> Uniforms:
        """Uniforms of pixel_of_square in shaders/lib/texel.glsl."""
        return {"stride": self.side, "corner": self.part.corner, "first": self.first}

    @cached_property
    def pixels(self) -> np.ndarray:
        """(rows up, columns, 2) column and row of each square's pixel, from the whole picture's lower left corner; as
        pixel_of_square in shaders/lib/texel.glsl."""
        width, height = self.size
        columns, rows = self.first[0] + np.arange(width), self.first[1] + np.arange(height)
        square = np.stack(np.meshgrid(columns, rows), axis=-1)
        found: np.ndarray = self.side * square + square[..., ::-1] % self.side
        return found

    @property
    def inside(self) -> np.ndarray:
        """(rows up, columns) bool, True where that pixel lies in the whole picture."""
        inside: np.ndarray = np.all((self.pixels >= 0) & (self.pixels < self.part.whole), axis=-1)
        return inside
