"""Luminaires of a scene for shaders: their orientations, and the candela of their photometries in one texture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irrsplat.core.buffers import LUMINAIRE_ROWS
from irrsplat.core.color import LUMINOUS_EFFICACY
from irrsplat.scene.model import Light, Photometry


def photometries(lights: Sequence[Light]) -> tuple[Photometry, ...]:
    """Return the distinct photometries of the lights, in their order."""
    return tuple(dict.fromkeys(light.photometry for light in lights if light.photometry is not None))


def luminaire_rows(lights: Sequence[Light]) -> np.ndarray:
    """Return (LUMINAIRE_ROWS·lights, 4), three rows a light.

    xyz: directions of azimuth 0, of azimuth 90° and of the pole, unit, world space. w: first row of its photometry in the
    texture (-1 for other lights), number of polar angles, number of azimuths.
    """
    different = photometries(lights)
    firsts = np.cumsum([0, *(len(one.azimuth) + 1 for one in different)]).tolist()
    first = dict(zip(different, firsts, strict=False))
    table = np.zeros((len(lights), LUMINAIRE_ROWS, 4))
    table[:, 0, 3] = -1.0
    for light, rows in zip(lights, table, strict=True):
        if light.photometry is not None:
            rows[:, :3] = light.photometry.axes @ light.frame
            rows[:, 3] = first[light.photometry], len(light.photometry.polar), len(light.photometry.azimuth)
    return table.reshape(-1, 4)


def photometry_texels(different: Sequence[Photometry]) -> np.ndarray:
    """Return (R, C) float32, the photometries one above the other.

    First row of each: polar angles in degrees from column 1 on. Further rows: an azimuth in degrees in column 0, then the
    radiant intensities there, W/sr.
    """
    texels = np.zeros(photometry_size(different)[::-1], np.float32)
    row = 0
    for one in different:
        count, rows = len(one.polar), len(one.azimuth)
        texels[row, 1 : count + 1] = one.polar
        texels[row + 1 : row + rows + 1, 0] = one.azimuth
        texels[row + 1 : row + rows + 1, 1 : count + 1] = one.candela / LUMINOUS_EFFICACY
        row += rows + 1
    return texels


def photometry_size(different: Sequence[Photometry]) -> tuple[int, int]:
    """Return columns and rows of the texture."""
    columns = max((len(one.polar) + 1 for one in different), default=1)
    return columns, max(sum(len(one.azimuth) + 1 for one in different), 1)


def halvings(different: Sequence[Photometry]) -> int:
    """Return the number of bisection steps that a search among the angles of any photometry needs."""
    return max((max(len(one.polar), len(one.azimuth)) - 2).bit_length() for one in different)
