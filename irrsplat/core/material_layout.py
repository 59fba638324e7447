"""The layout of materials: properties at a surface point, and rows of the material table.

A property is computed from the material table, its textures and the vertices (shaders/lib/material_table.glsl); the g-buffer
stores it per pixel in a texture.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

_CHANNELS = "xyz"


@dataclass(frozen=True)
class Property:
    """A property of the material at a surface point: a field of GLSL's `struct Material`, and a texture of the g-buffer."""

    name: str
    components: int
    unit: str
    meaning: str

    @property
    def kind(self) -> str:
        """GLSL type."""
        return "float" if self.components == 1 else f"vec{self.components}"


PROPERTIES = (
    Property("albedo", 3, "1", "diffuse reflectance, linear"),
    Property("emission", 3, "W/(m² sr)", "emitted radiance"),
)


class MaterialRow(IntEnum):
    """Rows of a material in the material table, in shaders as MATERIAL_EMISSION and so on."""

    EMISSION = 0  # rgb emitted radiance before its texture; w: least opacity for light (light_cutoff)
    # Three rows per texture. Rows 1 and 2: xyz dotted with (u, v, 1) gives image coordinates; w: its layer (-1: none), and
    # WRAPS.index along u, + 3 times that along v, + 9 for the second set of u and v. Row 3 without a layer: the texture's mean (1
    # without a texture), colours times alpha, and alpha. Row 3 with a layer of cut-outs: least alpha for light by the material's
    # own opacity, and 1 if the layer is dithered.
    ALBEDO_TEXTURE = 1
    EMISSION_TEXTURE = 4


MATERIAL_ROWS = MaterialRow.EMISSION_TEXTURE + 3
WRAPS = ("repeat", "mirror", "clamp")


# ---- GLSL ----------------------------------------------------------------------------------------------------------------

_MADE = "made from irrsplat/core/material_layout.py."


def glsl_material() -> str:
    """Return `struct Material`: a field for each property."""
    fields = (f"    {p.kind} {p.name};  // {p.meaning} [{p.unit}]" for p in PROPERTIES)
    return "\n".join([f"// The material at a point of a surface, {_MADE}", "struct Material", "{", *fields, "};"]) + "\n"


def glsl_gbuffer_material() -> str:
    """Return the g-buffer's textures of material, and `material_at(pixel)`."""
    fetched = (f"texel_at({p.name}, pixel).{_CHANNELS[: p.components]}" for p in PROPERTIES)
    lines = [
        f"// The material of the surface at a pixel, {_MADE}",
        '#include "generated/material.glsl"',
        '#include "lib/texel.glsl"',
        *(f"uniform sampler2D {p.name};  // g-buffer" for p in PROPERTIES),
        "",
        "// Return the material at a pixel of the g-buffer.",
        "Material material_at(ivec2 pixel)",
        "{",
        f"    return Material({', '.join(fetched)});",
        "}",
    ]
    return "\n".join(lines) + "\n"


INCLUDES = {
    "generated/material.glsl": glsl_material(),
    "generated/gbuffer_material.glsl": glsl_gbuffer_material(),
}
