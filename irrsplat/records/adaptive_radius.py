"""Adaptive radii: inter-record variance limits the reach of records (after Křivánek et al. 2006, "adaptive caching").

radius_limit_pass.py computes the limits; this module decides when, and for which records.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import moderngl
import numpy as np

from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.records.radius_limit_pass import RadiusLimitPass
from irrsplat.records.record_cache import RecordCache
from irrsplat.settings import Settings

_SETTINGS = ("a", "adapt", "gradients", "weights")  # settings that limits depend on


@dataclass(frozen=True)
class AdaptiveRadiusState:
    """Progress of the adaptation, as cache files hold it.

    limited: records with limits. compared: records that are compared with all others as well. settings: values of the settings
    that both numbers belong to; empty before the first adaptation.
    """

    limited: int = 0
    compared: int = 0
    settings: tuple[object, ...] = ()

    def as_json(self) -> list[object]:
        """Return one flat list for a file."""
        return [self.limited, self.compared, *self.settings]

    @classmethod
    def from_json(cls, values: Sequence[Any]) -> AdaptiveRadiusState:
        """Build the state from `as_json`; raises TypeError or ValueError for any other list."""
        limited, compared, *settings = values
        return cls(int(limited), int(compared), tuple(settings))


@dataclass(frozen=True)
class _Progress:
    """Progress of the adaptation in this process.

    inputs: all that limits depend on: settings, number of refreshes, luminance floor; None before the first adaptation.
    """

    limited: int = 0
    compared: int = 0
    inputs: tuple[object, ...] | None = None


@dataclass(frozen=True)
class _Partly:
    """Comparison of all records, spread over several frames.

    inputs: as in _Progress. first: records before this number are compared already. count: records in the cache. done: compared
    so far. before: (N,) limits when the comparison began.
    """

    inputs: tuple[object, ...]
    first: int
    count: int
    before: np.ndarray
    done: int = 0
    complete: bool = False

    def begun_by(self, inputs: tuple[object, ...], first: int, count: int) -> bool:
        """True if the comparison was begun with these arguments."""
        return (self.inputs, self.first, self.count) == (inputs, first, count)


class AdaptiveRadius(Owner):
    """Keeps the limits of the radii of a cache's records up to date."""

    def __init__(self, ctx: moderngl.Context, settings: Settings, cache: RecordCache, timers: Timers) -> None:
        self.ctx, self.cache, self.timers = ctx, cache, timers
        self._gradients = settings.gradients
        self.limit_pass = RadiusLimitPass(ctx, self._gradients)
        self._progress = _Progress()
        self._partly: _Partly | None = None
        self._floor_of = 0, 0  # record count and refresh count at the last update of the luminance floor

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (self.limit_pass,)

    def change(self, settings: Settings) -> None:
        """Apply new settings."""
        if self._gradients != settings.gradients:
            made = RadiusLimitPass(self.ctx, settings.gradients)
            old, self.limit_pass, self._gradients = self.limit_pass, made, settings.gradients
            old.release()

    def keep(self, numbers: np.ndarray) -> None:
        """Drop all records except these numbers, ascending."""
        done = self._progress
        limited, compared = (int(np.searchsorted(numbers, count)) for count in (done.limited, done.compared))
        self._progress = _Progress(limited, compared, done.inputs)
        if self._partly is not None:
            before = self._partly.before
            self._partly = replace(self._partly, before=before[numbers[numbers < len(before)]], count=-1)  # restarts

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
        inputs, done = self._inputs(_values(settings)), self._progress
        same = inputs == done.inputs
        limited = min(done.limited, cache.count) if same else 0
        compared = min(done.compared, cache.count) if same else 0
        first = compared if old_too else limited
        wanted = not same or first < cache.count
        changed = wanted and self._limit(settings, first, limited, old_too, same)
        self._progress = _Progress(cache.count, cache.count if old_too else compared, inputs)
        return changed

    def compare(self, settings: Settings, budget: Budget) -> bool:
        """Do the work of a call with `old_too` in advance, within the budget; return True if all of it is done.

        Splats of old records stay valid until that call.
        """
        cache, inputs, done = self.cache, self._inputs(_values(settings)), self._progress
        waits = len(cache.stale) or inputs != done.inputs or done.limited != cache.count or done.compared == cache.count
        if waits or settings.adapt == 0.0:
            return True
        partly = self._partly
        if partly is None or not partly.begun_by(inputs, done.compared, cache.count):
            # the earlier `before` of an interrupted comparison holds: no splats have been made since
            before = cache.limits(cache.count).copy()
            if partly is not None:
                before[: len(partly.before)] = partly.before[: len(before)]  # records may have been dropped
            partly = _Partly(inputs, done.compared, cache.count, before)
        if not partly.complete:
            self._partly = partly  # an interrupted pass has changed limits as well
            with self.timers("adapt"):
                found, complete = self.limit_pass(cache, partly.first, settings, True, partly.done, budget)
            partly = replace(partly, done=found, complete=complete)
            self._partly = partly
        return partly.complete

    def _limit(self, settings: Settings, first: int, limited: int, old: bool, same: bool) -> bool:
        """Write the limits of the records from `first` on; return True if the inputs or the first `limited` limits changed."""
        cache = self.cache
        with self.timers("adapt"):
            before, partly = cache.limits(limited), self._partly
            if partly is not None:
                before = np.concatenate([partly.before, before[len(partly.before) :]])[:limited]
            inputs = self._inputs(_values(settings))
            done = old and partly is not None and partly.complete and partly.begun_by(inputs, first, cache.count)
            if not done and settings.adapt > 0.0 and cache.count:
                self.limit_pass(cache, first, settings, old)
            elif not same:
                cache.reset_limits()
            changed = not same or not np.array_equal(before, cache.limits(limited))
            if changed or old:
                self._partly = None
        cache.revision += changed  # unchanged limits keep the splats of old records valid
        return changed

    def _inputs(self, settings: tuple[object, ...]) -> tuple[object, ...]:
        return (*settings, self.cache.refresh_count, self.cache.luminance_floor)

    def state(self) -> AdaptiveRadiusState:
        """Return the progress for `restore`."""
        done = self._progress
        if done.inputs is None:
            return AdaptiveRadiusState()
        return AdaptiveRadiusState(done.limited, done.compared, done.inputs[: len(_SETTINGS)])

    def restore(self, state: AdaptiveRadiusState, settings: Settings) -> None:
        """Resume from a saved state, with the cache it belongs to; start anew if the settings differ."""
        if state.settings == _values(settings):
            self._progress = _Progress(state.limited, state.compared, self._inputs(state.settings))
        else:
            self._progress = _Progress()
        self._partly = None
        self._floor_of = self.cache.count, self.cache.refresh_count


def _values(settings: Settings) -> tuple[object, ...]:
    return tuple(getattr(settings, name) for name in _SETTINGS)
