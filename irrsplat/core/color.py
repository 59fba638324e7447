"""Colours as files write them, turned into linear reflectance."""

from __future__ import annotations

from typing import Any

import numpy as np


def linear_from_srgb(values: np.ndarray) -> np.ndarray:
    """Linear values for sRGB ones in 0..1 (IEC 61966-2-1), of any shape."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def clip_color(values: Any) -> tuple[float, float, float]:
    """Three finite values, each clipped to 0..1."""
    r, g, b = np.clip(np.nan_to_num(np.asarray(values, float)), 0.0, 1.0).tolist()
    return r, g, b


def mean_color(image: Any) -> np.ndarray:
    """(3,) the mean of a Pillow image in linear light, of at most 256 x 256 samples of it; transparency is left out."""
    rgb = image.convert("RGB")
    step = max(1, max(rgb.size) // 256)
    return linear_from_srgb(np.asarray(rgb)[::step, ::step] / 255.0).mean(axis=(0, 1))


MID_GREY = 0.18
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # Rec. 709


def srgb(linear: np.ndarray) -> np.ndarray:
    """Linear 0..1 as sRGB-encoded 0..1 (IEC 61966-2-1), any shape, clipped."""
    x = np.clip(linear, 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1 / 2.4) - 0.055)
