"""Changes of lights: place, brightness, colour by the temperature of a black body, on and off."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from irrsplat.core.color import LUMINANCE
from irrsplat.scene.model import Light

COLDEST, HOTTEST = 1500.0, 12_000.0  # kelvin, the range of the slider
_SECOND = 1.438777e-2  # m K, Planck's second radiation constant
_REC_709 = np.array(  # from CIE XYZ, white D65 (IEC 61966-2-1)
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)
_LOBES = (  # of the CIE 1931 colour matching functions x, y, z: height, centre, widths below and above it in nm
    ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
    ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
    ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
)


def tristimulus(kelvin: float) -> np.ndarray:
    """(3,) CIE XYZ of a black body of this temperature, with Y 1; by the matching functions of Wyman, Sloan and Shirley 2013,
    "Simple Analytic Approximations to the CIE XYZ Color Matching Functions", equation 4."""
    nm = np.arange(360.0, 831.0, 1.0)
    radiance = nm**-5.0 / np.expm1(_SECOND / (1e-9 * nm * kelvin))
    sums = np.array([sum(radiance @ _lobe(nm, *lobe) for lobe in lobes) for lobes in _LOBES])
    relative: np.ndarray = sums / sums[1]
    return relative


def _lobe(nm: np.ndarray, height: float, centre: float, below: float, above: float) -> np.ndarray:
    values: np.ndarray = height * np.exp(-0.5 * ((nm - centre) / np.where(nm < centre, below, above)) ** 2)
    return values


@lru_cache(maxsize=1024)
def blackbody(kelvin: float) -> tuple[float, float, float]:
    """The linear Rec. 709 colour of a black body of this temperature, its luminance 1; the nearest there is where it is redder
    than Rec. 709 has colours for (below about 1900 K)."""
    color = np.maximum(_REC_709 @ tristimulus(kelvin), 0.0)
    red, green, blue = (color / float(LUMINANCE @ color)).tolist()
    return red, green, blue


Vector = tuple[float, float, float]


@dataclass(frozen=True)
class LightEdit:
    """A light of the scene as it is set: `light` with its full colour, brighter by `stops`, or off.

    loaded: the light as the scene's files have it, or as it was added. kelvin: the temperature by which it has its colour; None:
    it has one of its own.
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

    def moved(self, position: Vector) -> LightEdit:
        """Return the light at another place. A spot keeps its target; a luminaire keeps its direction."""
        light = replace(self.light, position=position)
        if light.photometry is not None and light.spot_target is not None:
            x, y, z = (float(t) for t in np.add(light.spot_target, np.subtract(position, self.light.position)))
            light = replace(light, spot_target=(x, y, z))
        return replace(self, light=light)

    def aimed(self, target: Vector) -> LightEdit:
        return replace(self, light=replace(self.light, spot_target=target))

    def coloured(self, color: Vector) -> LightEdit:
        return replace(self, light=replace(self.light, color=color), kelvin=None)

    def heated(self, kelvin: float) -> LightEdit:
        """Return the light in the colour of a black body, with the same luminance."""
        luminance = float(LUMINANCE @ np.asarray(self.light.color))
        red, green, blue = blackbody(kelvin)
        color = red * luminance, green * luminance, blue * luminance
        return replace(self, light=replace(self.light, color=color), kelvin=kelvin)

    def coned(self, cutoff: float, inner: float) -> LightEdit:
        """The spot with another cone: half angles in degrees, the inner one at most the outer one."""
        return replace(self, light=replace(self.light, spot_cutoff=cutoff, spot_inner=min(inner, cutoff)))
