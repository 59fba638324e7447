"""Delta lights and the photometry of luminaires."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from irrsplat.core.color import LUMINANCE
from irrsplat.core.errors import InputError
from irrsplat.core.vectors import vector
from irrsplat.core.words import GREATEST
from irrsplat.scene.model.checks import check_type, checked, checked_number, put
from irrsplat.sky.environment import Environment


@dataclass(frozen=True, eq=False)  # compared by identity, because == of arrays has no single value
class Photometry:
    """The intensity of a luminaire by direction, from goniometer measurements; linear in both angles.

    Its frame is aimed along −z; the horizontal angle 0 lies towards +x, 90° towards +y. axes: (3, 3) rows, unit, in that frame:
    the directions of azimuth 0, of azimuth 90° and of the pole. polar: (P,) degrees from the pole, ascending, 0..180; the
    intensity beyond either end is 0. azimuth: (A,) degrees about the pole, ascending over at most 360, 0 beyond either end; a
    single value: rotationally symmetric. candela: (A, P) cd. opening: width, length and height of the luminous opening in metres;
    the light is a point all the same. path: of its file.
    """

    polar: np.ndarray
    azimuth: np.ndarray
    candela: np.ndarray
    axes: np.ndarray
    opening: tuple[float, float, float] = (0.0, 0.0, 0.0)
    path: str = ""

    EDGE = 1e-3  # degrees; tolerance for rounding at the ends

    def intensity(self, directions: np.ndarray) -> np.ndarray:
        """Return (…,) cd along unit directions (…, 3) in the luminaire's frame."""
        x, y, z = np.moveaxis(np.asarray(directions, float) @ self.axes.T, -1, 0)
        polar, azimuth, first = np.degrees(np.arctan2(np.hypot(x, y), z)), np.degrees(np.arctan2(y, x)), self.azimuth[0]
        i, s, within_polar = _between(self.polar, polar, self.EDGE)
        k, t, within_azimuth = _between(self.azimuth, first + np.mod(azimuth - first, 360.0), self.EDGE)
        c, n = self.candela, np.minimum(k + 1, len(self.azimuth) - 1)
        low, high = c[k, i] * (1.0 - t) + c[n, i] * t, c[k, i + 1] * (1.0 - t) + c[n, i + 1] * t
        return np.where(within_polar & within_azimuth, low * (1.0 - s) + high * s, 0.0)

    @cached_property
    def flux(self) -> float:
        """lm: the integral of the intensity over all directions, exact for the linear interpolation."""
        g = np.radians(self.polar)
        a, b, step = g[:-1], g[1:], np.diff(g)
        # over an interval ∫ sin γ dγ is cos a − cos b, and ∫ γ·sin γ dγ is sin b − b·cos b − sin a + a·cos a
        whole, moment = np.cos(a) - np.cos(b), np.sin(b) - b * np.cos(b) - np.sin(a) + a * np.cos(a)
        rising = (moment - a * whole) / step
        zonal = self.candela[:, :-1] @ (whole - rising) + self.candela[:, 1:] @ rising
        if len(zonal) == 1:
            return float(2.0 * np.pi * zonal[0])
        return float((0.5 * (zonal[:-1] + zonal[1:])) @ np.diff(np.radians(self.azimuth)))

    @cached_property
    def peak(self) -> float:
        """cd: the greatest intensity."""
        return float(self.candela.max())

    @cached_property
    def reach(self) -> float:
        """Degrees: the greatest angle between emitted light and the aim."""
        lit = np.pad(self.candela > 0.0, 1)
        rows, columns = self.candela.shape
        touched = np.any([lit[i : i + rows, k : k + columns] for i in range(3) for k in range(3)], axis=0)
        polar, azimuth = np.radians(self.polar), np.radians(self.azimuth)[:, None]
        parts = np.broadcast_arrays(np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar))
        along_aim = -(np.stack(parts, axis=-1) @ self.axes)[..., 2]
        return math.degrees(math.acos(min(max(float(along_aim[touched].min(initial=1.0)), -1.0), 1.0)))

    @cached_property
    def digest(self) -> bytes:
        """32 bytes that identify the emitted light."""
        whole = hashlib.sha256()
        for array in (self.polar, self.azimuth, self.candela, self.axes):
            whole.update(f"{array.shape}".encode() + np.asarray(array, np.float64).tobytes())
        return whole.digest()


def _between(angles: np.ndarray, values: np.ndarray, edge: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the interval of each value, the position within it 0..1, and whether it lies between the first and last angle.

    A single angle covers all values.
    """
    if len(angles) == 1:
        return np.zeros(values.shape, int), np.zeros(values.shape), np.ones(values.shape, bool)
    i = np.clip(np.searchsorted(angles, values, side="right") - 1, 0, len(angles) - 2)
    share = np.clip((values - angles[i]) / (angles[i + 1] - angles[i]), 0.0, 1.0)
    return i, share, (values >= angles[0] - edge) & (values <= angles[-1] + edge)


@dataclass(frozen=True)
class Light:
    """A delta light: a point, a spot, a directional one or a luminaire.

    position: (3,) world space; for a directional light the direction *towards* the light (need not be unit). color: (3,) OpenGL's
    `diffuse`; where `physical`, the radiant intensity in W/sr, or the irradiance of a surface that faces a directional light in
    W/m². attenuation: OpenGL's (constant, linear, quadratic); not used where `physical` (then 1/d²). spot_target: the point that
    a spot is aimed at, or None (no cone). spot_cutoff, spot_inner: half angles in degrees; full intensity inside spot_inner,
    falling linearly in the angle to 0 at spot_cutoff; equal: a hard edge. spot_exponent: OpenGL's cos^exponent inside the cone.
    photometry: of a luminaire, which is `physical` and has no cone. Its radiant intensity in W/sr is color times candela divided
    by LUMINOUS_EFFICACY. It is aimed at spot_target (None: along −z). Its horizontal angle 0 lies towards the component of
    `across`, (3,) world space, any length, that is perpendicular to the aim.
    Raises InputError for invalid numbers.
    """

    position: tuple[float, float, float]
    color: tuple[float, float, float]
    directional: bool = False
    physical: bool = False
    attenuation: tuple[float, float, float] = (1.0, 0.0, 0.0)
    spot_target: tuple[float, float, float] | None = None
    spot_cutoff: float = 180.0
    spot_inner: float = 180.0
    spot_exponent: float = 0.0
    name: str = ""
    photometry: Photometry | None = None
    across: tuple[float, float, float] = (1.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        light = f"of light {self.name!r:.60}" if self.name else "of a light"
        for name, least in (("position", -GREATEST), ("color", 0.0), ("attenuation", 0.0), ("across", -GREATEST)):
            put(self, **{name: checked(f"the {name} {light}", getattr(self, name), 3, least)})
        if self.spot_target is not None:
            put(self, spot_target=checked(f"the spot_target {light}", self.spot_target, 3))
        for name, most in (("spot_cutoff", 180.0), ("spot_inner", 180.0), ("spot_exponent", GREATEST)):
            put(self, **{name: checked_number(f"the {name} {light}", getattr(self, name), 0.0, most)})
        if self.directional and not any(self.position):
            raise InputError(f"the position {light} that is directional is the direction towards it, and cannot be 0 0 0")
        if not self.physical and not any(self.attenuation):
            raise InputError(f"the attenuation {light} is 0 0 0, a division by zero; give at least one number above 0")
        check_type("a light's name", self.name, str)
        check_type(f"the photometry {light}", self.photometry, Photometry, None)

    @property
    def kind(self) -> str:
        """The kind for messages: directional, luminaire, spot or point."""
        if self.photometry is not None:
            return "luminaire"
        return "directional" if self.directional else "spot" if self.has_cone else "point"

    def shifted(self, by: npt.ArrayLike) -> Light:
        """Return the light shifted by `by` (3,) metres; directional lights do not change."""
        if self.directional:
            return self
        target = None if self.spot_target is None else vector(np.add(self.spot_target, by))
        return replace(self, position=vector(np.add(self.position, by)), spot_target=target)

    def strength(self, distance: float) -> float:
        """Return the irradiance of a surface that faces the light at `distance` metres, W/m² per unit of colour, or of intensity.

        Cone and photometry are left out.
        """
        if self.directional:
            return 1.0 if self.physical else math.pi
        if self.physical:
            return 1.0 / max(distance * distance, 1e-30)
        constant, linear, quadratic = self.attenuation
        return math.pi / max(constant + linear * distance + quadratic * distance * distance, 1e-30)

    @property
    def has_cone(self) -> bool:
        """True for a spot, with spot_target, spot_cutoff, spot_inner and spot_exponent."""
        return self.spot_target is not None and self.photometry is None

    @property
    def frame(self) -> np.ndarray:
        """(3, 3) rows x, y and z of a luminaire's frame in world space, unit; −z is its aim."""
        aim = np.array([0.0, 0.0, -1.0])
        if self.spot_target is not None and tuple(self.spot_target) != tuple(self.position):
            aim = np.subtract(self.spot_target, self.position)
        z = -aim / np.linalg.norm(aim)
        across = np.asarray(self.across, float) / max(float(np.linalg.norm(self.across)), 1e-300)
        x = across - (across @ z) * z
        if np.linalg.norm(x) < 1e-6:  # parallel to the aim: use the most perpendicular axis, y before z
            across = np.eye(3)[np.argmin(np.abs(z))]
            x = across - (across @ z) * z
        x /= np.linalg.norm(x)
        return np.stack([x, np.cross(z, x), z])

    @property
    def output(self) -> tuple[float, float]:
        """A luminaire's flux in lm and greatest intensity in cd, both times the luminance of its colour."""
        if self.photometry is None:
            return 0.0, 0.0
        luminance = float(np.asarray(self.color, float) @ LUMINANCE)
        return luminance * self.photometry.flux, luminance * self.photometry.peak

    @property
    def key(self) -> tuple[npt.ArrayLike | None, ...]:
        """All values that its illumination depends on: its fields without the name, and 32 numbers for the photometry."""
        values = tuple(value for name, value in vars(self).items() if name not in ("name", "photometry", "across"))
        return values if self.photometry is None else (*values, tuple(self.photometry.digest), self.across)


def sun_lights(environment: Environment) -> tuple[Light, ...]:
    """Return the suns of a sky as directional lights."""
    found = []
    for sun in environment.suns:
        red, green, blue = (value / math.pi for value in sun.irradiance)
        found.append(Light(environment.toward(sun), (red, green, blue), directional=True, name="sun"))
    return tuple(found)
