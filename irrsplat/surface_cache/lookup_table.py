"""The tables by which shaders look the surface cache up: the cells of every triangle, and the values at their corners; and the
sites with these tables, on the GPU."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import table_texture
from irrsplat.gpu.texel_table import table_rows
from irrsplat.records.record_cache import RecordCache
from irrsplat.surface_cache.site_layout import MAX_REFINED_SITES, MAX_SITES, SiteLayout
from irrsplat.surface_cache.site_places import Places
from irrsplat.surface_cache.transport import BouncedLight


class LookupTable(Owner):
    """The textures of shaders/surface_cache/lookup.glsl.

    rows: (T, 3, 4) of the triangles that light sees, as Tessellation.table has them. cells: as SiteLayout.cells has them.
    most: how many values there may be. known: False where the first row stands for all triangles. like: one that outlives this
    one, of the same triangles; what was made of the same arrays is borrowed from it.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        rows: np.ndarray,
        cells: np.ndarray,
        most: int,
        known: bool = True,
        like: LookupTable | None = None,
    ) -> None:
        self._rows, self._cells, self._known = rows, cells, known
        self._own: list[Resource] = []
        triangles = like if like is not None and like._rows is rows else None
        same = like if like is not None and like._cells is cells else None
        self.values = self._texture(ctx, np.zeros((-(-most // TABLE_COLUMNS), TABLE_COLUMNS, 4)))
        self.cells: moderngl.Texture = same.cells if same else self._texture(ctx, table_rows(cells))
        self.triangles: moderngl.Texture = triangles.triangles if triangles else self._texture(ctx, table_rows(rows))

    def _texture(self, ctx: moderngl.Context, table: np.ndarray) -> moderngl.Texture:
        self._own.append(made := table_texture(ctx, table))
        return made

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees: all but what is borrowed."""
        return tuple(self._own)

    @property
    def uniforms(self) -> Uniforms:
        """The uniforms."""
        return {
            "surface_triangles": self.triangles,
            "surface_cells": self.cells,
            "surface_values": self.values,
            "surface_known": int(self._known),
        }

    def write(self, values: np.ndarray) -> None:
        """Set the values, (S, 3) of W/m²."""
        rows = np.zeros((self.values.width * self.values.height, 4), "f4")
        rows[: len(values), :3] = values
        self.values.write(rows.tobytes())

    def follow(self, corners: np.ndarray) -> None:
        """Set the triangles' corners (F, 3, 3); each keeps its cells and their values."""
        if not self._known:
            return
        rows, corners = self._rows.copy(), corners[: len(self._rows)]
        rows[:, 0, :3] = corners[:, 0]
        rows[:, 1:, :3] = corners[:, 1:] - corners[:, :1]
        self._rows = rows
        self.triangles.write(np.ascontiguousarray(table_rows(rows), "f4").tobytes())


def unknown(ctx: moderngl.Context) -> LookupTable:
    """The table of no scene in particular, by which every look-up finds no value, so that no light is added."""
    row = np.array([[[0.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]])
    return LookupTable(ctx, row, np.array([[[-1.0, -1.0, -1.0, 0.0]] * 2]), 1, known=False)


class LaidOut(Owner):
    """Sites on the GPU: a record for each value, in the order of the values, and the table by which these are looked up.
    places: where they look from; None until that is known.
    like: one that outlives this one, of the same triangles: tables of a million take most of a second."""

    def __init__(self, ctx: moderngl.Context, layout: SiteLayout, like: LaidOut | None = None) -> None:
        self.layout = layout
        self.places: Places | None = None
        self.records = RecordCache(ctx)
        other: LookupTable | None = None if like is None else like.table
        most = MAX_SITES if len(layout.sites) <= MAX_SITES else MAX_REFINED_SITES
        self.table: LookupTable = LookupTable(ctx, layout.tessellation.table, layout.cells, most, like=other)
        if len(layout.sites):
            self.records.append(layout.sites)
            self.records.invalidate()

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.records, self.table)


@dataclass(frozen=True)
class Held:
    """What lookups find: `table`, whose values are `light`, those of the sites `laid_out`; None before the first are made.

    complete: whether they are what scene and settings ask for.
    """

    table: LookupTable
    laid_out: LaidOut | None = None
    light: BouncedLight | None = None
    complete: bool = False
