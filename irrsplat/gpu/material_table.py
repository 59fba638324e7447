"""The materials of a scene on the GPU, by number."""

from __future__ import annotations

from functools import cached_property

import moderngl
import numpy as np

from irrsplat.core.buffers import MATERIAL_ROWS, MaterialRow, Uniforms
from irrsplat.core.errors import InputError
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import table_texture
from irrsplat.gpu.texture_layers import LayerKey, LayerPlan, TextureLayers, dithered, layer_keys, plan
from irrsplat.scene.model import Scene, Texture
from irrsplat.scene.seen_by_light import face_counts

_MOST_LAYER_BYTES = 64 << 20  # of all layers, approximately
_WRAPS = ("repeat", "mirror", "clamp")  # by their numbers in the table


class MaterialTable(Owner):
    """The table of shaders/lib/material_table.glsl: one column per material, by its number.

    It also owns the layers of the materials' textures, made at first use.
    """

    def __init__(self, ctx: moderngl.Context, scene: Scene) -> None:
        self.ctx, self._cut_out = ctx, face_counts(scene).cut_out > 0
        self.plan = plan(_by_area(scene), _MOST_LAYER_BYTES, int(ctx.info["GL_MAX_ARRAY_TEXTURE_LAYERS"]))
        self.texture = table_texture(ctx, self._rows(scene))

    def _rows(self, scene: Scene) -> np.ndarray:
        """Return the texels of the table. Raises InputError for a texture that the scene was not loaded with."""
        lines = -(-max(len(scene.materials), 1) // TABLE_COLUMNS)
        rows = np.zeros((lines, TABLE_COLUMNS, MATERIAL_ROWS, 4), "f4")
        for material, i in scene.materials.items():
            row = rows[i // TABLE_COLUMNS, i % TABLE_COLUMNS]
            row[MaterialRow.EMISSION] = (*material.emission, material.light_cutoff)
            albedo, emission = layer_keys(material)
            if any(key is not None and key not in self.plan.layers and key not in self.plan.means for key in (albedo, emission)):
                raise InputError("a mesh cannot get another texture or another opacity of one; load the scene anew with it")
            row[MaterialRow.ALBEDO_TEXTURE :][:3] = _texture_rows(material.albedo_texture, albedo, self.plan)
            row[MaterialRow.EMISSION_TEXTURE :][:3] = _texture_rows(material.emission_texture, emission, self.plan)
        return rows.swapaxes(1, 2).reshape(-1, TABLE_COLUMNS, 4)

    def update(self, scene: Scene) -> None:
        """Store the repainted materials of the same scene, with the same textures; raises InputError, unchanged, for other
        textures."""
        rows = self._rows(scene)
        if self.texture.height == len(rows):
            self.texture.write(rows.astype("f4").tobytes())
        else:
            before, self.texture = self.texture, table_texture(self.ctx, rows)
            before.release()

    @property
    def defines(self) -> dict[str, int]:
        """Defines of shaders/lib/material_table.glsl in light passes: textures, and cut-outs. Absent features cost nothing."""
        return {"TEXTURES": int(bool(self.plan.layers)), "CUT_OUTS": int(self._cut_out)}

    @property
    def notices(self) -> tuple[str, ...]:
        """One-line notices for a user."""
        lost, kept = len(self.plan.means), len(self.plan.layers)
        return (
            (f"images that are a mere mean colour to light: {lost}; beside {kept} others this OpenGL takes no more",)
            if lost
            else ()
        )

    @property
    def uniforms(self) -> Uniforms:
        """Uniforms of shaders/lib/material_table.glsl without textures."""
        return {"material_table": self.texture}

    @property
    def light_uniforms(self) -> Uniforms:
        """Uniforms of shaders/lib/material_table.glsl compiled with `defines`."""
        return self.uniforms | ({"texture_layers": self._layers.texture} if self.plan.layers else {})

    @cached_property
    def _layers(self) -> TextureLayers:
        return TextureLayers(self.ctx, self.plan)

    def owned(self) -> tuple[Resource | None, ...]:
        return (self.texture, self.__dict__.get("_layers"))


def _by_area(scene: Scene) -> list[LayerKey]:
    """Return the layers of all materials, sorted by covered area, largest first."""
    covered: dict[LayerKey, float] = {}
    for mesh in scene.meshes:
        keys = [key for key in layer_keys(mesh.material) if key is not None]
        for key in keys:
            covered[key] = covered.get(key, 0.0) + mesh.area
    return sorted(covered, key=lambda key: -covered[key])


def _texture_rows(texture: Texture | None, key: LayerKey | None, plan: LayerPlan) -> np.ndarray:
    """Return the (3, 4) rows of a texture, see MaterialRow.ALBEDO_TEXTURE."""
    if texture is None or key is None:
        return np.array([[0.0, 0.0, 0.0, -1.0], [0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 1.0, 1.0]])
    u, v = (_WRAPS.index(wrap) for wrap in texture.wrap)
    across, down = texture.transform[:3], texture.transform[3:]
    about = plan.means.get(key, (key.cutoff, float(dithered(key, plan.side)), 0.0, 0.0))
    return np.array([[*across, plan.layers.get(key, -1)], [*down, u + 3 * v + 9 * texture.uv_set], about])
