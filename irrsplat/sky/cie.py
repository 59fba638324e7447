"""CIE skies as in Radiance's `gensky`: luminance by direction, of the zenith, and of the sun."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from irrsplat.core.color import LUMINANCE, LUMINOUS_EFFICACY
from irrsplat.sky.environment import Environment
from irrsplat.sky.sphere import solid_angles, texel_directions
from irrsplat.sky.split import sun

CieKind = Literal["uniform", "overcast", "intermediate", "clear"]
CIE_KINDS: tuple[CieKind, ...] = get_args(CieKind)
TURBIDITY = 2.45  # gensky's
GROUND = 0.2  # mean reflectance of the ground, gensky's
SUN_DIAMETER = 0.533  # degrees
_HIGHEST = 87.0  # degrees: a clear sky's zenith luminance has a pole for a sun overhead; gensky clamps here as well
ROWS = 1024  # of the map, even: the sun is three texels wide
_FINE = 9  # points along a side of a texel, for the coverage by the sun's disc
# Preetham, Shirley and Smits 1999, A.2: Perez coefficients A to E of the chromaticities x and y, linear in the turbidity.
_PEREZ = np.array(
    [
        [[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]],
        [[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]],
    ]
)
# The same appendix: x and y at the zenith, by powers 2 to 0 of the turbidity and powers 3 to 0 of the sun's zenith angle.
_ZENITH = np.array(
    [
        [[0.00166, -0.00375, 0.00209, 0.0], [-0.02903, 0.06377, -0.03202, 0.00394], [0.11693, -0.21196, 0.06052, 0.25886]],
        [[0.00275, -0.00610, 0.00317, 0.0], [-0.04214, 0.08970, -0.04153, 0.00516], [0.15346, -0.26756, 0.06670, 0.26688]],
    ]
)
_RGB_FROM_XYZ = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])  # IEC 61966-2-1
_LOWEST = 0.03  # cosine of the zenith angle: the Perez function has a pole at the horizon
_WAVELENGTHS = np.array([0.610, 0.550, 0.465])  # micrometres: middles of red, green and blue
_TURBIDITIES = (1.7, 10.0)  # range of the fit


@dataclass(frozen=True)
class CieSky:
    """A CIE sky. altitude, azimuth: of the sun, degrees, the azimuth clockwise from north; None for skies without a sun.

    turbidity: of a clear or intermediate sky. ground: reflectance below the horizon. lux: horizontal illuminance of the sky
    alone, which scales it; None: by altitude and turbidity.
    """

    kind: CieKind
    altitude: float | None = None
    azimuth: float | None = None
    turbidity: float = TURBIDITY
    ground: float = GROUND
    lux: float | None = None

    @property
    def has_sun(self) -> bool:
        """True if there is a sun as well as the sky."""
        return self.kind in ("clear", "intermediate")

    @property
    def sun_direction(self) -> np.ndarray:
        """(3,) unit vector towards the sun: x east, y up, z south."""
        altitude, azimuth = np.radians([self.altitude or 0.0, self.azimuth or 0.0])
        flat = np.cos(altitude)
        return np.array([flat * np.sin(azimuth), np.sin(altitude), -flat * np.cos(azimuth)])

    def relative(self, directions: np.ndarray) -> np.ndarray:
        """Return (…,) luminances in unit directions (…, 3) above the horizon, relative to the zenith.

        Overcast: Moon and Spencer 1942. Clear: Kittler 1967 (CIE 22, 1973), clamped at 0.57° as in gensky. Intermediate:
        Nakamura, Oki and Hayashi 1985, in Matsuura's version in gensky.
        """
        rise = np.clip(directions[..., 1], 0.0, 1.0)
        if self.kind == "uniform":
            return np.ones(rise.shape)
        if self.kind == "overcast":
            overcast: np.ndarray = (1.0 + 2.0 * rise) / 3.0
            return overcast
        toward = self.sun_direction
        cosine = np.clip(directions @ toward, -1.0, 1.0)
        gamma, zenith, high = np.arccos(cosine), np.arccos(toward[1]), np.arcsin(min(toward[1], np.sin(np.radians(_HIGHEST))))
        if self.kind == "clear":
            fade = np.where(rise > 0.01, 1.0 - np.exp(-0.32 / np.maximum(rise, 0.01)), 1.0)
            whole = 0.274 * (0.91 + 10.0 * np.exp(-3.0 * (0.5 * np.pi - high)) + 0.45 * np.sin(high) ** 2)
            clear: np.ndarray = (0.91 + 10.0 * np.exp(-3.0 * gamma) + 0.45 * cosine**2) * fade / whole
            return clear
        eta = np.arccos(rise)
        whole = (2.739 + 0.9891 * np.sin(0.3119 + 2.6 * high)) * np.exp(-(0.5 * np.pi - high) * (0.4441 + 1.48 * high))
        body = ((1.35 * np.sin(5.631 - 3.59 * eta) + 3.12) * np.sin(4.396 - 2.6 * zenith) + 6.37 - eta) / 2.326
        hazy: np.ndarray = body * np.exp(-0.563 * gamma * ((2.629 - eta) * (1.562 - zenith) + 0.812)) / whole
        return hazy

    @property
    def zenith_luminance(self) -> float:
        """cd/m²: clear, Krochmann (1970) with Linke turbidity; overcast, Krochmann and Seidl (1974); intermediate, their mean, as
        in gensky."""
        altitude = np.radians(min(self.altitude or 0.0, _HIGHEST) if self.has_sun else self.altitude or 0.0)
        overcast = 8.6 * np.sin(altitude) + 0.123
        if not self.has_sun:
            return float(1000.0 * overcast)
        clear = (1.376 * self.turbidity - 1.81) * np.tan(altitude) + 0.38
        return float(1000.0 * max(0.5 * (clear + overcast) if self.kind == "intermediate" else clear, 0.0))

    @property
    def sun_illuminance(self) -> float:
        """lx perpendicular to the sun, gensky's: 1.5·10⁹ cd/m² over 6·10⁻⁵ sr, attenuated by air mass; 0 without a sun."""
        if not self.has_sun:
            return 0.0
        lux = 1.5e9 * 6e-5 * (1.147 - 0.147 / max(float(self.sun_direction[1]), 0.16))
        return lux * (0.15 if self.kind == "intermediate" else 1.0)

    def environment(self, about: str, line: str = "") -> Environment:
        """Return the sky and its ground as a map of ROWS, and its sun as a light; W/(m² sr) and W/m² by 179 lm/W.

        The luminances are the CIE's. A clear sky and a sun have colours of that luminance; all else is grey.
        """
        width = 2 * ROWS
        half, area = ROWS // 2, solid_angles(ROWS, width)
        ways = texel_directions(ROWS, width, np.arange(half))
        relative = self.relative(ways)
        open_sky = float(np.einsum("ij,ij,i->", relative, ways[..., 1], area[:half]))  # E over the zenith's luminance
        zenith = self.zenith_luminance if self.lux is None else self.lux / open_sky
        direct = self.sun_illuminance
        level = self.ground / np.pi * (zenith * open_sky + direct * self.sun_direction[1])
        luminance = np.concatenate([zenith * relative, np.full((half, width), level)])
        light = np.repeat((luminance / LUMINOUS_EFFICACY).astype(np.float32)[..., None], 3, axis=-1)
        if self.kind == "clear":
            light[:half] *= clear_sky(ways, self.sun_direction, self.turbidity).astype(np.float32)
        if not direct:
            return Environment(light, light, (), about, line=line)
        tint = sunlight(float(self.sun_direction[1]), self.turbidity)
        source = sun(self.sun_direction, tint * (direct / LUMINOUS_EFFICACY))
        disc = _disc(self.sun_direction, ROWS)
        disc *= direct / LUMINOUS_EFFICACY / (disc @ np.ones(width) @ area)
        shown = light + (disc[..., None] * tint).astype(np.float32)
        return Environment(shown, light, (source,), about, line=line)


def _disc(toward: np.ndarray, height: int) -> np.ndarray:
    """Return (H, W) shares of the texels covered by the sun's disc."""
    width = 2 * height
    covered, edge = np.zeros((height, width)), np.cos(np.radians(0.5 * SUN_DIAMETER))
    row = int(np.arccos(np.clip(toward[1], -1.0, 1.0)) / np.pi * height)
    rows = np.arange(max(row - 2, 0), min(row + 3, height))
    fine = texel_directions(height * _FINE, width * _FINE, (rows[:, None] * _FINE + np.arange(_FINE)).ravel()) @ toward >= edge
    covered[rows] = fine.reshape(len(rows), _FINE, width, _FINE).mean((1, 3))
    return covered


# ---- colours of a clear sky and of sunlight, as factors of luminance 1 -------------------------------------------------


def clear_sky(directions: np.ndarray, sun: np.ndarray, turbidity: float) -> np.ndarray:
    """Return the colour (…, 3) of a clear sky in unit directions (…, 3), y up, of luminance 1 (Preetham et al. 1999).

    sun: (3,) unit vector towards the sun. Colours outside of sRGB are clipped at 0 before they are scaled.
    """
    T = min(max(turbidity, _TURBIDITIES[0]), _TURBIDITIES[1])
    theta_sun = float(np.arccos(np.clip(sun[1], 0.0, 1.0)))
    cosine = np.clip(directions @ sun, -1.0, 1.0)
    gamma, rise = np.arccos(cosine), np.maximum(directions[..., 1], _LOWEST)
    chromaticity = []
    for coefficients, zenith in zip(_PEREZ, _ZENITH, strict=True):
        A, B, C, D, E = coefficients @ np.array([T, 1.0])
        at_zenith = np.array([T * T, T, 1.0]) @ zenith @ np.array([theta_sun**3, theta_sun**2, theta_sun, 1.0])
        here = (1.0 + A * np.exp(B / rise)) * (1.0 + C * np.exp(D * gamma) + E * cosine**2)
        there = (1.0 + A * np.exp(B)) * (1.0 + C * np.exp(D * theta_sun) + E * sun[1] ** 2)
        chromaticity.append(at_zenith * here / there)
    return of_chromaticity(*chromaticity)


def of_chromaticity(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the linear colours (…, 3) of CIE chromaticities, with luminance 1. Negative components become 0 before."""
    return _unit_luminance(np.stack([x / y, np.ones_like(x), (1.0 - x - y) / y], -1) @ _RGB_FROM_XYZ.T)


def sunlight(sine: float, turbidity: float) -> np.ndarray:
    """Return the colour (3,) of the sun, of luminance 1, by its height's sine (Preetham et al. 1999, appendix A.1).

    Rayleigh scattering and Angstrom's aerosols redden it; above the atmosphere it is taken for white.
    """
    T = min(max(turbidity, _TURBIDITIES[0]), _TURBIDITIES[1])
    degrees = float(np.degrees(np.arcsin(np.clip(sine, 0.0, 1.0))))
    mass = 1.0 / (max(sine, 0.0) + 0.15 * (degrees + 3.885) ** -1.253)  # relative optical air mass
    aerosol = 0.04608 * T - 0.04586
    depth = 0.008735 * _WAVELENGTHS**-4.08 + aerosol * _WAVELENGTHS**-1.3
    return _unit_luminance(np.exp(-depth * mass))


def _unit_luminance(color: np.ndarray) -> np.ndarray:
    """Return colours (…, 3) clipped at 0 and scaled to luminance 1."""
    clipped = np.maximum(color, 0.0)
    return np.asarray(clipped / (clipped @ LUMINANCE)[..., None])
