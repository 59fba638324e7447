"""The difference that a change of few lights makes to records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irrsplat.core.buffers import HitLight
from irrsplat.gather.hemisphere import Gather
from irrsplat.gpu.resource import Owner
from irrsplat.indirect.gathering.basis import Basis
from irrsplat.indirect.gathering.gathers import Gathers
from irrsplat.records.record_cache import LINEAR, RecordCache
from irrsplat.surface_cache.light_difference import LightDifference


class RecordDifference(Owner):
    """The difference that `light` makes to the present records of a `cache`, gathered as in `basis`.

    held: the columns of the records before the change.
    """

    def __init__(self, light: LightDifference, basis: Basis, cache: RecordCache) -> None:
        self._made = [(self.own(Gathers(part.world)), replace(basis, scene=part.world.scene)) for part in light.parts]
        self.light = self.own(light)
        self.held, self._evicted = cache.records.read(*LINEAR), cache.evicted
        self._left = np.ones(cache.count, bool)

    def left(self, cache: RecordCache, numbers: np.ndarray) -> np.ndarray:
        """Return the records among these `numbers` that lack the difference, in their order."""
        if cache.evicted != self._evicted:  # numbers have changed
            self._left[:] = False
        there = numbers[numbers < len(self._left)]
        left: np.ndarray = there[self._left[there]]
        return left

    def mark(self, numbers: np.ndarray) -> None:
        """Mark records of these numbers as changed."""
        self._left[numbers] = False

    def gathers(self, side: int) -> list[tuple[Gather, HitLight, float]]:
        """Return the gather, the light and the sign of each part; side: of the gathers."""
        return [
            (gathers.gather(basis, side), part.light, part.sign)
            for (gathers, basis), part in zip(self._made, self.light.parts, strict=True)
        ]
