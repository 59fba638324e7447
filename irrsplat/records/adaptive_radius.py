"""Adaptive radii: inter-record variance limits the reach of records (after Křivánek et al. 2006, "adaptive caching").

The limits follow from comparisons of each record with those near it, on the GPU, by the formula of radius_limit.frag. All records
are cut into strips along the axis of their greatest extent. Within a strip, the records within COMPARED_WITHIN radii a·R are a
range in the order of their places along this axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import moderngl
import numpy as np

from irrsplat.gpu import texel_table
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target, float_texture
from irrsplat.gpu.timers import Timers
from irrsplat.records.record_cache import RecordCache
from irrsplat.records.weight import record_defines, record_uniforms
from irrsplat.settings import Settings

_FEW = 1 / 8  # share of new records below which a splat of all records costs more than old limits gain
_SETTINGS = ("a", "adapt", "gradients", "weights")  # settings that limits depend on
COMPARED_WITHIN = 2.0  # radii a·R of a record: greatest distance of records compared with it
_STRIP = 1024  # records per strip, if all are compared with all: smaller strips need more draws, larger ones more comparisons
_LOOP = 65535  # iterations after which Mesa's software renderer silently ends the loops of a fragment


class AdaptiveRadius(Owner):
    """Keeps the limits of the radii of a cache's records up to date.

    compared: the number of records by which all others are limited.
    """

    def __init__(self, ctx: moderngl.Context, cache: RecordCache, timers: Timers) -> None:
        self.ctx, self.cache, self.timers = ctx, cache, timers
        defines = [record_defines(gradients) | {"COMPARED_WITHIN": COMPARED_WITHIN} for gradients in (False, True)]
        self.programs = [self.own(Program(ctx, "records/radius_limit", "lib/fullscreen", some)) for some in defines]
        self._made = self.own(Workshop())  # the tables of both kinds of records, and the target
        self._limited = self.compared = 0  # number of records with limits
        self._made_for: tuple[object, ...] = ()  # values of the settings, number of refreshes and luminance floor, see _inputs
        self._floor_of = 0, 0  # record count and refresh count at the last update of the luminance floor

    def keep(self, numbers: np.ndarray) -> None:
        """Drop all records except these numbers, ascending."""
        self._limited, self.compared = (int(np.searchsorted(numbers, n)) for n in (self._limited, self.compared))

    def __call__(self, settings: Settings, old_too: bool, same_floor: bool = False) -> bool:
        """Compare each new record with the records before it; return True if the limit of an old record changed.

        old_too: update the limits of old records as well, unless new ones are few. A changed limit costs a new splat of all
        records. Callers therefore set it where a view begins, and when it needs no more records.
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
        same = inputs == self._made_for
        limited, compared = (min(n, cache.count) if same else 0 for n in (self._limited, self.compared))
        old_too = old_too and cache.count - compared >= int(_FEW * cache.count)
        first = compared if old_too else limited
        changed = False
        if not same or first < cache.count:
            with self.timers("adapt"):
                before = cache.limits(limited)
                if cache.count and (settings.adapt > 0.0 or not same):
                    cache.set_limits(self.limits(first, settings, old_too))
                changed = not same or not np.array_equal(before, cache.limits(limited))
            cache.revision += changed  # unchanged limits keep the splats of old records valid
        self._limited, self.compared, self._made_for = cache.count, cache.count if old_too else compared, inputs
        return changed

    def _inputs(self, settings: Mapping[str, object]) -> tuple[object, ...]:
        return (*(settings.get(name) for name in _SETTINGS), self.cache.refresh_count, self.cache.luminance_floor)

    def is_current(self, settings: Settings) -> bool:
        """True if all present records have limits by these settings."""
        return self._limited == self.cache.count and self._made_for == self._inputs(vars(settings))

    def accept(self, settings: Mapping[str, object], compared: int) -> None:
        """Take the present limits, and the luminance floor, as those by `settings` with so many records `compared`."""
        self._limited, self.compared = self.cache.count if compared else 0, compared
        self._made_for = self._inputs(settings) if compared else ()
        self._floor_of = self.cache.count, self.cache.refresh_count

    def limits(self, first: int, settings: Settings, old: bool) -> np.ndarray:
        """Return (N,) the limits of all records. Those from number `first` on are new: one at least. Radii in metres stay.

        A new record is limited by records of lower numbers, so that batch sizes do not matter. old: limit the new records by all
        others, and those before `first` by the new ones.
        """
        count = self.cache.count
        before = self.cache.limits(count)
        limits = before.copy()
        limits[first:] = self._limits(slice(first, count), 0, settings, old) if settings.adapt > 0.0 else 1.0
        if first and old and settings.adapt > 0.0:
            limits[:first] = np.minimum(limits[:first], self._limits(slice(first), first, settings, True))
        return np.where(before < 0.0, before, limits)

    def _limits(self, which: slice, low: int, settings: Settings, by_all: bool) -> np.ndarray:
        """Return (K,) the limits of the records `which` by those from number `low` on.

        by_all: compare with records of higher numbers, too.
        """
        cache, size, places = self.cache, self.cache.records.size, self.cache.positions
        found = self._made.get("found", size, lambda: Target(self.ctx, size, (1,)))
        targets = self._made.get("targets", size, lambda: float_texture(self.ctx, size, 1))
        others = self._made.get("others", size, lambda: float_texture(self.ctx, size))
        axes = _, across = np.ptp(places, axis=0).argsort()[:0:-1].tolist()
        order = np.concatenate(_strips(places[which], axes, len(places[which])))  # near records share a block
        texel_table.write(targets, 0, (order + which.indices(cache.count)[0])[:, None])
        begin = 0
        for numbers in _strips(places[low:], axes, len(order)):
            strip = low + numbers
            texel_table.write(others, begin, np.column_stack([places[strip], strip]))
            self.programs[settings.gradients](
                found,
                state=DrawState(blend="min") if begin else DrawState(),
                scissor=(0, 0, size[0], -(-len(order) // size[0])),
                **cache.records.uniforms,
                **record_uniforms(settings),
                adapt=settings.adapt,
                targets=targets,
                count=len(order),
                by_all=by_all,
                others=others,
                axes=axes,
                bounds=(places[strip, across].min(), places[strip, across].max()),
                span=(begin, begin + len(strip)),
            )
            begin += len(strip)
        limits = np.empty(len(order), "f4")
        limits[order] = texel_table.read(self.ctx, found.textures[0], 0, len(order))[:, 0]
        return limits


def _strips(places: np.ndarray, axes: tuple[int, int], targets: int) -> list[np.ndarray]:
    """Return the numbers of places (N, 3) in strips along the first of the `axes` and across the second, each in its order.

    targets: the number of records that are compared with them; with fewer, draws cost more than comparisons.
    """
    along, across = axes
    count = max(math.ceil(math.sqrt(targets * len(places)) / _STRIP), math.ceil(len(places) / _LOOP), 1)
    strips = np.array_split(np.argsort(places[:, across], kind="stable"), count)
    return [strip[np.argsort(places[strip, along], kind="stable")] for strip in strips]
