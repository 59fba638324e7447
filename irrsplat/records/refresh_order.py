"""The order in which stale records are gathered again: first those that a view shows most of and that have waited longest."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.records.coverage_pass import CoveragePass
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings


@dataclass(frozen=True)
class _Order:
    """The numbers of stale records in order, and what it was made of: a view, and the cache's epoch and evictions."""

    numbers: np.ndarray
    gbuffer: GBuffer | None = None
    epoch: int = -1
    evicted: int = 0


class RefreshOrder(Owner):
    """Puts a cache's stale records in order, anew for every view and whenever more of them are stale."""

    def __init__(self, ctx: moderngl.Context, gradients: bool) -> None:
        self.coverage_pass = CoveragePass(ctx, gradients)
        self._made = _Order(np.zeros(0, np.intp))

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.coverage_pass,)

    def order(self, cache: RecordCache, gbuffer: GBuffer, camera: Camera, settings: Settings) -> np.ndarray:
        """(N,) the numbers of the stale records in the order in which they are to be gathered again.

        What decides is the product of the pixels that a record serves, how often it has become stale, and how much its light has
        changed: no record in view waits for ever, even while light changes all the time. Hidden ones come last, stalest first.
        """
        made, epoch, evicted = self._made, cache.invalidation_epoch, cache.evicted
        if made.gbuffer is not gbuffer or (made.epoch, made.evicted) != (epoch, evicted):
            stale = cache.stale
            if len(stale):
                waited = cache.age(stale)
                served = self.coverage_pass(cache.records, gbuffer, camera, settings)[stale]
                stale = stale[np.lexsort((-waited, -served * waited * cache.drift[stale]))]
            made = _Order(stale, gbuffer, epoch, evicted)
        waiting = made.numbers[cache.age(made.numbers) > 0]
        self._made = _Order(waiting, gbuffer, epoch, evicted)
        return waiting
