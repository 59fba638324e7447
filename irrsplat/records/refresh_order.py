"""Order in which stale records are refreshed: first those that cover most of the view and have been stale for longest."""

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
    """The numbers of stale records in order, with the inputs of the order: view, epoch and evictions of the cache."""

    numbers: np.ndarray
    gbuffer: GBuffer | None = None
    epoch: int = -1
    evicted: int = 0


class RefreshOrder(Owner):
    """Priority order of a cache's stale records, updated for each view and each invalidation."""

    def __init__(self, ctx: moderngl.Context, gradients: bool) -> None:
        self.coverage_pass = CoveragePass(ctx, gradients)
        self._made = _Order(np.zeros(0, np.intp))

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (self.coverage_pass,)

    def order(self, cache: RecordCache, gbuffer: GBuffer, camera: Camera, settings: Settings) -> np.ndarray:
        """Return (N,) the numbers of the stale records in the order of their refresh.

        Priority is the product of covered pixels, age in invalidations, and change of light: no record in view waits for ever,
        even under constant change of light. Hidden records come last, the oldest first.
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
