"""When records are held against each other, and which: the new ones at once, those that were there where it is worth a splat."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import moderngl
import numpy as np

from irrsplat.cache import RecordCache
from irrsplat.gpu.holder import Holder
from irrsplat.gpu.timers import Timers
from irrsplat.passes.adapt import AdaptPass
from irrsplat.settings import Settings

# settings that limits of radii depend on
_BY = ("a", "adapt", "neighbours", "gradients", "second_order", "radius", "walls")


class Adaptation(Holder):
    """Keeps the limits of the `cache`'s records as they are to be."""

    def __init__(self, ctx: moderngl.Context, settings: Settings, cache: RecordCache, timers: Timers) -> None:
        self.ctx, self.cache, self.timers = ctx, cache, timers
        self.adapt_pass = AdaptPass(ctx, settings.gradients, settings.neighbours)
        self._made_for = settings.gradients, settings.neighbours
        # how many records, how many of them by all others, and by what
        self._adapted: tuple[int, int, tuple[Any, ...] | None] = 0, 0, None
        self._gauged = 0, 0  # of how many records, and how often gathered again, the cache has the gauge
        self._begun = False  # whether the view's splats are made

    def new_view(self) -> None:
        """Another view begins, all of whose splats are made anew."""
        self._begun = False

    def change(self, settings: Settings) -> None:
        """Go on with other settings."""
        if self._made_for != (settings.gradients, settings.neighbours):
            self.adapt_pass.release()
            self.adapt_pass = AdaptPass(self.ctx, settings.gradients, settings.neighbours)
            self._made_for = settings.gradients, settings.neighbours

    def keep(self, numbers: np.ndarray) -> None:
        """Only the records of these numbers, ascending, are still there."""
        count, held, by = self._adapted
        self._adapted = int(np.searchsorted(numbers, count)), int(np.searchsorted(numbers, held)), by

    def __call__(self, settings: Settings, last: bool = False) -> bool:
        """Hold the records that are new, or all where their light or the settings have changed, against each other.

        That those which were there reach less far for it waits for another view, since all of them are splatted anew then, or
        until this one asks for nothing else: `last`. Returns whether any of them reaches otherwise now.
        Not while some are stale: they would contradict those that are renewed, and mean nothing by it.
        """
        cache, old = self.cache, last or not self._begun
        self._begun = True
        if len(cache.stale):
            return False
        if settings.gradients and (cache.count, cache.renewals) != self._gauged:
            self._gauged = cache.count, cache.renewals
            cache.gauge()
        by = *(getattr(settings, name) for name in _BY), cache.renewals, cache.dark
        count, held, before = self._adapted
        count, held = (min(count, cache.count), min(held, cache.count)) if by == before else (0, 0)
        first = held if old else count
        self._adapted = cache.count, cache.count if old else held, by
        if by == before and first == cache.count:
            return False
        limiting = settings.adapt > 0.0 or settings.neighbours
        with self.timers("adapt"):
            was = cache.limits(count)
            if limiting and cache.count:
                self.adapt_pass(cache, first, settings, old)
            elif by != before:
                cache.unlimit()
            changed = by != before or not np.array_equal(was, cache.limits(count))
        cache.edits += changed  # where it is not, the splats of the old ones still hold
        return changed

    def state(self) -> list[Any]:
        """What `restore` goes on from, as plain JSON."""
        count, held, by = self._adapted
        return [0, 0] if by is None else [count, held, *by[: len(_BY)]]

    def restore(self, state: Sequence[Any], settings: Settings) -> None:
        """Go on from there, where the settings are the same, with the cache that belongs to it; else from nothing."""
        (count, held, *by), cache = state, self.cache
        same = by == [getattr(settings, name) for name in _BY]
        self._adapted = (int(count), int(held), (*by, cache.renewals, cache.dark)) if same else (0, 0, None)
        self._gauged = cache.count, cache.renewals
