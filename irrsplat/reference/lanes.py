"""Arithmetic on lanes, the path tracer's Dr.Jit arrays: textures, photometries, emitter sampling, directions.

Importing this needs the extra `reference`.
"""

from __future__ import annotations

from math import pi
from typing import Any, TypeAlias

import drjit as dr
import mitsuba as mi
import numpy as np

from irrsplat.core.color import LUMINOUS_EFFICACY
from irrsplat.reference.emitters import Emitters
from irrsplat.reference.textures import Backend
from irrsplat.scene.model import Photometry

Lanes: TypeAlias = Any  # a Dr.Jit array with one entry per lane; its class depends on the variant chosen at run time

TINY = 1e-30  # keeps divisors from 0


BACKEND = Backend(
    array=lambda values: mi.UInt32(values) if values.dtype.kind == "u" else mi.Float(values.astype(np.float32)),
    gather=lambda table, index: dr.gather(type(table), table, index),
    select=dr.select,
    floor=dr.floor,
    whole=lambda x: mi.UInt32(x),  # noqa: PLW0108  # the class depends on the variant
)


class EmitterLanes:
    """Emitters for sampling in lanes. place: (N,) numbers of their triangles among the `faces` that light may hit."""

    def __init__(self, emitters: Emitters, place: np.ndarray, faces: int) -> None:
        self.count = len(emitters.power)
        self.centre = mi.Float(emitters.centre.astype(np.float32).ravel())
        self.radius, self.power = (mi.Float(x.astype(np.float32)) for x in (emitters.radius, emitters.power))
        ends = np.cumsum(np.bincount(emitters.group, minlength=self.count))
        self.first, self.end = (mi.UInt32(x.astype(np.uint32)) for x in (np.roll(ends, 1) * (np.arange(self.count) > 0), ends))
        # cumulative share within each cluster, from 0 to 1
        rising = np.cumsum(emitters.share)
        self.up_to = mi.Float((rising - emitters.group).astype(np.float32))
        self.face = mi.UInt32(place.astype(np.uint32))
        density, group = np.zeros(faces), np.zeros(faces)
        density[place], group[place] = emitters.density, emitters.group
        self.within, self.group = mi.Float(density.astype(np.float32)), mi.UInt32(group.astype(np.uint32))

    def weight(self, group: Lanes, p: Lanes, n: Lanes) -> Lanes:
        """Return the weight of one cluster at each p with normal n; a cluster is chosen in proportion."""
        toward = dr.gather(mi.Vector3f, self.centre, group) - mi.Vector3f(p)
        radius, power = dr.gather(mi.Float, self.radius, group), dr.gather(mi.Float, self.power, group)
        return dr.select(dr.dot(toward, n) > -radius, power / (dr.squared_norm(toward) + dr.square(radius) + TINY), 0.0)

    def total(self, p: Lanes, n: Lanes) -> Lanes:
        """Return the sum of all clusters' weights at each p."""
        total = dr.zeros(mi.Float, dr.width(p))
        group = dr.zeros(mi.UInt32, dr.width(p))
        state = dr.while_loop(
            (group, total),
            lambda group, total: group < self.count,
            lambda group, total: (group + 1, total + self.weight(group, p, n)),
        )
        return state[1]

    def draw(self, p: Lanes, n: Lanes, whole: Lanes, u: Lanes, jitter: Lanes) -> tuple[Lanes, Lanes]:
        """Return a triangle number for each p, and the remaining random number, uniform again.

        whole: the sum of the weights. Strata of u remain strata of the second choice. jitter: another random number, for the low
        bits.
        """
        width = dr.width(p)

        def step(group: Lanes, last: Lanes, left: Lanes) -> tuple[Lanes, Lanes, Lanes]:
            weight = self.weight(group, p, n)
            return group + 1, dr.select(weight > 0.0, group, last), left - weight

        state = dr.zeros(mi.UInt32, width), dr.zeros(mi.UInt32, width), mi.Float(u * whole)
        _, group, left = dr.while_loop(state, lambda group, last, left: (group < self.count) & (left >= 0.0), step)
        first, end = dr.gather(mi.UInt32, self.first, group), dr.gather(mi.UInt32, self.end, group)
        of_group = self.weight(group, p, n) / (whole + TINY)
        rest = positive(1.0 + left / (of_group * whole + TINY))
        rest = dr.select(rest < 1.0, rest, 1.0)

        def halve(first: Lanes, end: Lanes) -> tuple[Lanes, Lanes]:
            middle = (first + end) >> 1
            beyond = dr.gather(mi.Float, self.up_to, middle) <= rest
            return dr.select(beyond, middle + 1, first), dr.select(beyond, end, middle)

        found, _ = dr.while_loop((first, end - 1), lambda first, end: first < end, halve)
        below = dr.select(found > first, dr.gather(mi.Float, self.up_to, found - 1, active=found > first), 0.0)
        share = dr.gather(mi.Float, self.up_to, found) - below
        rest = (rest - below) / (share + TINY) + (jitter - 0.5) * (2.0**-24 / (of_group * share + TINY))
        return dr.gather(mi.UInt32, self.face, found), rest - dr.floor(rest)

    def density(self, p: Lanes, n: Lanes, whole: Lanes, face: Lanes, active: Lanes) -> Lanes:
        """Return the density per area with which `draw` chooses points of these triangles, 0 for non-emitters."""
        within = dr.gather(mi.Float, self.within, face, active=active)
        group = dr.gather(mi.UInt32, self.group, face, active=active)
        return dr.select(within > 0.0, within * self.weight(group, p, n) / (whole + TINY), 0.0)


class PhotometryLanes:
    """A luminaire's photometry in lanes."""

    def __init__(self, photometry: Photometry) -> None:
        self.axes = photometry.axes
        self.columns = len(photometry.polar)
        self.polar, self.azimuth, self.candela = (
            mi.Float(a.astype(np.float32).ravel()) for a in (photometry.polar, photometry.azimuth, photometry.candela)
        )
        self.first, self.last = float(photometry.azimuth[0]), float(photometry.azimuth[-1])
        self.low, self.high = float(photometry.polar[0]), float(photometry.polar[-1])

    def intensity(self, direction: Lanes, frame: np.ndarray) -> Lanes:
        """Return W/sr along unit directions in world space from a luminaire of colour 1 with this `frame` (Light.frame)."""
        zero, quarter, pole = (mi.Vector3f(*(float(x) for x in row)) for row in self.axes @ frame)
        x, y, z = dr.dot(direction, zero), dr.dot(direction, quarter), dr.dot(direction, pole)
        polar = polar_angle(dr.sqrt(x * x + y * y), z) * (180.0 / pi)
        i, s = self._between(self.polar, polar)
        inside = (polar >= self.low - 1e-3) & (polar <= self.high + 1e-3)
        if self.last == self.first:
            return dr.select(inside, self._row(0, i, s), 0.0) / LUMINOUS_EFFICACY
        turned = polar_angle(y, x) * (180.0 / pi) - self.first
        azimuth = self.first + turned - 360.0 * dr.floor(turned / 360.0)
        k, t = self._between(self.azimuth, azimuth)
        found = self._row(k, i, s) * (1.0 - t) + self._row(k + 1, i, s) * t
        return dr.select(inside & (azimuth <= self.last + 1e-3), found, 0.0) / LUMINOUS_EFFICACY

    def _row(self, row: Lanes, i: Lanes, s: Lanes) -> Lanes:
        """Return candela in a row of the table, interpolated by s between column i and the next."""
        left, right = (dr.gather(mi.Float, self.candela, mi.UInt32(row * self.columns + i + k)) for k in (0, 1))
        return left * (1.0 - s) + right * s

    @staticmethod
    def _between(angles: Lanes, values: Lanes) -> tuple[Lanes, Lanes]:
        """Return the number of the last angle (but one) not above each value, and the fraction to the next angle."""
        count = dr.width(angles)
        search: Any = dr.binary_search
        beyond = search(1, count - 1, lambda k: dr.gather(mi.Float, angles, mi.UInt32(k)) <= values)
        i = mi.UInt32(beyond) - 1
        low, high = (dr.gather(mi.Float, angles, i + k) for k in (0, 1))
        share = positive((values - low) / (high - low))
        return i, dr.select(share < 1.0, share, 1.0)


def density_of_ray(p: Lanes, n: Lanes, q: Lanes, g: Lanes) -> Lanes:
    """Return the density per area at q, with surface normal g, of a cosine-distributed ray from p."""
    to_p = p - q
    r = dr.norm(to_p)
    return dr.select(r > 0.0, positive(dr.dot(n, -to_p)) * dr.abs(dr.dot(g, to_p)) / (pi * r * r * r * r), 0.0)


def cosine_hemisphere(u: Lanes) -> Lanes:
    """Return cosine-distributed unit directions about z."""
    sine, phi = dr.sqrt(u.x), 2.0 * pi * u.y
    return mi.Vector3f(sine * dr.cos(phi), sine * dr.sin(phi), dr.sqrt(positive(1.0 - u.x)))


def uniform_cap(u: Lanes, edge: float) -> Lanes:
    """Return uniform unit directions with z at least `edge`; the whole sphere for −1."""
    z, phi = 1.0 - u.x * (1.0 - edge), 2.0 * pi * u.y
    sine = dr.sqrt(positive(1.0 - z * z))
    return mi.Vector3f(sine * dr.cos(phi), sine * dr.sin(phi), z)


def positive(x: Lanes) -> Lanes:
    """Return max(x, 0) without the `fmaximum` of dr.maximum, which LLVM sometimes fails to compile (AVX-512, "Cannot select")."""
    return dr.select(x > 0.0, x, 0.0)


def polar_angle(y: Lanes, x: Lanes) -> Lanes:
    """Return atan2(y, x), −π..π; 0 at the origin. dr.atan2 has an `fmaximum`, see `positive`."""
    length = dr.sqrt(x * x + y * y)
    cosine = dr.select(length > 0.0, x / length, 1.0)
    angle = dr.acos(dr.select(cosine > 1.0, 1.0, dr.select(cosine < -1.0, -1.0, cosine)))
    return dr.select(y < 0.0, -angle, angle)


def lights(E: Lanes) -> Lanes:
    """True if any channel is positive."""
    return (E.x > 0.0) | (E.y > 0.0) | (E.z > 0.0)
