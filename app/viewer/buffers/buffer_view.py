"""Draws any buffer of BUFFERS into a target, and reads its value at a pixel."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.app.viewer.buffers.shown_buffer import Canvas, ViewSource
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.show.screen import Programs, Region, TexelReader, colours
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target


class BufferView(Owner):
    """Draws into targets of any size; best are those of the view's own size, where a pixel is a texel."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.programs = Programs(ctx)
        self.colours = colours(ctx)
        self.texels = TexelReader(ctx)

    def owned(self) -> tuple[Resource | None, ...]:
        return (self.programs, self.colours, self.texels)

    def draw(self, target: Target, name: str, source: ViewSource, region: Region | None = None) -> None:
        BUFFERS[name].draw(self.canvas(target, region), source)

    def canvas(self, target: Target, region: Region | None = None) -> Canvas:
        """Return a target (or a region of it) for buffers to draw on."""
        return Canvas(target, self.programs, self.colours, region)

    def value(self, name: str, source: ViewSource, x: int, y: int) -> np.ndarray | None:
        """The 1 or 3 numbers of the buffer `name` at pixel (x, y) of the view, (0, 0) the upper left one; None for none.

        There are none outside of the view, where nothing is seen, and for buffers that are not of the view. Reads one texel of
        each texture concerned.
        """
        return BUFFERS[name].value(self.texels, source, x, y)
