"""The difference that a change of few lights makes to records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irrsplat.core.buffers import HitLight
from irrsplat.gather.hemisphere import Gather
from irrsplat.gpu.resource import Owner
from irrsplat.indirect.gathering.change_probe import MAX_DRIFT
from irrsplat.indirect.gathering.gathers import Basis, Gathers
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

    def left(self, cache: RecordCache, numbers: np.ndarray) -> np.ndarray:
        """Return the records among these stale `numbers` that lack the difference, in their order.

        A record that stays stale with the difference has a drift above MAX_DRIFT.
        """
        if cache.evicted != self._evicted:  # numbers have changed
            return numbers[:0]
        there = numbers[numbers < len(self.held["irradiance"])]
        left: np.ndarray = there[cache.column("drift")[there] <= MAX_DRIFT]
        return left

    def gathers(self, side: int) -> list[tuple[Gather, HitLight, float]]:
        """Return the gather, the light and the sign of each part; side: of the gathers."""
        return [
            (gathers.gather(basis, side), part.light, part.sign)
            for (gathers, basis), part in zip(self._made, self.light.parts, strict=True)
        ]
