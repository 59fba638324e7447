"""The layout of a vertex: the table of its columns.

`COLUMNS` defines the rows of `flatten`, the attributes of the vertex buffer, the vertex table for lookup by number, and their
GLSL (`INCLUDES`). A vertex has the material values of its mesh that vary; the table of materials has the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np

_KINDS = {1: "float", 2: "vec2", 3: "vec3", 4: "vec4"}
_CHANNELS = "xyzw"


@dataclass(frozen=True)
class VertexColumn:
    """One value of every vertex, interpolated over triangles; flat: equal at all three corners."""

    name: str
    components: int
    unit: str
    meaning: str
    flat: bool = False

    @property
    def kind(self) -> str:
        """GLSL type."""
        return _KINDS[self.components]


COLUMNS = (
    VertexColumn("position", 3, "m", "world space"),
    VertexColumn("material", 1, "1", "number of the material in the table of materials", flat=True),
    VertexColumn("normal", 3, "1", "shading normal, world space, of any length and on either side"),
    VertexColumn("opacity", 1, "1", "factor on the alpha of the albedo's texture"),
    VertexColumn("albedo", 3, "1", "diffuse reflectance, linear, before its texture; -1 - f: none, and a factor f on emission"),
    VertexColumn("uv", 4, "1", "two sets of texture coordinates"),
)
WIDTH = sum(column.components for column in COLUMNS)  # numbers in a vertex's row
TEXELS = -(-WIDTH // 4)  # of a vertex in a table of vertices

_FIRST = dict(zip((c.name for c in COLUMNS), np.cumsum([0, *(c.components for c in COLUMNS)]).tolist(), strict=False))
PARTS = {c.name: slice(_FIRST[c.name], _FIRST[c.name] + c.components) for c in COLUMNS}  # of a row, by the column's name


def vertex_column(rows: np.ndarray, name: str) -> np.ndarray:
    """Return a view of the column `name`, (V, components), of the vertices' rows (V, WIDTH)."""
    return rows[:, PARTS[name]]


# ---- the vertex buffer, as moderngl describes it -------------------------------------------------------------------------

FORMAT = " ".join(f"{column.components}f" for column in COLUMNS)
ATTRIBUTES = tuple(f"in_{column.name}" for column in COLUMNS)


# ---- GLSL ----------------------------------------------------------------------------------------------------------------

_MADE = "made from irrsplat/core/vertex_layout.py."


def _each(form: str, columns: tuple[VertexColumn, ...] = COLUMNS[1:], between: str = "\n") -> str:
    """Return `form` for each column c, by default for all but the position, which each shader handles itself."""
    return between.join(form.format(c=c, flat="flat " * c.flat) for c in columns)


def _in_texels(column: VertexColumn) -> str:
    """Return a GLSL expression that reads the column from a vertex's texels t0, t1, …."""
    numbers = range(PARTS[column.name].start, PARTS[column.name].stop)
    parts = [f"t{t}." + "".join(_CHANNELS[i % 4] for i in run) for t, run in groupby(numbers, lambda i: i // 4)]
    return parts[0] if len(parts) == 1 else f"{column.kind}({', '.join(parts)})"


_BLEND = "\n        weights.x * a.{c.name} + weights.y * b.{c.name} + weights.z * c.{c.name}"

INCLUDES = {
    "generated/vertex.glsl": f"""// A vertex, or a point of a triangle, {_MADE}
struct Vertex
{{
{_each("    {c.kind} {c.name};  // {c.meaning} [{c.unit}]", COLUMNS)}
}};
""",
    # of vertex shaders: the attributes except the position, and their outputs for the fragment shader
    "generated/attributes.glsl": f"""// The attributes of a vertex that are interpolated, {_MADE}
{_each("in {c.kind} in_{c.name};")}
{_each("{flat}out {c.kind} v_{c.name};")}

void pass_attributes()
{{
{_each("    v_{c.name} = in_{c.name};")}
}}
""",
    # of fragment shaders: the outputs of `pass_attributes`
    "generated/interpolated.glsl": f"""// The interpolated attributes of a vertex, {_MADE}
#include "generated/vertex.glsl"
{_each("{flat}in {c.kind} v_{c.name};")}

Vertex interpolated_vertex(vec3 position)
{{
    return Vertex(position, {_each("v_{c.name}", between=", ")});
}}
""",
    "generated/vertex_table.glsl": f"""// The table of vertices, {_MADE}
#include "generated/vertex.glsl"
#include "lib/table.glsl"
uniform sampler2D vertex_table;  // {TEXELS} texels per vertex, in rows of TABLE_COLUMNS vertices

// Return vertex i.
Vertex vertex_at(int i)
{{
    ivec2 at = table_texel(i, {TEXELS}, 0);
    vec4 {", ".join(f"t{t} = texel_at(vertex_table, at + ivec2({t}, 0))" for t in range(TEXELS))};
    return Vertex({", ".join(map(_in_texels, COLUMNS))});
}}

// Return the point of the triangle a, b, c with the barycentric coordinates `weights`.
Vertex interpolate(vec3 weights, Vertex a, Vertex b, Vertex c)
{{
    return Vertex({", ".join("a." + c.name if c.flat else _BLEND.format(c=c) for c in COLUMNS)});
}}
""",
}
