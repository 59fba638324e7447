"""Changes of lights, and lights in the units of lighting design."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from irrsplat.app.viewer.view_options import Point
from irrsplat.core.color import LUMINANCE, LUMINOUS_EFFICACY, photometric
from irrsplat.core.vectors import triangle_areas
from irrsplat.scene.model import Light, Mesh

COLDEST, HOTTEST = 1700.0, 12_000.0  # kelvin: the range of the slider
_REC_709 = np.array(  # from CIE XYZ, white D65 (IEC 61966-2-1)
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)
# CIE chromaticity of a black body (Kim et al. 2002, "Design of advanced color temperature control system for HDTV applications"):
# polynomials for x in 1000/T, and for y in x
_X_BELOW_4000, _X_ABOVE = (-0.2661239, -0.2343589, 0.8776956, 0.179910), (-3.0258469, 2.1070379, 0.2226347, 0.240390)
_Y_BELOW_2222, _Y_BELOW_4000 = (
    (-1.1063814, -1.34811020, 2.18555832, -0.20219683),
    (-0.9549476, -1.37418593, 2.09137015, -0.16748867),
)
_Y_ABOVE = (3.0817580, -5.87338670, 3.75112997, -0.37001483)


@lru_cache(maxsize=1024)
def blackbody(kelvin: float) -> tuple[float, float, float]:
    """Return the linear Rec. 709 colour of a black body of this temperature, with luminance 1.

    Below about 1900 K the colour is outside of the Rec. 709 gamut. Its negative components then become 0.
    """
    x = float(np.polyval(_X_BELOW_4000 if kelvin <= 4000.0 else _X_ABOVE, 1000.0 / kelvin))
    y = float(np.polyval(_Y_BELOW_2222 if kelvin <= 2222.0 else _Y_BELOW_4000 if kelvin <= 4000.0 else _Y_ABOVE, x))
    color = np.maximum(_REC_709 @ (x / y, 1.0, (1.0 - x - y) / y), 0.0)
    red, green, blue = (color / float(LUMINANCE @ color)).tolist()
    return red, green, blue


def light_name(light: Light, number: int) -> str:
    return light.name or f"light {number + 1}"


@dataclass(frozen=True)
class LightEdit:
    """The edited state of a light: `light` with its full colour, brighter by `stops`, or off.

    loaded: the light of the scene's files, or the light as it was added. on: False if it is off. kelvin: the temperature that
    gives its colour; None for a light with a colour of its own.
    """

    light: Light
    loaded: Light
    stops: float = 0.0
    on: bool = True
    kelvin: float | None = None

    @classmethod
    def of(cls, light: Light) -> LightEdit:
        return cls(light, light)

    @property
    def emitted(self) -> Light:
        if self.on and self.stops == 0.0:
            return self.light
        red, green, blue = self.light.color
        gain = 2.0**self.stops if self.on else 0.0
        return replace(self.light, color=(red * gain, green * gain, blue * gain))

    def moved(self, position: Point) -> LightEdit:
        """Return the light at another place. A spot keeps its target; a luminaire keeps its direction."""
        light = replace(self.light, position=position)
        if light.photometry is not None and light.spot_target is not None:
            x, y, z = (float(t) for t in np.add(light.spot_target, np.subtract(position, self.light.position)))
            light = replace(light, spot_target=(x, y, z))
        return replace(self, light=light)

    def aimed(self, target: Point) -> LightEdit:
        return replace(self, light=replace(self.light, spot_target=target))

    def coloured(self, color: Point) -> LightEdit:
        return replace(self, light=replace(self.light, color=color), kelvin=None)

    def heated(self, kelvin: float) -> LightEdit:
        """Return the light in the colour of a black body, with unchanged luminance."""
        luminance = float(LUMINANCE @ np.asarray(self.light.color))
        red, green, blue = blackbody(kelvin)
        color = red * luminance, green * luminance, blue * luminance
        return replace(self, light=replace(self.light, color=color), kelvin=kelvin)


WORDS = {  # by unit: the quantity, and its radiometric unit
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
        return {"lux": light.strength(1.0) * shine}
    constant, linear, quadratic = light.attenuation
    if not light.physical and (constant or linear):
        return {"lux at 1 m": light.strength(1.0) * shine}
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
