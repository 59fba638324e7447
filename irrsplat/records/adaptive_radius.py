"""Adaptive radii: inter-record variance limits the reach of records (after Křivánek et al. 2006, "adaptive caching").

radius_limit_pass.py computes the limits; this module decides when, and for which records.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import moderngl
import numpy as np

from irrsplat.gpu.resource import Owner
from irrsplat.gpu.timers import Timers
from irrsplat.records.radius_limit_pass import RadiusLimitPass
from irrsplat.records.record_cache import RecordCache
from irrsplat.settings import Settings

_FEW = 1 / 8  # share of new records below which a splat of all records costs more than old limits gain
_SETTINGS = ("a", "adapt", "gradients", "weights")  # settings that limits depend on


@dataclass(frozen=True)
class _Progress:
    """Progress of the adaptation.

    limited: records with limits. compared: records by which all others are limited as well. inputs: the inputs of
    both: values of the settings, the number of refreshes and the luminance floor; empty before the first adaptation.
    """

    limited: int = 0
    compared: int = 0
    inputs: tuple[object, ...] = ()


class AdaptiveRadius(Owner):
    """Keeps the limits of the radii of a cache's records up to date."""

    def __init__(self, ctx: moderngl.Context, cache: RecordCache, timers: Timers) -> None:
        self.cache, self.timers, self.limit_pass = cache, timers, self.own(RadiusLimitPass(ctx))
        self._progress = _Progress()
        self._floor_of = 0, 0  # record count and refresh count at the last update of the luminance floor

    def keep(self, numbers: np.ndarray) -> None:
        """Drop all records except these numbers, ascending."""
        limited, compared = (int(np.searchsorted(numbers, n)) for n in (self._progress.limited, self._progress.compared))
        self._progress = _Progress(limited, compared, self._progress.inputs)

    def __call__(self, settings: Settings, old_too: bool, same_floor: bool = False) -> bool:
        """Compare each new record with the records before it; return True if the limit of an old record changed.

        old_too: update the limits of old records as well, unless new ones are few. A changed limit costs a new splat of all
        records. Callers therefore set it at the start of a view, when all splats are made anyway, or at its end, when the view
        needs no more records.
        same_floor: keep the luminance floor during a round, so that the result does not depend on the number of frames.
        Does nothing while records are stale: their variance against refreshed records has no meaning.
        """
        cache = self.cache
        if len(cache.stale):
            return False
        if settings.gradients and not same_floor and (cache.count, cache.refresh_count) != self._floor_of:
            self._floor_of = cache.count, cache.refresh_count
            cache.update_luminance_floor()
        inputs = self._inputs(vars(settings))
        same = inputs == self._progress.inputs
        done = self._progress if same else _Progress()
        limited, compared = min(done.limited, cache.count), min(done.compared, cache.count)
        old_too = old_too and cache.count - compared >= int(_FEW * cache.count)
        first = compared if old_too else limited
        changed = False
        if not same or first < cache.count:
            with self.timers("adapt"):
                before = cache.limits(limited)
                if settings.adapt > 0.0 and cache.count:
                    cache.set_limits(self.limit_pass(cache, first, settings, old_too))
                elif not same:
                    cache.set_limits(np.ones(cache.count))
                changed = not same or not np.array_equal(before, cache.limits(limited))
            cache.revision += changed  # unchanged limits keep the splats of old records valid
        self._progress = _Progress(cache.count, cache.count if old_too else compared, inputs)
        return changed

    def _inputs(self, settings: Mapping[str, object]) -> tuple[object, ...]:
        return (*(settings.get(name) for name in _SETTINGS), self.cache.refresh_count, self.cache.luminance_floor)

    def is_current(self, settings: Settings) -> bool:
        """True if all present records have limits by these settings."""
        return self._progress.limited == self.cache.count and self._progress.inputs == self._inputs(vars(settings))

    @property
    def compared(self) -> int:
        """The number of records by which all others are limited."""
        return self._progress.compared

    def accept(self, settings: Mapping[str, object], compared: int) -> None:
        """Take the present limits, and the luminance floor, as those by `settings` with so many records `compared`."""
        self._progress = _Progress(self.cache.count, compared, self._inputs(settings)) if compared else _Progress()
        self._floor_of = self.cache.count, self.cache.refresh_count
