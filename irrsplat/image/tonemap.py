"""Display values from radiance and other buffers: exposure, the filmic curve, sRGB, and colours for scalars."""

from __future__ import annotations

import math

import numpy as np

from irrsplat.core.buffers import CHANNELS, FILMIC
from irrsplat.core.color import DARKEST, LUMINANCE, MID_GREY, srgb

FULL = 0.2  # share of the mean irradiance at the full colour of an error
BRIGHT, DARK, GREY = (178, 24, 43), (33, 102, 172), (120, 120, 120)  # of errors: too bright, too dark, no surface
_DARK = 1e-3  # of the light without shadows: more than leaks past the rims of walls in shadow maps
# Viridis (van der Walt & Smith 2015) as the polynomial of degree six fitted by Matt Zucker ("matplotlib colormaps", CC0, 2019).
_VIRIDIS = np.array(
    [
        [0.2777273272234177, 0.005407344544966578, 0.3340998053353061],
        [0.1050930431085774, 1.404613529898575, 1.384590162594685],
        [-0.3308618287255563, 0.214847559468213, 0.09509516302823659],
        [-4.634230498983486, -5.799100973351585, -19.33244095627987],
        [6.228269936347081, 14.17993336680509, 56.69055260068105],
        [4.776384997670288, -13.74514537774601, -65.35303263337234],
        [-5.435455855934631, 4.645852612178535, 26.3124352495832],
    ]
)


def filmic(x: np.ndarray) -> np.ndarray:
    """Return linear display values 0..1 of exposed radiance, per channel, by Hable's curve (buffers.FILMIC)."""
    c = FILMIC

    def f(v: np.ndarray) -> np.ndarray:
        return (v * (c.a * v + c.c * c.b) + c.d * c.e) / (v * (c.a * v + c.b) + c.d * c.f) - c.e / c.f

    bounded = np.clip(x, 0.0, c.white / c.scale)  # the curve is white there; infinity would be inf/inf
    display: np.ndarray = np.clip(f(c.scale * bounded) / f(np.asarray(c.white)), 0.0, 1.0)
    return display


def tonemap(radiance: np.ndarray, exposure: float) -> np.ndarray:
    """Return sRGB-encoded values 0..1 of linear radiance, any shape: exposed by `exposure` stops, filmic, sRGB."""
    return srgb(filmic(np.asarray(radiance, np.float32) * np.float32(2.0**exposure)))


def exposure_of(radiance: np.ndarray, reflectance: np.ndarray | float = MID_GREY) -> float:
    """Return the automatic exposure in stops for (H, W, 3) `radiance` of surfaces with `reflectance`, (H, W) or a number; 0 if
    all dark."""
    return automatic_exposure(*metered(radiance, reflectance))


def metered(radiance: np.ndarray, reflectance: np.ndarray | float) -> tuple[float, float]:
    """Return the sum of log₂ luminances of lit pixels, divided by their reflectance, and the number of lit pixels."""
    luminance = radiance @ LUMINANCE / np.maximum(reflectance, np.float32(DARKEST))
    logs = np.log2(luminance[luminance > 0.0].astype(float))
    return float(logs.sum()), float(logs.size)


def automatic_exposure(total: float, lit: float, unshadowed: float = 0.0) -> float:
    """Return the stops that map mid grey in the picture's mean light to mid grey; 0 without a lit pixel.

    total, lit: from `metered`. Light is metered, not reflectance: white rooms are white, dark ones dark. The mean is geometric,
    so that a few bright pixels count little, and rounded, so that tiles agree. unshadowed: W/(m² sr), luminance of a white
    surface that no shadow falls on. A picture with less than _DARK of `unshadowed` shows a sealed room, and gets darker with its
    light.
    """
    if not lit:
        return 0.0
    mean = 2.0 ** (total / lit)
    if mean < unshadowed:
        mean = min(mean + (_DARK * unshadowed) ** 2 / mean, unshadowed)
    return round(-math.log2(mean), 4)


def viridis(t: np.ndarray) -> np.ndarray:
    """Return display colours (..., 3) 0..1 of numbers of any shape: dark blue at 0, yellow at 1, clamped."""
    t = np.clip(t, 0.0, 1.0)[..., None]
    colour = np.zeros((*t.shape[:-1], 3))
    for coefficient in _VIRIDIS[::-1]:  # Horner
        colour = colour * t + coefficient
    return np.clip(colour, 0.0, 1.0)


def error_colours(share: np.ndarray) -> np.ndarray:
    """Return display colours (..., 3) in 0..1 of errors (...) as shares of FULL: white at 0, BRIGHT from 1, DARK to -1."""
    share = np.asarray(share)[..., None]
    end = np.where(share > 0.0, np.array(BRIGHT) / 255.0, np.array(DARK) / 255.0)
    return np.asarray(1.0 + np.clip(np.abs(share), 0.0, 1.0) * (end - 1.0))


def heat(values: np.ndarray, seen: np.ndarray | None = None) -> np.ndarray:
    """Return (H, W, 3) display colours of (H, W) scalars, by viridis from the 1st to the 99th percentile.

    seen: (H, W) bool, the pixels to colour (non-finite values never are); all others are black.
    """
    seen = np.isfinite(values) if seen is None else seen & np.isfinite(values)
    if not seen.any():
        return np.zeros((*values.shape, 3))
    low, middle, high = np.percentile(values[seen], (1, 50, 99))
    values = np.where(seen, values, values[seen][0])
    if low >= 0.0 and high > 10.0 * middle > 0.0:  # a long tail, such as the weights': a logarithm shows more
        values, low, high = (np.log(some + middle) for some in (values, low, high))
    return np.where(seen[..., None], viridis((values - low) / ((high - low) or 1.0)), 0.0)


def show(name: str, values: np.ndarray, exposure: float, seen: np.ndarray) -> np.ndarray:
    """Return the buffer `name` of buffers.CHANNELS as an (H, W, 3) display image in 0..1.

    values: (H, W) or (H, W, 3). exposure: the picture's, in stops. seen: (H, W) bool, pixels with a surface.
    """
    way = CHANNELS[name].show
    if way == "radiance":
        # irradiance is shown as radiance of a white diffuse surface, to compare with the picture
        return tonemap(values / np.float32(np.pi) if name == "irradiance" else values, exposure)
    if way == "heat":
        return heat(values, seen)
    if way == "unit":
        encoded = srgb(values)
        return encoded if values.ndim == 3 else np.repeat(encoded[..., None], 3, axis=-1)
    if way == "signed":
        return np.where(seen[..., None], np.clip(0.5 * values + 0.5, 0.0, 1.0), 0.0)
    assert way == "range", way
    if not seen.any():
        return np.zeros(values.shape)
    low, high = values[seen].min(axis=0), values[seen].max(axis=0)
    return np.where(seen[..., None], np.clip((values - low) / np.where(high > low, high - low, 1.0), 0.0, 1.0), 0.0)
