"""Downscaling of images in linear light, so that a texel is the mean reflectance of the area it covers."""

from __future__ import annotations

import numpy as np

from irrsplat.core.color import linear_from_srgb, srgb

_CHUNK_PIXELS = 1 << 16  # pixels that are decoded together; they fit the processor's cache
_CHUNK_ROWS = 32  # rows of pixels that are processed together by `half`, for the same reason
_LINEAR_STEPS = 65535  # linear values between 0 and 1: resolves the darkest sRGB colours
_BYTES = np.arange(256) / 255.0
_LINEAR_OF_BYTE = (_BYTES * _LINEAR_STEPS).round().astype("u4")
_BYTE = (np.arange(_LINEAR_STEPS + 1) / _LINEAR_STEPS * 255.0).round().astype("u1")
_DECODE = (linear_from_srgb(_BYTES) * _LINEAR_STEPS).round().astype("u4")
_ENCODE = (srgb(np.arange(_LINEAR_STEPS + 1) / _LINEAR_STEPS) * 255.0).round().astype("u1")
COLOR, _ALPHA = linear_from_srgb(_BYTES).astype(np.float32), _BYTES.astype(np.float32)  # linear values of the bytes of a pixel


def area_means(pixels: np.ndarray, side: int, weighted: bool) -> np.ndarray:
    """Return (side, side, 4) float32, linear: means over equal rectangles of an image of sRGB pixels (H, W, 4) uint8 with alpha.

    weighted: colours are weighted by alpha; they are black where the total is 0.
    """
    height, width = pixels.shape[:2]
    down = _weights(height, side)
    out = np.empty((side, side, 8 if weighted else 4), np.float32)
    step = max(_CHUNK_PIXELS * side // max(width * height, 1), 1)
    for start in range(0, side, step):
        rows = down[start : start + step]
        used = np.flatnonzero(rows.any(0))
        part = pixels[used[0] : used[-1] + 1]
        values = np.take(COLOR, part, mode="clip")
        values[..., 3] = np.take(_ALPHA, part[..., 3], mode="clip")
        if weighted:
            values = np.concatenate([values, values * values[..., 3:4]], axis=-1)
        thin = np.einsum("rh,hv->rv", rows[:, used[0] : used[-1] + 1], values.reshape(len(part), -1))
        out[start : start + step] = _means_across(thin.reshape(len(rows), width, -1), side)
    if not weighted:
        return out
    alpha = out[..., 3:4]
    colour = np.divide(out[..., 4:7], alpha, out=np.zeros_like(out[..., :3]), where=alpha > 1e-6)
    return np.concatenate([colour, alpha], axis=-1)


def sums_of_four(values: np.ndarray) -> np.ndarray:
    """Return (⌈H/2⌉, ⌈W/2⌉, C) the sums over 2×2 pixels of an image (H, W, C); an odd last row or column counts twice."""
    height, width = values.shape[:2]
    if height % 2 or width % 2:
        values = np.pad(values, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    rows = values[::2] + values[1::2]
    return np.asarray(rows[:, ::2] + rows[:, 1::2])


def half(pixels: np.ndarray, srgb_encoded: bool) -> np.ndarray:
    """Return (⌈H/2⌉, ⌈W/2⌉, 4) uint8: means of 2×2 pixels (H, W, 4) uint8, in linear light if `srgb_encoded`."""
    height, width = pixels.shape[:2]
    out = np.empty(((height + 1) // 2, (width + 1) // 2, 4), "u1")
    for row in range(0, height, _CHUNK_ROWS):
        band = pixels[row : row + _CHUNK_ROWS]
        values = np.take(_DECODE if srgb_encoded else _LINEAR_OF_BYTE, band, mode="clip")
        values[..., 3] = np.take(_LINEAR_OF_BYTE, band[..., 3], mode="clip")
        means = sums_of_four(values) // 4
        half_band = out[row // 2 : (row + _CHUNK_ROWS) // 2]
        half_band[:] = np.take(_ENCODE if srgb_encoded else _BYTE, means, mode="clip")
        half_band[..., 3] = _BYTE[means[..., 3]]
    return out


def coverage(alpha: np.ndarray, side: int, cutoff: float) -> np.ndarray:
    """Return (side, side) float32: the share of pixels in each of equal rectangles of `alpha` (H, W) uint8 that reach `cutoff`,
    0..1."""
    seen = (alpha >= cutoff * 255.0).astype(np.float32)
    return _means_across((_weights(len(alpha), side) @ seen)[..., None], side)[..., 0]


def _weights(count: int, side: int) -> np.ndarray:
    """Return (side, count) float32: the share of each of `count` pixels in each of `side` equal parts of a row; rows sum to 1."""
    edges = np.arange(side + 1) * (count / side)
    at = np.arange(count)
    share = np.minimum(edges[1:, None], at + 1.0) - np.maximum(edges[:-1, None], at)
    return np.asarray((np.maximum(share, 0.0) * (side / count)).astype(np.float32))


def _means_across(values: np.ndarray, side: int) -> np.ndarray:
    """Return (R, side, C) the means over `side` equal parts of each of R rows of pixels (R, W, C)."""
    rows, width, channels = values.shape
    if width % side == 0:
        grouped: np.ndarray = np.einsum("rskc->rsc", values.reshape(rows, side, width // side, channels))
        return grouped * np.float32(side / width)
    edges = np.arange(side + 1) * (width / side)
    first, means = edges[:-1].astype(np.intp), np.zeros((rows, side, channels), np.float32)
    for more in range(-(-width // side) + 1):  # pixels that a part may overlap
        pixel = first + more
        share = np.minimum(edges[1:], pixel + 1.0) - np.maximum(edges[:-1], pixel)
        weights = (np.clip(share, 0.0, 1.0) * (side / width)).astype(np.float32)
        means += weights[:, None] * np.take(values, np.minimum(pixel, width - 1), axis=1)
    return means
