"""Limits of radii: compare each record with the records near it, on the GPU, by the formula of radius_limit.frag.

A grid of the records' places finds the pairs within COMPARED_WITHIN radii a·R.
"""

from __future__ import annotations

from contextlib import ExitStack

import moderngl
import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gpu import texel_table
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import Target, float_texture, table_texture, uneven
from irrsplat.records.record_cache import RecordCache
from irrsplat.records.weight import record_defines, record_uniforms
from irrsplat.settings import Settings

COMPARED_WITHIN = 2.0  # radii a·R of a record: greatest distance of records compared with it
_TABLE = 64, 1024  # columns and rows of the records limited by one draw
_MAX_IN_GRID = 32768  # records: Mesa's software renderer silently ends a fragment's loops after 65535 iterations


class RadiusLimitPass(Owner):
    """Pass that computes the limits of records' radii."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        defines = [record_defines(gradients) | {"COMPARED_WITHIN": COMPARED_WITHIN} for gradients in (False, True)]
        self.programs = [self.own(Program(ctx, "records/radius_limit", "lib/fullscreen", some)) for some in defines]
        self.targets = self.own(float_texture(ctx, _TABLE, 1))
        self.found = self.own(Target(ctx, _TABLE, (1,)))

    def __call__(self, cache: RecordCache, first: int, settings: Settings, old: bool) -> np.ndarray:
        """Return (N,) the limits of all records. Those from number `first` on are new.

        A new record is limited by records of lower numbers, so that batch sizes do not matter. old: limit the new records by all
        others, and those before `first` by the new ones.
        """
        limits = cache.limits(cache.count).copy()
        if first < cache.count:
            limits[first:] = self._limits(cache, np.arange(first, cache.count), 0, settings, old)
            if first and old:
                near = _near(cache, first, settings)
                limits[near] = np.minimum(limits[near], self._limits(cache, near, first, settings, True))
        return limits

    def _limits(self, cache: RecordCache, numbers: np.ndarray, low: int, settings: Settings, by_all: bool) -> np.ndarray:
        """Return (K,) the limits of the records of these numbers by those from number `low` on.

        by_all: compare with records of higher numbers, too.
        """
        limits, width = np.ones(len(numbers), "f4"), _TABLE[0]
        with ExitStack() as made:
            parts = ((cache.positions[i : i + _MAX_IN_GRID], i) for i in range(low, cache.count, _MAX_IN_GRID))
            others = [made.enter_context(_Grid(self.ctx, *part)) for part in parts]
            order = np.argsort(others[0].find(cache.positions[numbers]), kind="stable")  # near records share a draw
            for start in range(0, len(numbers), _TABLE[0] * _TABLE[1]):
                part = order[start : start + _TABLE[0] * _TABLE[1]]
                texel_table.write(self.targets, 0, numbers[part, None])
                for one in others:
                    self.programs[settings.gradients](
                        self.found,
                        state=DrawState() if one is others[0] else DrawState(blend="min"),
                        scissor=(0, 0, width, -(-len(part) // width)),
                        **cache.records.uniforms,
                        **record_uniforms(settings),
                        **one.uniforms,
                        adapt=settings.adapt,
                        targets=self.targets,
                        count=len(part),
                        by_all=by_all,
                    )
                limits[part] = texel_table.read(self.ctx, self.found.textures[0], 0, len(part))[:, 0]
        return limits


class _Grid(Owner):
    """A grid of points (N, 3) float32, N > 0, for shaders/records/point_grid.glsl; first: the number of the first point.

    K³ cells lie between K + 1 planes across each axis, with about equal numbers of points between neighbouring planes: quantiles
    keep cells fine despite a few distant points. K is √N/8, at least 1. A point on a plane belongs to the cell above it.
    """

    def __init__(self, ctx: moderngl.Context, points: np.ndarray, first: int) -> None:
        self.cells = max(int(np.sqrt(len(points)) / 8.0), 1)
        inner = np.sort(points, axis=0)[len(points) * np.arange(1, self.cells) // self.cells]
        self.planes = np.concatenate([points.min(0)[None], inner, points.max(0)[None]])
        cell = self.find(points)
        order, starts = np.argsort(cell, kind="stable"), np.cumsum([0, *np.bincount(cell, minlength=self.cells**3)])
        self.edges = self.own(table_texture(ctx, np.pad(self.planes, ((0, 0), (0, 1)))[None], varying=True))
        self.starts = self.own(float_texture(ctx, (TABLE_COLUMNS, uneven(texel_table.row_count(len(starts)))), 1))
        texel_table.write(self.starts, 0, starts[:, None])
        self.places = self.own(float_texture(ctx, (TABLE_COLUMNS, uneven(texel_table.row_count(len(order))))))
        texel_table.write(self.places, 0, np.column_stack([points[order], first + order]))

    def find(self, points: np.ndarray) -> np.ndarray:
        """Return (N,) the numbers of the cells of points (N, 3); the outermost cells extend to infinity."""
        x, y, z = (np.searchsorted(e, p, side="right") for e, p in zip(self.planes[1:-1].T, points.T, strict=True))
        cells: np.ndarray = (z * self.cells + y) * self.cells + x
        return cells

    @property
    def uniforms(self) -> Uniforms:
        """Uniforms of records/point_grid.glsl."""
        textures = {"grid_edges": self.edges, "grid_starts": self.starts, "grid_points": self.places}
        return {**textures, "grid_cells": self.cells}


def _near(cache: RecordCache, first: int, settings: Settings) -> np.ndarray:
    """Return the numbers of records before `first` that a later record may be compared with.

    Their spheres of COMPARED_WITHIN radii touch the bounding box of the later records.
    """
    old, new = cache.positions[:first], cache.positions[first:]
    apart = np.maximum(np.maximum(new.min(0) - old, old - new.max(0)), 0.0)
    R = cache.values[:first, 3] * np.float32(1.001 * COMPARED_WITHIN * settings.a * settings.widest)
    return np.flatnonzero((apart * apart).sum(1) <= R * R)
