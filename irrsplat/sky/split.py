"""A map of a sky in two: the small bright discs in it, such as the sun, as directional light, and the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.core.color import LUMINANCE
from irrsplat.sky.sphere import solid_angles, texel_directions

# Of 4096 rays, one that sees this many times the mean radiance of the sky is 0.4 % of all light: what is brighter would be noise.
_BRIGHT = 16.0
_DISC = np.radians(4.0)  # radius of what is taken for one disc: a sun as cameras see it, with its glare
_RING = np.radians(1.5)  # around that: what is as bright there is no part of a disc
_LEAST = 0.01  # of all light: a disc that brings less stays where it is
_MOST, _TRIES = 4, 16  # discs, and bright places that are looked at


@dataclass(frozen=True)
class Sun:
    """Light from far away. direction: (3,) towards it, unit, in the sky's axes; irradiance: (3,) W/m² on what faces it."""

    direction: tuple[float, float, float]
    irradiance: tuple[float, float, float]


def split(radiance: np.ndarray) -> tuple[np.ndarray, tuple[Sun, ...]]:
    """The rest of an equirectangular map (H, W, 3), and the suns that were in it; together they hold its light exactly.

    A sun is the light above the level of its surroundings within a disc of 4°, where that is at least 1 % of all and brighter
    than 16 times the mean of what is left; four at most.
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
        left[rows] = np.where(inside, 0.0, left[rows])  # it is not looked at again
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
    """The Sun in this direction (3,), of any length, of so many W/m² (3,)."""
    x, y, z = (direction / np.linalg.norm(direction)).tolist()
    r, g, b = irradiance.tolist()
    return Sun((x, y, z), (r, g, b))


def _usual(brightness: np.ndarray, area: np.ndarray) -> float:
    """The mean over the sphere of what is left where all that is brighter than _BRIGHT times it is cut down to that."""
    mean, before = float(area @ brightness.mean(1, dtype=float)) * brightness.shape[1] / (4.0 * np.pi), np.inf
    while mean > 0.0 and mean < 0.999 * before:
        before = mean
        cut = np.minimum(brightness, np.float32(_BRIGHT * mean))
        mean = float(area @ cut.mean(1, dtype=float)) * brightness.shape[1] / (4.0 * np.pi)
    return float(mean)
