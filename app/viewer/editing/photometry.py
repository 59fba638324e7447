"""Lights in the units of lighting design; which ones follows the kind of light."""

from __future__ import annotations

import math

import numpy as np

from irrsplat.core.color import LUMINOUS_EFFICACY, photometric
from irrsplat.core.vectors import triangle_areas
from irrsplat.scene.model import Light, Mesh

WORDS = {  # of each unit: the quantity, and its radiometric unit
    "lumen": ("luminous flux", "W"),
    "candela": ("luminous intensity; of a spot on its axis, of a luminaire the greatest", "W/sr"),
    "lux": ("illuminance of a surface that faces the light", "W/m²"),
    "lux at 1 m": ("illuminance at 1 m, as the light falls off by OpenGL's attenuation", "W/m²"),
    "cd/m²": ("emitted luminance", "W/(m² sr)"),
    "lumen per side": ("luminous flux from each side of the surface", "W"),
}


def light_units(light: Light) -> dict[str, float]:
    """Return the output of a light in the units of its kind."""
    shine = float(photometric(np.asarray(light.color, float)))
    if light.photometry is not None:
        return dict(zip(("lumen", "candela"), light.output, strict=True))
    if light.directional:
        return {"lux": math.pi * shine}
    constant, linear, quadratic = light.attenuation
    if not light.physical and (constant or linear):
        return {"lux at 1 m": math.pi * shine / (constant + linear + quadratic)}
    candela = shine if light.physical else math.pi * shine / quadratic
    return {"candela": candela} if light.has_cone else {"lumen": 4.0 * math.pi * candela, "candela": candela}


def surface_units(mesh: Mesh, emission: tuple[float, float, float]) -> dict[str, float]:
    """Return the output of a surface with emitted radiance `emission` in W/(m² sr)."""
    luminance = float(photometric(np.asarray(emission, float)))
    area = float(triangle_areas(mesh.positions[mesh.faces].astype(float)).sum())
    return {"cd/m²": luminance, "lumen per side": math.pi * area * luminance}


def described(unit: str, value: float) -> str:
    """Return the quantity of a value in words, and the value in its radiometric unit."""
    quantity, other = WORDS[unit]
    return f"{quantity}; {value / LUMINOUS_EFFICACY:.4g} {other}"
