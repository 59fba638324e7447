"""The layout of a vertex: one table of its columns, among them the properties of its material.

From `COLUMNS` are made: the rows that scene.flatten writes, the attributes of the vertex buffer, the table in which shaders look
vertices up by number, and the GLSL that reads both of these and the material in the g-buffer (the includes in `INCLUDES`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby

import numpy as np

_KINDS = {1: "float", 2: "vec2", 3: "vec3", 4: "vec4"}
_CHANNELS = "xyzw"


@dataclass(frozen=True)
class VertexColumn:
    """One value of every vertex, interpolated over triangles. material: it is the field of scene.Material with this name."""

    name: str
    components: int
    unit: str
    meaning: str
    material: bool = False

    @property
    def kind(self) -> str:
        """Its GLSL type."""
        return _KINDS[self.components]


COLUMNS = (
    VertexColumn("position", 3, "m", "world space"),
    VertexColumn("normal", 3, "1", "shading normal, world space, of any length and on either side"),
    VertexColumn("albedo", 3, "1", "diffuse reflectance, linear", material=True),
    VertexColumn("emission", 3, "W/(m² sr)", "emitted radiance", material=True),
)
MATERIAL = tuple(column for column in COLUMNS if column.material)
WIDTH = sum(column.components for column in COLUMNS)  # numbers in a vertex's row
TEXELS = -(-WIDTH // 4)  # of a vertex in a table of vertices

_FIRST = dict(zip((c.name for c in COLUMNS), np.cumsum([0, *(c.components for c in COLUMNS)]).tolist(), strict=False))
PARTS = {c.name: slice(_FIRST[c.name], _FIRST[c.name] + c.components) for c in COLUMNS}  # of a row, by the column's name


def vertex_column(rows: np.ndarray, name: str) -> np.ndarray:
    """(V, components) the column of this name in the vertices' rows (V, WIDTH): a view of them."""
    return rows[:, PARTS[name]]


def vertex_texels(rows: np.ndarray) -> np.ndarray:
    """(V, TEXELS, 4) the vertices' rows (V, WIDTH), padded with zeros, as the texels that generated/vertex_table.glsl reads."""
    return np.pad(rows, ((0, 0), (0, 4 * TEXELS - WIDTH))).reshape(-1, TEXELS, 4)


# ---- the vertex buffer, as moderngl describes it -------------------------------------------------------------------------

FORMAT = " ".join(f"{column.components}f" for column in COLUMNS)
ATTRIBUTES = tuple(f"in_{column.name}" for column in COLUMNS)


# ---- GLSL ----------------------------------------------------------------------------------------------------------------

_MADE = "made from irrsplat/core/vertex_layout.py."
_PASSED = tuple(column for column in COLUMNS if column.name != "position")  # what each shader does with the position is its own


def glsl_material() -> str:
    """`struct Material`: a field for each property."""
    return _text(f"// The material of a surface, {_MADE}", "struct Material", "{", *map(_field, MATERIAL), "};")


def glsl_attributes() -> str:
    """For vertex shaders: the attributes but the position, and `pass_attributes()`, which hands them to the fragment shader."""
    return _text(
        f"// The attributes of a vertex that are interpolated, {_MADE}",
        *(f"in {c.kind} in_{c.name};" for c in _PASSED),
        *(f"out {c.kind} v_{c.name};" for c in _PASSED),
        "",
        "void pass_attributes()",
        "{",
        *(f"    v_{c.name} = in_{c.name};" for c in _PASSED),
        "}",
    )


def glsl_interpolated() -> str:
    """For fragment shaders: what `pass_attributes()` handed on, and `interpolated_material()`."""
    return _text(
        f"// The interpolated attributes of a vertex, {_MADE}",
        '#include "generated/material.glsl"',
        *(f"in {c.kind} v_{c.name};" for c in _PASSED),
        "",
        *_function("Material interpolated_material()", f"Material({', '.join(f'v_{c.name}' for c in MATERIAL)})"),
    )


def glsl_vertex_table() -> str:
    """`struct Vertex`, its lookup by number `vertex_at(i)`, and `interpolate(share, a, b, c)` over a triangle."""
    plain = [c for c in COLUMNS if not c.material]
    blended = [f"\n        share.x * a.{name} + share.y * b.{name} + share.z * c.{name}" for name in _members()]
    return _text(
        f"// The table of vertices, {_MADE}",
        '#include "generated/material.glsl"',
        '#include "lib/table.glsl"',
        f"uniform sampler2D vertex_table;  // {TEXELS} texels a vertex, in rows of TABLE_COLUMNS vertices",
        "",
        "struct Vertex",
        "{",
        *(_field(c) for c in plain),
        "    Material material;",
        "};",
        "",
        "Vertex vertex_at(int i)",
        "{",
        f"    ivec2 at = table_texel(i, {TEXELS}, 0);",
        *(f"    vec4 t{t} = texelFetch(vertex_table, at + ivec2({t}, 0), 0);" for t in range(TEXELS)),
        f"    return {_vertex(_in_texels(c) for c in COLUMNS)};",
        "}",
        "",
        "// The vertices' values with these weights, which sum to 1.",
        *_function("Vertex interpolate(vec3 share, Vertex a, Vertex b, Vertex c)", _vertex(blended)),
    )


def glsl_gbuffer_material() -> str:
    """The g-buffer's textures of material, and `material_at(pixel)`."""
    fetched = (f"texelFetch({c.name}, pixel, 0).{_CHANNELS[: c.components]}" for c in MATERIAL)
    return _text(
        f"// The material that a pixel sees, {_MADE}",
        '#include "generated/material.glsl"',
        *(f"uniform sampler2D {c.name};  // g-buffer" for c in MATERIAL),
        "",
        *_function("Material material_at(ivec2 pixel)", f"Material({', '.join(fetched)})"),
    )


def _field(column: VertexColumn) -> str:
    """The column as the field of a struct."""
    return f"    {column.kind} {column.name};  // {column.meaning} [{column.unit}]"


def _members() -> list[str]:
    """How GLSL names each column of a Vertex."""
    return [f"material.{c.name}" if c.material else c.name for c in COLUMNS]


def _vertex(values: Iterable[str]) -> str:
    """A constructor of Vertex from a GLSL expression for each column."""
    given = list(zip(COLUMNS, values, strict=True))
    plain = [value for column, value in given if not column.material]
    material = [value for column, value in given if column.material]
    return f"Vertex({', '.join(plain)}, Material({', '.join(material)}))"


def _in_texels(column: VertexColumn) -> str:
    """A GLSL expression that reads the column from the texels t0, t1, … of a vertex."""
    numbers = range(PARTS[column.name].start, PARTS[column.name].stop)
    parts = [f"t{t}." + "".join(_CHANNELS[i % 4] for i in run) for t, run in groupby(numbers, lambda i: i // 4)]
    return parts[0] if len(parts) == 1 else f"{column.kind}({', '.join(parts)})"


def _function(head: str, value: str) -> list[str]:
    return [head, "{", f"    return {value};", "}"]


def _text(*lines: str) -> str:
    return "\n".join(lines) + "\n"


INCLUDES = {
    "generated/material.glsl": glsl_material(),
    "generated/attributes.glsl": glsl_attributes(),
    "generated/interpolated.glsl": glsl_interpolated(),
    "generated/vertex_table.glsl": glsl_vertex_table(),
    "generated/gbuffer_material.glsl": glsl_gbuffer_material(),
}
