"""A measure of visible blemishes: an RMSE weighs a spot by size and strength, not by its visibility."""

from __future__ import annotations

import numpy as np

from irrsplat.core.color import LUMINANCE

OFF = 0.2  # of the local reference: a pixel with a larger error is a spot
_AROUND = 9  # pixels: side of the square whose mean is the local reference


def spots(E: np.ndarray, E_ref: np.ndarray, valid: np.ndarray) -> float | None:
    """Return the share of valid pixels whose luminance error exceeds OFF of the local reference; None for a dark reference.

    The local reference is the mean of the reference's luminance over the valid pixels of the 9×9 pixels around. E, E_ref: (H, W,
    3) irradiance in W/m². valid: (H, W) bool, at least one pixel.
    """
    from scipy import ndimage

    Y, Y_ref = (one.astype(float) @ LUMINANCE.astype(float) for one in (E, E_ref))
    if not Y_ref[valid].any():
        return None

    def square(values: np.ndarray) -> np.ndarray:
        found: np.ndarray = ndimage.uniform_filter(values, _AROUND, mode="constant")
        return found

    local = square(np.where(valid, Y_ref, 0.0))[valid] / square(valid.astype(float))[valid]
    return float(np.mean(np.abs(Y - Y_ref)[valid] > OFF * local))
