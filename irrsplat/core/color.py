"""Colour: sRGB encoding and decoding, luminance and photometric units, and clamping."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from irrsplat.core.vectors import Vector, vector

MID_GREY = 0.18  # reflectance that appears halfway between black and white
DARKEST = 0.02  # reflectance of black velvet: lower bound for exposure metering
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # Rec. 709
# lm/W of white light, as in Radiance (WHTEFFICACY in its color.h; Ward 1994). Photometric units are radiometric units times this,
# with colours weighted by LUMINANCE.
LUMINOUS_EFFICACY = 179.0


class Srgb(NamedTuple):
    """The sRGB encoding (IEC 61966-2-1): slope·x up to `linear_end`, (1 + offset)·x^(1/power) - offset beyond it."""

    slope: float = 12.92
    offset: float = 0.055
    power: float = 2.4
    linear_end: float = 0.0031308
    encoded_end: float = 0.04045  # encoded `linear_end`, as the standard rounds it


SRGB = Srgb()


def linear_from_srgb(values: np.ndarray) -> np.ndarray:
    """Return linear values of sRGB-encoded ones in 0..1 (IEC 61966-2-1), of any shape."""
    c = SRGB
    curved = ((values + c.offset) / (1.0 + c.offset)) ** c.power
    return np.where(values <= c.encoded_end, values / c.slope, curved)


def srgb(linear: np.ndarray) -> np.ndarray:
    """Return sRGB-encoded values in 0..1 (IEC 61966-2-1) of linear ones of any shape, clamped to 0..1."""
    x = np.clip(linear, 0.0, 1.0)
    c = SRGB
    curved = (1.0 + c.offset) * np.maximum(x, c.linear_end) ** (1 / c.power) - c.offset
    return np.asarray(np.where(x <= c.linear_end, c.slope * x, curved))


def photometric(values: np.ndarray) -> np.ndarray:
    """Return (…) lux, cd/m², cd or lm of (…, 3) W/m², W/(m² sr), W/sr or W of red, green and blue."""
    found: np.ndarray = LUMINOUS_EFFICACY * (values @ LUMINANCE.astype(values.dtype))
    return found


def clip_color(values: Sequence[float] | np.ndarray) -> Vector:
    """Return three values clamped to 0..1; NaN becomes 0."""
    return vector(np.clip(np.nan_to_num(np.asarray(values, float)), 0.0, 1.0))
