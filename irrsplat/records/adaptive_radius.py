"""Adaptive radii: a record reaches less far where it contradicts another (after Krivanek et al. 2006, "adaptive caching").

What a record says of another's place, by its derivatives, is held against what was gathered there. Their difference, relative to
the brighter of the two, is taken to grow with the square of the distance, so that a·R is limited to where it comes to `adapt`.
Others beyond twice its reach tell nothing of a record, so that only those near it are looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import moderngl
import numpy as np

from irrsplat.gpu import texel_table
from irrsplat.gpu.program import Program, State
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target, float_texture, table_texture
from irrsplat.gpu.timers import Timers
from irrsplat.records import point_grid
from irrsplat.records.record_cache import RecordCache
from irrsplat.settings import Settings, record_uniforms, weight_defines

_NEVER = 1e30  # a difference that no two records have
_FAR = 2.0  # in reaches: how far others are held against a record
_SIZE = 64, 1024  # of the table of records that are limited by one draw; narrow, so that near ones are drawn together
_COLUMNS = 1024  # of the grid's tables
# records in one grid: a fragment of Mesa's software renderer ends its loops after 65535 rounds, whatever is left
_MOST = 32768
_LATELY = 2048  # records that are in a grid of their own until there are so many


class AdaptPass(Owner):
    """Writes the limits of records' radii into the cache; neighbours: they may not differ by more than the records' distance."""

    def __init__(self, ctx: moderngl.Context, gradients: bool, neighbours: bool) -> None:
        self.ctx = ctx
        defines = weight_defines(gradients) | {"NEIGHBOURS": int(neighbours), "GRID_COLUMNS": _COLUMNS, "FAR": _FAR}
        self.program = Program(ctx, "records/adapt", "lib/fullscreen", defines)
        self.place = Program(ctx, "records/adapt_place")
        self.targets = float_texture(ctx, _SIZE, 1)
        self.found = Target(ctx, _SIZE, (1,))
        self.out: Target | None = None  # the cache's own texture
        self._grids: dict[tuple[int, int], _Tables] = {}

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.program, self.place, self.targets, self.found, self.out, *self._grids.values())

    def __call__(self, cache: RecordCache, first: int, settings: Settings, old: bool = True) -> None:
        """Limit the records from number `first` on by all others, and, where `old` ones are wanted, those before it by them."""
        if first == cache.count:
            return
        if self.out is None or self.out.textures[0] is not cache.records.limit:
            self.out = Target(self.ctx, cache.records.limit.size, textures=[cache.records.limit])
        everything = self._tables(cache.positions, 0)
        self._limit(cache, np.arange(first, cache.count), everything, settings, State())
        if first and old:
            near = _reaching(cache, first, settings)
            self._limit(cache, near, self._tables(cache.positions, first), settings, State(blend="min"))

    def _limit(self, cache: RecordCache, numbers: np.ndarray, others: list[_Tables], settings: Settings, state: State) -> None:
        """Limit the records of these numbers by those in the tables of `others`; state: how a limit goes to the one there was."""
        assert self.out is not None
        records, width = cache.records, _SIZE[0]
        numbers = numbers[np.argsort(others[0].grid.find(cache.positions[numbers]), kind="stable")]
        for start in range(0, len(numbers), _SIZE[0] * _SIZE[1]):
            part = numbers[start : start + _SIZE[0] * _SIZE[1]]
            texel_table.write(self.targets, 0, part[:, None])
            for one in others:
                self.program(
                    self.found,
                    state=State() if one is others[0] else State(blend="min"),
                    scissor=(0, 0, width, -(-len(part) // width)),
                    **{name: value for name, value in records.uniforms.items() if name in self.program.uniforms},
                    **record_uniforms(settings),
                    **one.uniforms,
                    adapt=settings.adapt or _NEVER,
                    targets=self.targets,
                    count=len(part),
                )
            self.place(
                self.out,
                state=state,
                mode=moderngl.POINTS,
                vertices=len(part),
                targets=self.targets,
                limits=self.found.textures[0],
                table=records.limit.size,
            )

    def _tables(self, positions: np.ndarray, first: int) -> list[_Tables]:
        """Grids of all records from number `first` on; those made before are taken again where nothing has changed in them."""
        count, made = len(positions), {}
        settled = max(count // _LATELY * _LATELY, first)
        cuts = sorted({first, *range(-(-first // _MOST) * _MOST, settled, _MOST), settled, count})
        for low, high in pairwise(cuts):
            old, points = self._grids.pop((low, high), None), positions[low:high]
            if old is not None and not np.array_equal(old.points, points):
                old.release()
                old = None
            made[low, high] = old or _Tables(self.ctx, points.copy(), low)
        if first == 0:
            self._forget()
        self._grids |= made
        return list(made.values())

    def _forget(self) -> None:
        for one in self._grids.values():
            one.release()
        self._grids.clear()


class _Tables(Owner):
    """A grid of points (N, 3) on the GPU, as shaders/records/grid.glsl has it; first: the number of the first of them."""

    def __init__(self, ctx: moderngl.Context, points: np.ndarray, first: int) -> None:
        self.points, self.grid = points, point_grid.build(points)
        order, starts = self.grid.order, self.grid.starts
        self.edges = table_texture(ctx, np.pad(self.grid.edges, ((0, 0), (0, 1)))[None])
        self.starts = float_texture(ctx, (_COLUMNS, -(-len(starts) // _COLUMNS)), 1)
        texel_table.write(self.starts, 0, starts[:, None])
        self.places = float_texture(ctx, (_COLUMNS, -(-len(order) // _COLUMNS)))
        texel_table.write(self.places, 0, np.column_stack([points[order], first + order]))

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.edges, self.starts, self.places)

    @property
    def uniforms(self) -> dict[str, Any]:
        """Those of records/grid.glsl."""
        return {
            "grid_edges": self.edges,
            "grid_starts": self.starts,
            "grid_points": self.places,
            "grid_cells": self.grid.cells,
        }


def _reaching(cache: RecordCache, first: int, settings: Settings) -> np.ndarray:
    """The numbers of the records before `first` that may reach one from there on: their spheres touch the box about those."""
    old, new = cache.positions[:first], cache.positions[first:]
    apart = np.maximum(np.maximum(new.min(0) - old, old - new.max(0)), 0.0)
    R = cache.values[:first, 3] * np.float32(1.001 * _FAR * settings.a * settings.widest)
    return np.flatnonzero((apart * apart).sum(1) <= R * R)


# settings that limits of radii depend on
_BY = ("a", "adapt", "neighbours", "gradients", "second_order", "radius", "walls")


@dataclass(frozen=True)
class AdaptationState:
    """How far adaptation has come: the records with a limit, those of them that are held against all others too, and the values
    of the settings that both were done with (none: nothing is done yet)."""

    limited: int = 0
    compared: int = 0
    settings: tuple[object, ...] = ()

    def as_json(self) -> list[object]:
        """For a file: one flat list."""
        return [self.limited, self.compared, *self.settings]

    @classmethod
    def from_json(cls, values: Sequence[Any]) -> AdaptationState:
        """Raises TypeError or ValueError where `values` is no such list."""
        limited, compared, *settings = values
        return cls(int(limited), int(compared), tuple(settings))


class Adaptation(Owner):
    """Keeps the limits of the `cache`'s records as they are to be."""

    def __init__(self, ctx: moderngl.Context, settings: Settings, cache: RecordCache, timers: Timers) -> None:
        self.ctx, self.cache, self.timers = ctx, cache, timers
        self.adapt_pass = AdaptPass(ctx, settings.gradients, settings.neighbours)
        self._made_for = settings.gradients, settings.neighbours
        # how many records, how many of them by all others, and by what
        self._adapted: tuple[int, int, tuple[Any, ...] | None] = 0, 0, None
        self._gauged = 0, 0  # of how many records, and how often gathered again, the cache has the gauge

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.adapt_pass,)

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

    def __call__(self, settings: Settings, old_too: bool) -> bool:
        """Hold the records that are new, or all where their light or the settings have changed, against each other.

        old_too: those that were there may reach less far for it as well; this can wait for another view, since all of them are
        splatted anew then, or until a view asks for nothing else. Returns whether any of them reaches otherwise now.
        Not while some are stale: they would contradict those that are renewed, and mean nothing by it.
        """
        cache, old = self.cache, old_too
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

    def state(self) -> AdaptationState:
        """What `restore` goes on from."""
        count, held, by = self._adapted
        return AdaptationState() if by is None else AdaptationState(count, held, by[: len(_BY)])

    def restore(self, state: AdaptationState, settings: Settings) -> None:
        """Go on from there, where the settings are the same, with the cache that belongs to it; else from nothing."""
        cache = self.cache
        same = state.settings == tuple(getattr(settings, name) for name in _BY)
        by = *state.settings, cache.renewals, cache.dark
        self._adapted = (state.limited, state.compared, by) if same else (0, 0, None)
        self._gauged = cache.count, cache.renewals
