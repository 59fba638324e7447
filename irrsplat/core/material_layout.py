"""What is known of a surface's material: the properties at a point of it, and the rows of a material in the table of materials.

A property at a point is computed from the table of materials, its textures and the vertices (shaders/lib/material_table.glsl);
the g-buffer keeps it for every pixel in a texture of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

_CHANNELS = "xyz"


@dataclass(frozen=True)
class Property:
    """A property of the material at a point of a surface: a field of GLSL's `struct Material`, and a texture of the g-buffer."""

    name: str
    components: int
    unit: str
    meaning: str

    @property
    def kind(self) -> str:
        """Its GLSL type."""
        return "float" if self.components == 1 else f"vec{self.components}"


PROPERTIES = (
    Property("albedo", 3, "1", "diffuse reflectance, linear"),
    Property("emission", 3, "W/(m² sr)", "emitted radiance"),
)


class MaterialRow(IntEnum):
    """What the rows of a material in the table of materials hold: shaders read them as MATERIAL_EMISSION and so on."""

    EMISSION = 0  # rgb emitted radiance before its texture; w: the opacity from which on light sees the surface (light_cutoff)
    # Of a texture three rows. The first two: xyz dotted with (u, v, 1) are the image's coordinates; w: its layer among those that
    # light looks at (-1: none), and WRAPS.index along u, + 3 times that along v, + 9 for the second set of u and v. The third:
    # without a layer what stands for the texture, its mean (1 without a texture), colours times alpha and alpha; with a layer of
    # cut-outs the alpha from which on light sees the material by its own opacity, and 1 if the layer is dithered.
    ALBEDO_TEXTURE = 1
    EMISSION_TEXTURE = 4


MATERIAL_ROWS = MaterialRow.EMISSION_TEXTURE + 3
WRAPS = ("repeat", "mirror", "clamp")


# ---- GLSL ----------------------------------------------------------------------------------------------------------------

_MADE = "made from irrsplat/core/material_layout.py."


def glsl_material() -> str:
    """`struct Material`: a field for each property."""
    fields = (f"    {p.kind} {p.name};  // {p.meaning} [{p.unit}]" for p in PROPERTIES)
    return "\n".join([f"// The material at a point of a surface, {_MADE}", "struct Material", "{", *fields, "};"]) + "\n"


def glsl_gbuffer_material() -> str:
    """The g-buffer's textures of material, and `material_at(pixel)`."""
    fetched = (f"texel_at({p.name}, pixel).{_CHANNELS[: p.components]}" for p in PROPERTIES)
    lines = [
        f"// The material that a pixel sees, {_MADE}",
        '#include "generated/material.glsl"',
        '#include "lib/texel.glsl"',
        *(f"uniform sampler2D {p.name};  // g-buffer" for p in PROPERTIES),
        "",
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
