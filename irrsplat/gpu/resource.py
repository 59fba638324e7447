"""Whoever holds things on the GPU: frees them all, and finds the programs among them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Self

import moderngl

from irrsplat.gpu.geometry import Geometry
from irrsplat.gpu.program import Program
from irrsplat.gpu.target import Target


class Holder:
    """An object whose attributes are targets, programs, geometry, textures and buffers, or others of its kind; at the end of a
    `with` block it is released."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Free all of them; twice does no harm."""
        for thing in vars(self).values():
            if isinstance(thing, (Holder, Target, Program, Geometry, moderngl.Texture, moderngl.Buffer)):
                thing.release()

    def programs(self) -> Iterator[Program]:
        """Every program here, and in what is held."""
        for thing in vars(self).values():
            if isinstance(thing, Program):
                yield thing
            elif isinstance(thing, Holder):
                yield from thing.programs()
