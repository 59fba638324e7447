"""Limits of radii: compare each record with the records near it, on the GPU, by the formula of radius_limit.frag.

A grid of the records' places finds the pairs within COMPARED_WITHIN radii a·R.
"""

from __future__ import annotations

from itertools import pairwise

import moderngl
import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gpu import texel_table
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target, float_texture, table_texture
from irrsplat.gpu.time_budget import Budget, Pace
from irrsplat.records import point_grid
from irrsplat.records.record_cache import RecordCache
from irrsplat.records.weight import record_defines, record_uniforms
from irrsplat.settings import Settings

COMPARED_WITHIN = 2.0  # radii a·R of a record: greatest distance of records compared with it
_TABLE = (
    64,
    1024,
)  # columns and rows of the records limited by one draw; narrow, so that near records share a draw
_MAX_IN_GRID = 32768  # records: Mesa's software renderer silently ends a fragment's loops after 65535 iterations
_RECENT = 2048  # records: the newest have a grid of their own up to this number, so that the other grids stay valid


class RadiusLimitPass(Owner):
    """Pass that writes the limits of records' radii into the cache; gradients: records have derivatives."""

    def __init__(self, ctx: moderngl.Context, gradients: bool) -> None:
        self.ctx = ctx
        defines = record_defines(gradients) | {"COMPARED_WITHIN": COMPARED_WITHIN}
        self.program = Program(ctx, "records/radius_limit", "lib/fullscreen", defines)
        self.write = Program(ctx, "records/radius_limit_write")
        self.targets = float_texture(ctx, _TABLE, 1)
        self.found = Target(ctx, _TABLE, (1,))
        self.out: Target | None = None  # the cache's own texture
        self._grids: dict[tuple[int, int], _Grid] = {}
        self._pace = Pace(ctx)  # of records

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (self.program, self.write, self.targets, self.found, self.out, *self._grids.values())

    def __call__(
        self, cache: RecordCache, first: int, settings: Settings, old: bool = True, start: int = 0, budget: Budget | None = None
    ) -> tuple[int, bool]:
        """Limit the records from number `first` on, each by records of lower numbers, so that batch sizes do not matter.

        old: limit the new records by all others, and those before `first` by the new ones. budget: extent of this call (None:
        to the end). start: number of records limited by earlier calls with the same cache content. Return the number of limited
        records, and True if all are.
        """
        if first == cache.count:
            return 0, True
        limit = cache.records.textures["limit"]
        if self.out is None or self.out.textures[0] is not limit:
            if self.out is not None:
                self.out.release()
            self.out = Target(self.ctx, cache.records.size, textures=[limit])
        everything = self._grids_of(cache.positions, 0)
        works = [(np.arange(first, cache.count), everything, DrawState())]
        if first and old:
            works.append((_near(cache, first, settings), self._grids_of(cache.positions, first), DrawState(blend="min")))
        works = [(numbers[np.argsort(grids[0].cells.find(cache.positions[numbers]), kind="stable")], grids, state)
                 for numbers, grids, state in works]  # fmt: skip
        total = sum(len(numbers) for numbers, _, _ in works)
        for count in self._pace.batches(total - start, total, budget or Budget(None)):
            before = 0
            for numbers, grids, state in works:
                low, high = (min(max(end - before, 0), len(numbers)) for end in (start, start + count))
                if low < high:
                    self._limit(cache, numbers[low:high], grids, settings, state, old)
                before += len(numbers)
            start += count
        return start, start == total

    def _limit(
        self, cache: RecordCache, numbers: np.ndarray, others: list[_Grid], settings: Settings, state: DrawState, by_all: bool
    ) -> None:
        """Limit the records of these numbers, sorted by place, by those in the grids.

        state: combination of a limit with the one in the cache.
        """
        assert self.out is not None
        records, width = cache.records, _TABLE[0]
        for start in range(0, len(numbers), _TABLE[0] * _TABLE[1]):
            part = numbers[start : start + _TABLE[0] * _TABLE[1]]
            texel_table.write(self.targets, 0, part[:, None])
            for one in others:
                self.program(
                    self.found,
                    state=DrawState() if one is others[0] else DrawState(blend="min"),
                    scissor=(0, 0, width, -(-len(part) // width)),
                    **records.uniforms,
                    **record_uniforms(settings),
                    **one.uniforms,
                    adapt=settings.adapt,
                    targets=self.targets,
                    count=len(part),
                    by_all=by_all,
                )
            self.write(
                self.out,
                state=state,
                mode=moderngl.POINTS,
                vertices=len(part),
                targets=self.targets,
                limits=self.found.textures[0],
                table=records.size,
            )

    def _grids_of(self, positions: np.ndarray, first: int) -> list[_Grid]:
        """Return grids of all records from number `first` on; a grid whose records have not moved is used again."""
        count, made = len(positions), {}
        settled = max(count // _RECENT * _RECENT, first)
        cuts = sorted({first, *range(-(-first // _MAX_IN_GRID) * _MAX_IN_GRID, settled, _MAX_IN_GRID), settled, count})
        for low, high in pairwise(cuts):
            old, points = self._grids.pop((low, high), None), positions[low:high]
            if old is not None and not np.array_equal(old.points, points):
                old.release()
                old = None
            made[low, high] = old or _Grid(self.ctx, points.copy(), low)
        if first == 0:
            self._forget()
        self._grids |= made
        return list(made.values())

    def _forget(self) -> None:
        for one in self._grids.values():
            one.release()
        self._grids.clear()


class _Grid(Owner):
    """A grid of points (N, 3) on the GPU for shaders/records/point_grid.glsl; first: the number of the first point."""

    def __init__(self, ctx: moderngl.Context, points: np.ndarray, first: int) -> None:
        self.points, self.cells = points, point_grid.build(points)
        order, starts = self.cells.order, self.cells.starts
        self.edges = table_texture(ctx, np.pad(self.cells.edges, ((0, 0), (0, 1)))[None])
        self.starts = float_texture(ctx, (TABLE_COLUMNS, -(-len(starts) // TABLE_COLUMNS)), 1)
        texel_table.write(self.starts, 0, starts[:, None])
        self.places = float_texture(ctx, (TABLE_COLUMNS, -(-len(order) // TABLE_COLUMNS)))
        texel_table.write(self.places, 0, np.column_stack([points[order], first + order]))

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (self.edges, self.starts, self.places)

    @property
    def uniforms(self) -> Uniforms:
        """Uniforms of records/point_grid.glsl."""
        return {
            "grid_edges": self.edges,
            "grid_starts": self.starts,
            "grid_points": self.places,
            "grid_cells": self.cells.cells,
        }


def _near(cache: RecordCache, first: int, settings: Settings) -> np.ndarray:
    """Return the numbers of records before `first` that a later record may be compared with.

    Their spheres of COMPARED_WITHIN radii touch the bounding box of the later records.
    """
    old, new = cache.positions[:first], cache.positions[first:]
    apart = np.maximum(np.maximum(new.min(0) - old, old - new.max(0)), 0.0)
    R = cache.values[:first, 3] * np.float32(1.001 * COMPARED_WITHIN * settings.a * settings.widest)
    return np.flatnonzero((apart * apart).sum(1) <= R * R)
