"""Two maps of the sphere of directions: equirectangular, as in image files, and equal-area.

Directions are in the sky's axes: x east, y up, z south. North is -z, the view direction of a camera along -z.
"""

from __future__ import annotations

import numpy as np


def solid_angles(height: int, width: int) -> np.ndarray:
    """Return (height,) solid angles of a texel in each row of an equirectangular map, steradians."""
    return -np.diff(np.cos(np.linspace(0.0, np.pi, height + 1))) * (2.0 * np.pi / width)


def texel_directions(height: int, width: int, rows: np.ndarray | None = None) -> np.ndarray:
    """Return (rows, width, 3) unit directions of the texels of an equirectangular map, or of its `rows`.

    The top row surrounds the zenith, the middle column is north, and east is right of it.
    """
    polar = (np.arange(height) if rows is None else rows) + 0.5
    theta, azimuth = polar * (np.pi / height), ((np.arange(width) + 0.5) / width - 0.5) * (2.0 * np.pi)
    sine = np.sin(theta)[:, None]
    parts = sine * np.sin(azimuth), np.broadcast_to(np.cos(theta)[:, None], (len(theta), width)), -sine * np.cos(azimuth)
    return np.stack(parts, axis=-1)


def equirectangular(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions of unit directions (…, 3) in an equirectangular map: right and down, each (…,) in 0..1."""
    x, y, z = np.moveaxis(directions, -1, 0)
    return 0.5 + np.arctan2(x, -z) / (2.0 * np.pi), np.arccos(np.clip(y, -1.0, 1.0)) / np.pi


def square(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions of unit directions (…, 3) in the equal-area square, each (…,) in 0..1 (Clarberg 2008, "Fast Equal-Area
    Mapping of the (Hemi)Sphere using SIMD"). The zenith is its centre, the horizon a diamond, the nadir its corners."""
    x, up, z = np.abs(np.moveaxis(directions, -1, 0))
    r = np.sqrt(np.maximum(1.0 - up, 0.0))
    phi = np.arctan(np.minimum(x, z) / np.maximum(np.maximum(x, z), 1e-300)) * (2.0 / np.pi)
    phi = np.where(x < z, 1.0 - phi, phi)
    u, v = r - phi * r, phi * r
    below = directions[..., 1] < 0.0
    u, v = np.where(below, 1.0 - v, u), np.where(below, 1.0 - u, v)
    return 0.5 + 0.5 * np.copysign(u, directions[..., 0]), 0.5 + 0.5 * np.copysign(v, directions[..., 2])


def from_square(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return (…, 3) unit directions at (u, v) in the equal-area square; the inverse of `square`."""
    u, v = 2.0 * u - 1.0, 2.0 * v - 1.0
    a, b = np.abs(u), np.abs(v)
    inside = 1.0 - (a + b)  # below 0 beyond the horizon
    r = 1.0 - np.abs(inside)
    phi = np.where(r > 0.0, (b - a) / np.where(r > 0.0, r, 1.0) + 1.0, 1.0) * (0.25 * np.pi)
    y = np.copysign(1.0 - r * r, inside)
    flat = r * np.sqrt(np.maximum(2.0 - r * r, 0.0))
    return np.stack([np.copysign(flat * np.cos(phi), u), y, np.copysign(flat * np.sin(phi), v)], axis=-1)


def bilinear(image: np.ndarray, u: np.ndarray, v: np.ndarray, wrap: bool) -> np.ndarray:
    """Return (…, C) bilinear values of an image (H, W, C) at (u, v), (…,) in 0..1; wrap: its columns repeat."""
    height, width = image.shape[:2]
    x, y = u * width - 0.5, v * height - 0.5
    left, top = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
    across, down = (x - left)[..., None], (y - top)[..., None]
    columns = [(left + i) % width if wrap else np.clip(left + i, 0, width - 1) for i in (0, 1)]
    upper, lower = (np.clip(top + i, 0, height - 1) for i in (0, 1))
    first = image[upper, columns[0]] * (1.0 - across) + image[upper, columns[1]] * across
    second = image[lower, columns[0]] * (1.0 - across) + image[lower, columns[1]] * across
    return np.asarray(first * (1.0 - down) + second * down)


def pyramid(image: np.ndarray, least: int = 2) -> list[np.ndarray]:
    """Return the image (H, W, C) and its coarser levels, means of 2×2 texels.

    Levels with an odd side and levels of less than `least` rows are not halved further.
    """
    levels = [image]
    while len(levels[-1]) >= least and levels[-1].shape[0] % 2 == levels[-1].shape[1] % 2 == 0:
        height, width, channels = levels[-1].shape
        levels.append(levels[-1].reshape(height // 2, 2, width // 2, 2, channels).mean((1, 3), dtype=np.float32))
    return levels


def trilinear(levels: list[np.ndarray], level: np.ndarray, u: np.ndarray, v: np.ndarray, wrap: bool) -> np.ndarray:
    """Return (…, C) trilinear values of a pyramid, like a mip-mapped texture: level (…,), 0 the finest."""
    level = np.clip(level, 0.0, len(levels) - 1.0)
    low = np.minimum(np.floor(level).astype(np.intp), len(levels) - 1)
    out = np.zeros((*np.shape(u), levels[0].shape[2]))
    for number, image in enumerate(levels):
        share = np.where(low == number, 1.0 - (level - low), np.where(low == number - 1, level - low, 0.0))
        some = share > 0.0
        if some.any():
            out[some] += share[some][:, None] * bilinear(image, u[some], v[some], wrap)
    return out
