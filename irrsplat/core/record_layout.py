"""The layout of a record: the table of its columns, and their places in the cache's textures.

`COLUMNS` defines the cache's textures, the GLSL that reads them (generated/record_columns.glsl), the GLSL with which a gather
writes them (generated/record_outputs.glsl), and the numpy arrays.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

_CHANNELS = "xyzw"


@dataclass(frozen=True)
class Column:
    """One value of every record.

    kind: GLSL type. places: "texture.channels", one per column of a mat3, one in all or one per component of a vector. source:
    its writer: the record's site, its gather, or the adaptation of radii.
    """

    name: str
    kind: Literal["float", "vec2", "vec3", "vec4", "mat3"]
    places: tuple[str, ...]
    unit: str
    source: Literal["site", "gather", "adaptation"]
    meaning: str

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of a record's value in numpy: (), (2,), (3,), (4,); a mat3 is (3, 3), its GLSL columns first."""
        return {"float": (), "vec2": (2,), "vec3": (3,), "vec4": (4,), "mat3": (3, 3)}[self.kind]

    @property
    def slots(self) -> list[tuple[str, list[int]]]:
        """Places as (texture, channel numbers)."""
        split = (place.split(".") for place in self.places)
        return [(texture, [_CHANNELS.index(c) for c in channels]) for texture, channels in split]


COLUMNS: dict[str, Column] = {
    c.name: c
    for c in (
        Column("position", "vec3", ("position.xyz",), "m", "site", "p_k, world space"),
        Column("normal", "vec3", ("normal.xyz",), "1", "site", "n_k, unit shading normal, world space"),
        Column("irradiance", "vec3", ("irradiance.xyz",), "W/m²", "gather", "E at p_k of red, green and blue"),
        Column("radius", "float", ("irradiance.w",), "m", "gather", "R_k, the harmonic mean distance"),
        Column(
            "vectors",
            "mat3",
            ("vector_r.xyz", "vector_g.xyz", "vector_b.xyz"),
            "W/m²",
            "gather",
            "irradiance vectors M = ∫ L·ω·dω of red, green and blue: E is nearly n·M for a normal n near n_k",
        ),
        Column(
            "gradient",
            "mat3",
            ("gradient_r.xyz", "gradient_g.xyz", "gradient_b.xyz"),
            "W/m³",
            "gather",
            "translation gradients ∇E of red, green and blue",
        ),
        Column(
            "axis",
            "vec3",
            ("vector_r.w", "vector_g.w", "vector_b.w"),
            "1",
            "gather",
            "unit vector in the tangent plane along which the second derivative of light is least; 0: unknown",
        ),
        Column(
            "curvature",
            "vec2",
            ("gradient_r.w", "gradient_g.w"),
            "1/m²",
            "gather",
            "second derivatives of luminance along the axis and across it, divided by the luminance",
        ),
        Column(
            "max_radius",
            "float",
            ("gradient_b.w",),
            "m",
            "gather",
            "upper bound of the radius by the curvature, at most settings.WIDE·R_k; 0 for a record in the dark within a closed "
            "mesh, which covers no pixel but its own",
        ),
        Column(
            "noise",
            "float",
            ("noise.x",),
            "1",
            "gather",
            "standard error of the luminance of E by the number of rays, divided by the luminance, at most 1; 0: unknown",
        ),
        Column(
            "limit",
            "float",
            ("limit.x",),
            "1",
            "adaptation",
            "greatest share of its radii that a record covers; below 0: minus its greatest radius in metres, at a small feature",
        ),
    )
}


def _textures(sources: Iterable[str]) -> dict[str, int]:
    """Return the textures of the columns from these sources, in order of first use, and their numbers of channels."""
    channels: dict[str, int] = {}
    for column in COLUMNS.values():
        if column.source in sources:
            for texture, numbers in column.slots:
                channels[texture] = max(channels.get(texture, 0), 1 + max(numbers))
    return {texture: 1 if count == 1 else 4 for texture, count in channels.items()}


TEXTURES = _textures(("site", "gather", "adaptation"))  # name: number of channels, 4 or 1
GATHERED = tuple(_textures(("gather",)))  # written by a gather; the same order in files


def unpack(texels: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """Return (N, …) values of the column `name` from texels (N, channels) of its textures."""
    column = COLUMNS[name]
    parts = [texels[texture][:, channels] for texture, channels in column.slots]
    return (np.stack(parts, axis=1) if column.kind == "mat3" else np.concatenate(parts, axis=1)).reshape(-1, *column.shape)


def pack(texels: Mapping[str, np.ndarray], name: str, values: np.ndarray) -> None:
    """Write the column `name` into the textures' texels (N, channels), the inverse of `unpack`; values broadcast to (N, …)."""
    column = COLUMNS[name]
    for number, (texture, channels) in enumerate(column.slots):
        rows = texels[texture]
        whole = np.broadcast_to(values, (len(rows), *column.shape)).reshape(len(rows), math.prod(column.shape))
        first = len(channels) * number
        rows[:, channels] = whole[:, first : first + len(channels)]


# ---- GLSL -----------------------------------------------------------------------------------------------------------


def glsl_columns() -> str:
    """Return samplers `records_TEXTURE`, and for each column a function `record_COLUMN(texel)` that reads it."""
    lines = ["// The columns of a record, made from irrsplat/core/record_layout.py."]
    lines += ['#include "lib/texel.glsl"', *(f"uniform sampler2D records_{texture};" for texture in TEXTURES)]
    for column in COLUMNS.values():
        fetched = [f"texel_at(records_{place.replace('.', ', texel).', 1)}" for place in column.places]
        value = fetched[0] if len(fetched) == 1 else f"{column.kind}({', '.join(fetched)})"
        lines += ["", f"// {column.meaning} [{column.unit}]"]
        lines += [f"{column.kind} record_{column.name}(ivec2 texel)", "{", f"    return {value};", "}"]
    return "\n".join(lines) + "\n"


def glsl_outputs() -> str:
    """Return an output for each texture that a gather writes, and a function `write_record` that packs the columns into them."""
    gathered = [column for column in COLUMNS.values() if column.source == "gather"]
    lines = ["// The columns of a record that a gather writes, made from irrsplat/core/record_layout.py."]
    lines += [f"layout(location = {i}) out vec4 out_{texture};" for i, texture in enumerate(GATHERED)]
    lines += ["", f"void write_record({', '.join(f'{c.kind} {c.name}' for c in gathered)})", "{"]
    for texture in GATHERED:
        parts = [
            (channels[0], f"{column.name}{_component(column, number)}")
            for column in gathered
            for number, (held_by, channels) in enumerate(column.slots)
            if held_by == texture
        ]
        lines.append(f"    out_{texture} = vec4({', '.join(part for _, part in sorted(parts))});")
    return "\n".join([*lines, "}"]) + "\n"


def _component(column: Column, number: int) -> str:
    """Return the GLSL suffix for the part of a column at place `number`."""
    if len(column.places) == 1:
        return ""
    return f"[{number}]" if column.kind == "mat3" else f".{_CHANNELS[number]}"
