"""GLSL generated from Python: constants and tables of both sides are defined in Python alone, and included by name."""

from __future__ import annotations

import math

from irrsplat.core import record_layout, vertex_layout
from irrsplat.core.buffers import FILMIC, LIGHT_ROWS, LUMINAIRE_ROWS, MATERIAL_ROWS, NOTHING_SEEN, LightRow, MaterialRow
from irrsplat.core.color import DARKEST, LUMINANCE, MID_GREY, SRGB

TABLE_COLUMNS = 1024  # items in a row of every table with lookup by number; a power of two
NEIGHBOUR_STRIDE = 4096  # a texel's neighbour is packed into one float as row·NEIGHBOUR_STRIDE + column (gather/plane.py)
TWELVE_BITS = 4095.0  # greatest number of 12 bits, two of which share one float (shaders/gather/close_hits.glsl)
MAX_EMITTER_CLUSTERS = 32  # clusters of emissive triangles, between which next-event estimation divides its samples
EYES_BESIDE = 6  # eyes on a circle about a record, for derivatives of next-event estimation
WORTH = 4.0  # rays per next-event sample of equal value: near an emitter's rim a ray may miss, the sample always hits
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0  # golden section, whose multiples fill 0..1 evenly
PLASTIC = 0.7548776662466927  # inverse of the plastic number; its multiples and those of GOLDEN fill a square evenly
SQUARE_STEPS = PLASTIC, PLASTIC**2  # whose multiples fill a square evenly (Roberts 2018)
SHORT = 1e-4  # of the distance: margin of a shadow ray before the emitter
ROUNDING = 2.0**-20  # of the depth of a light's shadow maps: largest distance of a float32 position from its surface
CASCADE_RATIO = 4.0  # width of the texels of a directional light's tile, in those of the next tile around the eye
SKY_RAY_TEXELS = 3.0  # sky texels per ray's solid angle: interpolation widens one texel to the whole
COVERED = 1e-13  # Σ k of a pixel below which only records within closed meshes contribute
BRIGHT = 32.0  # times the luminance floor: errors at greater luminances count less than in proportion
FALSE_COLOURS = 64  # entries of the viewer's scale of light

_SHARED = (
    "TABLE_COLUMNS NEIGHBOUR_STRIDE TWELVE_BITS MAX_EMITTER_CLUSTERS EYES_BESIDE WORTH GOLDEN PLASTIC SHORT ROUNDING "
    "CASCADE_RATIO SKY_RAY_TEXELS COVERED BRIGHT FALSE_COLOURS"
)

CONSTANTS: dict[str, int | float | tuple[float, ...]] = {
    "PI": math.pi,
    "INV_PI": 1.0 / math.pi,
    "LUMINANCE": tuple(float(str(weight)) for weight in LUMINANCE),
    "MID_GREY": MID_GREY,
    "DARKEST": DARKEST,
    **{name: globals()[name] for name in _SHARED.split()},
    "TABLE_SHIFT": TABLE_COLUMNS.bit_length() - 1,
    "GOLDEN_ANGLE": 2.39996323,  # radians between successive points of a spiral
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
}
