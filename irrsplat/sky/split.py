"""Splits a sky map into directional lights for small bright discs, such as the sun, and a remainder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.core.color import LUMINANCE
from irrsplat.core.vectors import Vector, vector
from irrsplat.sky.sphere import solid_angles, texel_directions

# Of 4096 rays, one at this multiple of the sky's mean radiance is 0.4 % of all light; brighter texels would be noise.
_BRIGHT = 16.0
_DISC = np.radians(4.0)  # radius of one disc: a photographed sun with its glare
_RING = np.radians(1.5)  # around the disc: light as bright there is not part of a disc
_LEAST = 0.01  # of all light: weaker discs stay in the map
_MOST, _TRIES = 4, 16  # discs, and examined bright places


@dataclass(frozen=True)
class Sun:
    """Light from far away. direction: (3,) towards it, unit, in the sky's axes; irradiance: (3,) W/m² perpendicular to it."""

    direction: Vector
    irradiance: Vector


def split(radiance: np.ndarray) -> tuple[np.ndarray, tuple[Sun, ...]]:
    """Return the remainder of an equirectangular map (H, W, 3), and its suns; together they preserve its light exactly.

    A sun is the light above its surroundings within a disc of 4°, if that is at least 1 % of all and brighter than 16 times the
    mean of the remainder; four at most.
    """
    height, width = radiance.shape[:2]
    area = solid_angles(height, width)
    brightness = radiance @ LUMINANCE.astype(np.float32)
    bound = _BRIGHT * _usual(brightness, area)
    whole = float(area @ brightness.sum(1, dtype=float))
    disc = max(_DISC, 0.6 * np.pi / height)
    ring = max(_RING, 1.6 * np.pi / height)
    rest, left = radiance, brightness.copy()
    suns: list[Sun] = []
    for _ in range(_TRIES):
        row, column = divmod(int(np.argmax(left)), width)
        if len(suns) == _MOST or not left[row, column] > bound:
            break
        reach = int((disc + ring) / np.pi * height) + 2
        rows = np.arange(max(row - reach, 0), min(row + reach + 1, height))
        ways = texel_directions(height, width, rows)
        angle = np.arccos(np.clip(ways @ texel_directions(height, width, rows[rows == row])[0, column], -1.0, 1.0))
        inside, around = angle <= disc, (angle > disc) & (angle <= disc + ring)
        level = max(bound, float(brightness[rows][around].max(initial=0.0)))
        left[rows] = np.where(inside, 0.0, left[rows])  # not examined again
        share = np.where(inside, np.maximum(1.0 - level / np.maximum(brightness[rows], 1e-30), 0.0), 0.0) * area[rows, None]
        irradiance = np.einsum("ij,ijc->c", share, radiance[rows], dtype=float)
        if irradiance @ LUMINANCE < _LEAST * whole:
            continue
        if rest is radiance:
            rest = radiance.copy()
        rest[rows] *= (1.0 - share / area[rows, None])[..., None].astype(np.float32)
        direction = np.einsum("ij,ijk->k", share * brightness[rows], ways)
        suns.append(sun(direction, irradiance))
    return rest, tuple(suns)


def sun(direction: np.ndarray, irradiance: np.ndarray) -> Sun:
    """Return the Sun in `direction` (3,), of any length, of `irradiance` W/m² (3,)."""
    return Sun(vector(direction / np.linalg.norm(direction)), vector(irradiance))


def _usual(brightness: np.ndarray, area: np.ndarray) -> float:
    """Return the spherical mean of the remainder, with values above _BRIGHT times that mean clamped."""
    mean, before = float(area @ brightness.mean(1, dtype=float)) * brightness.shape[1] / (4.0 * np.pi), np.inf
    while mean > 0.0 and mean < 0.999 * before:
        before = mean
        cut = np.minimum(brightness, np.float32(_BRIGHT * mean))
        mean = float(area @ cut.mean(1, dtype=float)) * brightness.shape[1] / (4.0 * np.pi)
    return float(mean)
