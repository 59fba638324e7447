"""The sites of a surface cache on the GPU: their records, and the tables for lookups in shaders."""

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
from irrsplat.gpu.world import World
from irrsplat.records.record_cache import RecordCache
from irrsplat.surface_cache.site_layout import SiteLayout
from irrsplat.surface_cache.tessellation import Grading
from irrsplat.surface_cache.transport import BouncedLight, Transport


class SurfaceSites(Owner):
    """Sites on the GPU: a record for each of S values, in the order of the values, and the textures for lookups.

    area: (S,) area of the surface that each site represents, m². level, grading: see SiteLayout. places: (S·PLACES,) ray origins,
    site by site, with their triangles. transport: light between the sites. light: light at the sites. Each is None while it is
    unknown.
    """

    def __init__(self, ctx: moderngl.Context, layout: SiteLayout) -> None:
        self.area, self.level, self.grading, count = layout.area, layout.level, layout.grading, len(layout.sites)
        self.places: Sites | None = None
        self.transport: Transport | None = None
        self.light: BouncedLight | None = None
        self.records = self.own(RecordCache(ctx))
        self.values = self.own(table_texture(ctx, np.zeros((row_count(count), TABLE_COLUMNS, 4)), varying=True))
        self.cells = self.own(table_texture(ctx, table_rows(layout.cells), varying=True))
        self._triangles = self.own(table_texture(ctx, table_rows(layout.triangles), varying=True))
        if count:
            self.records.append(layout.sites)
            self.records.invalidate()

    def origins(self, numbers: np.ndarray) -> Sites:
        """Return the origins of rays of the sites of these numbers: their places, or the sites themselves without any."""
        if self.places is None:
            return self.records.sites(numbers)
        rows = rows_of_places(numbers, PLACES)
        return replace(self.places[rows], frame_rotation=rows)

    def uniforms(self, world: World) -> Uniforms:
        """Return the uniforms of shaders/surface_cache/lookup.glsl in this `world`."""
        return world.triangles.corner_uniforms | {
            "surface_triangles": self._triangles,
            "surface_cells": self.cells,
            "surface_values": self.values,
            "surface_known": int(self.records.count > 0),
        }

    def show(self, light: BouncedLight) -> None:
        """Let lookups find the values of this light, with the extents of the sites in metres."""
        rows = np.zeros((self.values.width * self.values.height, 4), "f4")
        rows[: len(self.area)] = np.column_stack([light.irradiance, np.sqrt(self.area)])
        self.values.write(rows.tobytes())
        self.light = light


def no_sites(ctx: moderngl.Context) -> SurfaceSites:
    """Return sites for any scene among which every lookup finds no value, so that no light is added.

    The only triangle stands for all.
    """
    none, cells = np.zeros((0, 3)), np.array([[[-1.0, -1.0, -1.0, 0.0]] * 2])
    sites, grading, triangles = Sites(none, none, none), Grading(none, none[:, 0]), np.array([[1.0, 0.0]])
    return SurfaceSites(ctx, SiteLayout(sites, none[:, 0], none[:, 0], grading, triangles, cells))
