"""Adaptive radii: a record reaches less far where it contradicts another (after Křivánek et al. 2006, "adaptive caching").

radius_limit_pass.py finds how far each record may reach; here it is decided when, and for which records.
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

_SETTINGS = ("a", "adapt", "gradients", "second_order", "radius")  # those that limits depend on


@dataclass(frozen=True)
class AdaptiveRadiusState:
    """How far the adaptation has come: how many records have limits, how many of those are compared with all the others too, and
    the values of the settings that both were done with (none: nothing is done yet)."""

    limited: int = 0
    compared: int = 0
    settings: tuple[object, ...] = ()

    def as_json(self) -> list[object]:
        """For a file: one flat list."""
        return [self.limited, self.compared, *self.settings]

    @classmethod
    def from_json(cls, values: Sequence[Any]) -> AdaptiveRadiusState:
        """Raises TypeError or ValueError where `values` is no such list."""
        limited, compared, *settings = values
        return cls(int(limited), int(compared), tuple(settings))


@dataclass(frozen=True)
class _Progress:
    """As AdaptiveRadiusState, but `inputs` is all that limits depend on: settings, how often records were gathered again, and the
    luminance floor (None: nothing is done yet)."""

    limited: int = 0
    compared: int = 0
    inputs: tuple[object, ...] | None = None


@dataclass(frozen=True)
class _Partly:
    """What ticks have done of a comparison of all records: `done` of them by `inputs`, of `count` in the cache, all before number
    `first` compared already. before: (N,) the limits that there were at its beginning."""

    inputs: tuple[object, ...]
    first: int
    count: int
    before: np.ndarray
    done: int = 0
    complete: bool = False

    def begun_by(self, inputs: tuple[object, ...], first: int, count: int) -> bool:
        """Whether it is the comparison of these."""
        return (self.inputs, self.first, self.count) == (inputs, first, count)


class AdaptiveRadius(Owner):
    """Keeps the limits of the radii of a cache's records up to date."""

    def __init__(self, ctx: moderngl.Context, settings: Settings, cache: RecordCache, timers: Timers) -> None:
        self.ctx, self.cache, self.timers = ctx, cache, timers
        self._gradients = settings.gradients
        self.limit_pass = RadiusLimitPass(ctx, self._gradients)
        self._progress = _Progress()
        self._partly: _Partly | None = None
        self._floor_of = 0, 0  # how many records, and how many refreshes, the cache's luminance floor is of

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.limit_pass,)

    def change(self, settings: Settings) -> None:
        """Go on with other settings."""
        if self._gradients != settings.gradients:
            made = RadiusLimitPass(self.ctx, settings.gradients)
            old, self.limit_pass, self._gradients = self.limit_pass, made, settings.gradients
            old.release()

    def keep(self, numbers: np.ndarray) -> None:
        """Only the records of these numbers, ascending, are still there."""
        done = self._progress
        limited, compared = (int(np.searchsorted(numbers, count)) for count in (done.limited, done.compared))
        self._progress = _Progress(limited, compared, done.inputs)
        if self._partly is not None:
            before = self._partly.before
            self._partly = replace(self._partly, before=before[numbers[numbers < len(before)]], count=-1)  # it begins anew

    def __call__(self, settings: Settings, old_too: bool, same_floor: bool = False) -> bool:
        """Compare each new record with those before it; old ones as well, if their light or the settings have changed.

        old_too: let the limits of old records change as well. That costs new splats of them, and so it waits for the start of a
        view, when all splats are made anyway, or for its end, when it needs no more records. Returns whether the limit of an old
        record has changed. same_floor: keep the luminance floor, amid a round, so that it doesn't depend on how many ticks that
        takes. Does nothing while records are stale: that they contradict refreshed ones would mean nothing.
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
        """Go on with what a call with `old_too` will do, as far as the budget goes; whether all of it is done, so that the call
        has no more to do than to say what has changed. Splats of old records hold until then."""
        cache, inputs, done = self.cache, self._inputs(_values(settings)), self._progress
        waits = len(cache.stale) or inputs != done.inputs or done.limited != cache.count or done.compared == cache.count
        if waits or settings.adapt == 0.0:
            return True
        partly = self._partly
        if partly is None or not partly.begun_by(inputs, done.compared, cache.count):
            # of one that was left before its end, what it found the limits to be holds: no splats have been made since
            before = cache.limits(cache.count).copy()
            if partly is not None:
                before[: len(partly.before)] = partly.before[: len(before)]  # records may have gone
            partly = _Partly(inputs, done.compared, cache.count, before)
        if not partly.complete:
            self._partly = partly  # also where the pass is interrupted, which has changed limits by then
            with self.timers("adapt"):
                found, complete = self.limit_pass(cache, partly.first, settings, True, partly.done, budget)
            partly = replace(partly, done=found, complete=complete)
            self._partly = partly
        return partly.complete

    def _limit(self, settings: Settings, first: int, limited: int, old: bool, same: bool) -> bool:
        """Write the limits of the records from `first` on; whether the inputs, or the first `limited` of the limits, changed."""
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
        cache.revision += changed  # where nothing has changed, the splats of old records still hold
        return changed

    def _inputs(self, settings: tuple[object, ...]) -> tuple[object, ...]:
        return (*settings, self.cache.refresh_count, self.cache.luminance_floor)

    def state(self) -> AdaptiveRadiusState:
        """What `restore` goes on from."""
        done = self._progress
        if done.inputs is None:
            return AdaptiveRadiusState()
        return AdaptiveRadiusState(done.limited, done.compared, done.inputs[: len(_SETTINGS)])

    def restore(self, state: AdaptiveRadiusState, settings: Settings) -> None:
        """Go on from there, with the cache that belongs to it; from nothing where the settings are others."""
        if state.settings == _values(settings):
            self._progress = _Progress(state.limited, state.compared, self._inputs(state.settings))
        else:
            self._progress = _Progress()
        self._partly = None
        self._floor_of = self.cache.count, self.cache.refresh_count


def _values(settings: Settings) -> tuple[object, ...]:
    return tuple(getattr(settings, name) for name in _SETTINGS)
