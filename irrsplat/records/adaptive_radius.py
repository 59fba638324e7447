"""Adaptive radii: inter-record variance limits the reach of records (after Křivánek et al. 2006, "adaptive caching").

radius_limit_pass.py computes the limits; this module decides when, and for which records.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import moderngl
import numpy as np

from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.records.radius_limit_pass import RadiusLimitPass
from irrsplat.records.record_cache import RecordCache
from irrsplat.settings import Settings

_SETTINGS = ("a", "adapt", "gradients", "weights")  # settings that limits depend on


@dataclass(frozen=True)
class AdaptiveRadiusState:
    """Progress of the adaptation.

    limited: records with limits. compared: records that are compared with all others as well. inputs: values of the settings
    that both numbers belong to, and in this process the number of refreshes and the luminance floor; empty before the first
    adaptation.
    """

    limited: int = 0
    compared: int = 0
    inputs: tuple[object, ...] = ()


@dataclass(frozen=True)
class _Comparison:
    """Comparison of old records with new ones, spread over several frames.

    inputs: those of the limits, the first new record, and the number of records. before: (N,) limits when it began. done:
    records that are compared.
    """

    inputs: tuple[object, ...]
    before: np.ndarray
    done: int = 0
    complete: bool = False


class AdaptiveRadius(Owner):
    """Keeps the limits of the radii of a cache's records up to date."""

    def __init__(self, ctx: moderngl.Context, cache: RecordCache, timers: Timers) -> None:
        self.ctx, self.cache, self.timers = ctx, cache, timers
        self.passes = Workshop()
        self._progress = AdaptiveRadiusState()
        self._comparison: _Comparison | None = None
        self._floor_of = 0, 0  # record count and refresh count at the last update of the luminance floor

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (self.passes,)

    def keep(self, numbers: np.ndarray) -> None:
        """Drop all records except these numbers, ascending."""
        limited, compared = (int(np.searchsorted(numbers, n)) for n in (self._progress.limited, self._progress.compared))
        self._progress = AdaptiveRadiusState(limited, compared, self._progress.inputs)
        if self._comparison is not None:
            before = self._comparison.before
            self._comparison = _Comparison((), before[numbers[numbers < len(before)]])  # restarts

    def __call__(self, settings: Settings, old_too: bool, same_floor: bool = False) -> bool:
        """Compare each new record with the records before it; return True if the limit of an old record changed.

        old_too: update the limits of old records as well. A changed limit costs a new splat of its record. Callers therefore set
        it at the start of a view, when all splats are made anyway, or at its end, when the view needs no more records.
        same_floor: keep the luminance floor during a round, so that the result does not depend on the number of frames.
        Does nothing while records are stale: their variance against refreshed records has no meaning.
        """
        cache = self.cache
        if len(cache.stale):
            return False
        if settings.gradients and not same_floor and (cache.count, cache.refresh_count) != self._floor_of:
            self._floor_of = cache.count, cache.refresh_count
            cache.update_luminance_floor()
        inputs = self._inputs(settings)
        same = inputs == self._progress.inputs
        done = self._progress if same else AdaptiveRadiusState()
        limited, compared = min(done.limited, cache.count), min(done.compared, cache.count)
        first = compared if old_too else limited
        changed = (not same or first < cache.count) and self._limit(settings, first, limited, old_too, same)
        self._progress = AdaptiveRadiusState(cache.count, cache.count if old_too else compared, inputs)
        return changed

    def compare(self, settings: Settings, budget: Budget) -> bool:
        """Do the work of a call with `old_too` in advance, within the budget; return True if all of it is done.

        Splats of old records stay valid until that call.
        """
        cache, inputs, done = self.cache, self._inputs(settings), self._progress
        waits = len(cache.stale) or inputs != done.inputs or done.limited != cache.count or done.compared == cache.count
        if waits or settings.adapt == 0.0:
            return True
        inputs, begun = (*inputs, done.compared, cache.count), self._comparison
        if begun is None or begun.inputs != inputs:
            # the earlier `before` of an interrupted comparison holds: no splats have been made since
            before = cache.limits(cache.count).copy()
            if begun is not None:
                before[: len(begun.before)] = begun.before[: len(before)]  # records may have been dropped
            begun = _Comparison(inputs, before)
        if not begun.complete:
            self._comparison = begun  # an interrupted pass has changed limits as well
            with self.timers("adapt"):
                found, complete = self._pass(settings)(cache, done.compared, settings, True, begun.done, budget)
            self._comparison = begun = replace(begun, done=found, complete=complete)
        return begun.complete

    def _limit(self, settings: Settings, first: int, limited: int, old: bool, same: bool) -> bool:
        """Write the limits of the records from `first` on; return True if the inputs or the first `limited` limits changed."""
        cache, begun = self.cache, self._comparison
        with self.timers("adapt"):
            before = cache.limits(limited)
            if begun is not None:
                before = np.concatenate([begun.before, before[len(begun.before) :]])[:limited]
            inputs = (*self._inputs(settings), first, cache.count)
            done = old and begun is not None and begun.complete and begun.inputs == inputs
            if not done and settings.adapt > 0.0 and cache.count:
                self._pass(settings)(cache, first, settings, old)
            elif not same:
                cache.reset_limits()
            changed = not same or not np.array_equal(before, cache.limits(limited))
            if changed or old:
                self._comparison = None
        cache.revision += changed  # unchanged limits keep the splats of old records valid
        return changed

    def _pass(self, settings: Settings) -> RadiusLimitPass:
        return self.passes.get("limits", settings.gradients, lambda: RadiusLimitPass(self.ctx, settings.gradients))

    def _inputs(self, settings: Settings) -> tuple[object, ...]:
        return (*(getattr(settings, name) for name in _SETTINGS), self.cache.refresh_count, self.cache.luminance_floor)

    def state(self) -> AdaptiveRadiusState:
        """Return the progress for `restore`."""
        return replace(self._progress, inputs=self._progress.inputs[: len(_SETTINGS)])

    def restore(self, state: AdaptiveRadiusState, settings: Settings) -> None:
        """Resume from a saved state, with the cache it belongs to; start anew if the settings differ."""
        inputs = self._inputs(settings)
        same = state.inputs == inputs[: len(_SETTINGS)]
        self._progress = replace(state, inputs=inputs) if same else AdaptiveRadiusState()
        self._comparison = None
        self._floor_of = self.cache.count, self.cache.refresh_count
