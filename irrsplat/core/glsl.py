"""GLSL made from Python: constants and tables that both sides need stand in Python alone, and shaders include them by name."""

from __future__ import annotations

import math

from irrsplat.core import material_layout, record_layout, vertex_layout
from irrsplat.core.buffers import FILMIC, LIGHT_ROWS, LUMINAIRE_ROWS, NOTHING_SEEN, LightRow
from irrsplat.core.color import DARKEST, LUMINANCE, MID_GREY, SRGB
from irrsplat.core.material_layout import MATERIAL_ROWS, MaterialRow

TABLE_COLUMNS = 1024  # items in a row of every table that shaders look things up in by number; a power of two
NEIGHBOUR_STRIDE = 4096  # a texel's neighbour is packed into one float as row·NEIGHBOUR_STRIDE + column (gather/plane.py)
MAX_EMITTER_CLUSTERS = 32  # of emissive triangles, among which light samples are shared out
EYES_BESIDE = 6  # in a circle about a record, from which light samples are looked at as well
WORTH = 4.0  # rays that a light sample is worth: near an emitter's rim a ray hits or misses, a light sample sees it for certain
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0  # of the golden section, whose multiples fill 0..1 evenly
PLASTIC = 0.7548776662466927  # the inverse of the plastic number, whose multiples and those of GOLDEN fill a square evenly
GOLDEN_ANGLE = 2.39996323  # radians, by which each point of a spiral is turned from the one before
SHORT = 1e-4  # of the way, by which a shadow ray ends before the emitter
ROUNDING = 2.0**-20  # of the depth of a light's shadow maps: how far off its surface a place in float32 may lie
SKY_RAY_TEXELS = 3.0  # a ray looks at texels of this share of its solid angle: once interpolated, they are as wide as it is
TOLD = 1e-13  # Σ k of a pixel, below which no record contributes but one from within a closed mesh
BRIGHT = 32.0  # times the luminance floor: an error at what is brighter counts less than in proportion to the luminance
FALSE_COLOURS = 64  # of the scale that light is shown by in the viewer

CONSTANTS: dict[str, int | float | tuple[float, ...]] = {
    "PI": math.pi,
    "INV_PI": 1.0 / math.pi,
    "LUMINANCE": tuple(float(str(weight)) for weight in LUMINANCE),
    "MID_GREY": MID_GREY,
    "DARKEST": DARKEST,
    "TABLE_COLUMNS": TABLE_COLUMNS,
    "TABLE_SHIFT": TABLE_COLUMNS.bit_length() - 1,
    "NEIGHBOUR_STRIDE": NEIGHBOUR_STRIDE,
    "MAX_EMITTER_CLUSTERS": MAX_EMITTER_CLUSTERS,
    "EYES_BESIDE": EYES_BESIDE,
    "WORTH": WORTH,
    "GOLDEN": GOLDEN,
    "PLASTIC": PLASTIC,
    "GOLDEN_ANGLE": GOLDEN_ANGLE,
    "SHORT": SHORT,
    "ROUNDING": ROUNDING,
    "TOLD": TOLD,
    "BRIGHT": BRIGHT,
    "FALSE_COLOURS": FALSE_COLOURS,
    "SKY_RAY_TEXELS": SKY_RAY_TEXELS,
    "NOTHING_SEEN": NOTHING_SEEN,
    "LIGHT_ROWS": LIGHT_ROWS,
    "LUMINAIRE_ROWS": LUMINAIRE_ROWS,
    **{f"LIGHT_{row.name}": row.value for row in LightRow},
    "MATERIAL_ROWS": MATERIAL_ROWS,
    **{f"MATERIAL_{row.name}": row.value for row in MaterialRow},
    **{f"FILMIC_{name.upper()}": value for name, value in FILMIC._asdict().items()},
    **{f"SRGB_{name.upper()}": value for name, value in SRGB._asdict().items()},
}


def _constants() -> str:
    lines = ["// Constants that shaders share with Python, made from irrsplat/core/glsl.py."]
    for name, value in CONSTANTS.items():
        if isinstance(value, tuple):
            kind, text = f"vec{len(value)}", f"vec{len(value)}({', '.join(map(repr, value))})"
        else:
            kind, text = ("int" if isinstance(value, int) else "float"), repr(value)
        lines.append(f"const {kind} {name} = {text};")
    return "\n".join(lines) + "\n"


INCLUDES: dict[str, str] = {
    "generated/constants.glsl": _constants(),
    "generated/record_columns.glsl": record_layout.glsl_columns(),
    "generated/record_outputs.glsl": record_layout.glsl_outputs(),
    **vertex_layout.INCLUDES,
    **material_layout.INCLUDES,
}
