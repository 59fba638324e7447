"""Measures of what the eye sees as blemishes: an RMSE counts a spot by its size and strength, not by how it stands out."""

from __future__ import annotations

import numpy as np

from irrsplat.core.color import LUMINANCE

OFF = 0.2  # of the local truth: a pixel that is off by more is a spot
_AROUND = 9  # pixels: the side of the square whose mean is the local truth
_FINE = 6.0  # pixels: sigma of the Gaussian below which an error is fine


def spots(E: np.ndarray, E_ref: np.ndarray, valid: np.ndarray) -> float | None:
    """The share of the valid pixels where the luminance of E is off by more than OFF of the local truth, the mean of the truth's
    luminance over the valid ones of the 9×9 pixels around; None where the truth is dark everywhere.

    E, E_ref: (H, W, 3) irradiance in W/m². valid: (H, W) bool, at least one pixel.
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


def fine(error: np.ndarray, valid: np.ndarray) -> float:
    """√mean of the squares of the error's fine part: the error without its mean over the valid pixels around, weighted by a
    Gaussian of 6 pixels. In the error's own unit.

    error: (H, W, 3). valid: (H, W) bool, at least one pixel.
    """
    from scipy import ndimage

    def blurred(values: np.ndarray) -> np.ndarray:
        sigma = (_FINE, _FINE, *(0.0 for _ in values.shape[2:]))
        found: np.ndarray = ndimage.gaussian_filter(values, sigma, mode="constant")
        return found

    known = np.where(valid[..., None], error, 0.0).astype(float)
    coarse = blurred(known)[valid] / blurred(valid.astype(float))[valid][:, None]
    return float(np.sqrt(np.mean((known[valid] - coarse) ** 2)))
