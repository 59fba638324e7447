"""Squares of pixels of a picture, one pixel of which stands for each: where something is wanted at places some pixels apart."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.scene.model import Part


@dataclass(frozen=True)
class Squares:
    """The squares of a part of a picture. side: in pixels. first: the first square's column and row, counted in the whole
    picture. size: how many there are across and up."""

    part: Part
    side: int
    first: tuple[int, int]
    size: tuple[int, int]

    @classmethod
    def of(cls, part: Part, rows: int) -> Squares:
        """Those that `part` touches, about so many `rows` of them in the whole picture."""
        side = max(1, round(part.whole[1] / rows))
        first = part.corner[0] // side, part.corner[1] // side
        across, up = (-(-(at + length) // side) - begin for at, length, begin in zip(part.corner, part.size, first, strict=True))
        return cls(part, side, first, (across, up))

    def most(self, size: tuple[int, int]) -> tuple[int, int]:
        """How many at most there are in any part of this `size` (width, height)."""
        return size[0] // self.side + 2, size[1] // self.side + 2

    @property
    def uniforms(self) -> Uniforms:
        """Those by which a shader finds them."""
        return {"stride": self.side, "corner": self.part.corner, "first": self.first}

    @cached_property
    def pixels(self) -> np.ndarray:
        """(rows up, columns, 2) column and row of the pixel that stands for each, from the whole picture's lower left corner; as
        pixel_of_square in shaders/lib/texel.glsl has it."""
        width, height = self.size
        columns, rows = self.first[0] + np.arange(width), self.first[1] + np.arange(height)
        square = np.stack(np.meshgrid(columns, rows), axis=-1)
        found: np.ndarray = self.side * square + square[..., ::-1] % self.side
        return found

    @property
    def inside(self) -> np.ndarray:
        """(rows up, columns) bool: whether that pixel lies in the whole picture."""
        inside: np.ndarray = np.all((self.pixels >= 0) & (self.pixels < self.part.whole), axis=-1)
        return inside
