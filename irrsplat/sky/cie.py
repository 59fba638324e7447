"""CIE skies as in Radiance's `gensky`: luminance by direction, of the zenith, and of the sun."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from irrsplat.core.color import LUMINOUS_EFFICACY
from irrsplat.sky.colours import clear_sky, sunlight
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
