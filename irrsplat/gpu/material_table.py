"""The materials of a scene on the GPU, as shaders look them up by number."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.core.material_layout import MATERIAL_ROWS, MaterialRow
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import table_texture
from irrsplat.scene.model import Material


class MaterialTable(Owner):
    """The table that shaders/lib/material_table.glsl reads: a column for each of the `materials`, by their numbers."""

    def __init__(self, ctx: moderngl.Context, materials: Mapping[Material, int]) -> None:
        lines = -(-max(len(materials), 1) // TABLE_COLUMNS)
        rows = np.zeros((lines, TABLE_COLUMNS, MATERIAL_ROWS, 4), "f4")
        for material, i in materials.items():
            row = rows[i // TABLE_COLUMNS, i % TABLE_COLUMNS]
            row[MaterialRow.EMISSION] = (*material.emission, material.light_cutoff)
        self.texture = table_texture(ctx, rows.swapaxes(1, 2).reshape(-1, TABLE_COLUMNS, 4))

    @property
    def uniforms(self) -> Uniforms:
        """The uniforms of shaders/lib/material_table.glsl."""
        return {"material_table": self.texture}

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.texture,)
