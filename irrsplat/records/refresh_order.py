"""The order in which stale records are gathered again: those first that a view shows most of, and that have waited longest."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.records.coverage_pass import RankPass
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings


class Renewal(Owner):
    """Puts a cache's stale records in order, anew for every view and whenever more of them are stale."""

    def __init__(self, ctx: moderngl.Context, gradients: bool) -> None:
        self.rank_pass = RankPass(ctx, gradients)
        self._order = np.zeros(0, np.intp)
        self._made_of: tuple[GBuffer | None, int, int] = None, -1, 0  # the view, the cache's era, and how many have been evicted

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.rank_pass,)

    def order(self, cache: RecordCache, gbuffer: GBuffer, camera: Camera, settings: Settings) -> np.ndarray:
        """(N,) the numbers of the stale records.

        A record comes the sooner the more pixels it serves, the more it is known to be off, and the longer it has waited, so that
        while light changes all the time none that is seen waits for ever; the hidden ones come last, the stalest first.
        """
        if self._made_of[0] is not gbuffer or self._made_of[1:] != (cache.era, cache.evicted):
            self._made_of = gbuffer, cache.era, cache.evicted
            stale = cache.stale
            if len(stale):
                waited = cache.age(stale)
                served = self.rank_pass(cache.records, gbuffer, camera, settings)[stale]
                stale = stale[np.lexsort((-waited, -served * waited * cache.drift[stale]))]
            self._order = stale
        self._order = self._order[cache.age(self._order) > 0]
        return self._order
