"""The tables of the surface cache in shaders: the cells of every triangle, and the values at their corners; and the
sites with these tables, on the GPU."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np

from irrsplat.core.buffers import Sites, Uniforms
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gather.record_frame import PLACES, rows_of_places
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import table_texture
from irrsplat.gpu.texel_table import row_count, table_rows
from irrsplat.records.record_cache import RecordCache
from irrsplat.surface_cache.site_layout import SiteLayout
from irrsplat.surface_cache.transport import BouncedLight, Transport


class LookupTable(Owner):
    """The textures of shaders/surface_cache/lookup.glsl.

    rows: (T, 2) of the triangles that light sees, see Tessellation.table. cells: see SiteLayout.cells.
    count: of the values. known: False where the first row stands for all triangles.
    """

    def __init__(self, ctx: moderngl.Context, rows: np.ndarray, cells: np.ndarray, count: int, known: bool = True) -> None:
        self._known = known
        self.values = self.own(table_texture(ctx, np.zeros((row_count(count), TABLE_COLUMNS, 4)), varying=True))
        self.cells = self.own(table_texture(ctx, table_rows(cells), varying=True))
        self.triangles = self.own(table_texture(ctx, table_rows(np.pad(rows, ((0, 0), (0, 2)))[:, None]), varying=True))

    @property
    def uniforms(self) -> Uniforms:
        """The uniforms except the triangles' corners (TriangleTable.corner_uniforms)."""
        return {
            "surface_triangles": self.triangles,
            "surface_cells": self.cells,
            "surface_values": self.values,
            "surface_known": int(self._known),
        }

    def write(self, values: np.ndarray, area: np.ndarray) -> None:
        """Set the values, (S, 3) of W/m². area: (S,) m² of the surface that each represents."""
        rows = np.zeros((self.values.width * self.values.height, 4), "f4")
        rows[: len(values)] = value_rows(values, area)
        self.values.write(rows.tobytes())


def value_rows(values: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return (S, 4) float32, the texels of surface_values: values (S, 3) in W/m², and the extents in metres of `area` (S,)."""
    return np.column_stack([values, np.sqrt(area)]).astype("f4")


def unknown(ctx: moderngl.Context) -> LookupTable:
    """Return an empty table for any scene: every lookup finds no value, so that no light is added."""
    return LookupTable(ctx, np.array([[1.0, 0.0]]), np.array([[[-1.0, -1.0, -1.0, 0.0]] * 2]), 1, known=False)


class LaidOut(Owner):
    """Sites on the GPU: a record for each of S values, in the order of the values, and their lookup table.

    area: (S,) m² of the surface that each stands for. level: (S,) see SiteLayout. places: (S·PLACES,) the origins of their rays,
    site by site, with their triangles. transport: between the sites. light: at the sites. None: not known yet.
    """

    def __init__(self, ctx: moderngl.Context, layout: SiteLayout) -> None:
        self.area, self.level = layout.area, layout.level
        self.places: Sites | None = None
        self.transport: Transport | None = None
        self.light: BouncedLight | None = None
        self.records = self.own(RecordCache(ctx))
        self.table = self.own(LookupTable(ctx, layout.triangles, layout.cells, max(len(layout.sites), 1)))
        if len(layout.sites):
            self.records.append(layout.sites)
            self.records.invalidate()

    def origins(self, numbers: np.ndarray) -> Sites:
        """Return the origins of rays of the sites of these numbers: their places, or the sites themselves without any."""
        if self.places is None:
            return self.records.sites(numbers)
        rows = rows_of_places(numbers, PLACES)
        return replace(self.places[rows], frame_rotation=rows)
