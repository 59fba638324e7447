"""Stratified hemisphere sampling with equal cosθ·dω: M elevations by N azimuths, E = π/(MN)·ΣL.

A cell has a row for each elevation, from the zenith down, and a column for each azimuth. The tables have the layout of those in
plane.py, so that one reduction sums both gathers.
"""

from __future__ import annotations

import numpy as np

from irrsplat.core.glsl import GOLDEN, NEIGHBOUR_STRIDE, SQUARE_STEPS

LEAST_SIDE = 4  # side² rays of the coarsest gather


def shape(side: int) -> tuple[int, int]:
    """Return the elevations M and azimuths N of side² rays: N = 4·M, near π·M, for strata about as wide as high (Ward and
    Heckbert 1992)."""
    return side // 2, 2 * side


def _edges(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return θ (M + 1,) and φ (N + 1,) in radians at the borders of strata: equal steps in sin²θ and in φ."""
    m, n = shape(side)
    return np.arcsin(np.sqrt(np.arange(m + 1) / m)), 2.0 * np.pi * np.arange(n + 1) / n


def _directions(square: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Return (..., 3) unit directions at these sin²θ and φ in radians."""
    sine = np.sqrt(square)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.sqrt(1.0 - square)], axis=-1)


def ray_directions(side: int) -> np.ndarray:
    """Return (M·N, 3) float64: a direction within each stratum, in a record's frame.

    The places within strata are evenly spaced along each elevation, in random order. The middles of strata would alias with fine
    regular openings, such as blinds. SkyShares chooses strata by their neighbours' rays: a dependence between neighbours, as in a
    low-discrepancy sequence, would bias the share. The strata around the normal meet there, so that only their heights matter;
    these advance by the golden ratio.
    """
    m, n = shape(side)
    row, column = np.indices((m, n))
    along, across = (np.random.default_rng(0).permuted(np.tile(np.arange(n), (2, m, 1)), axis=-1) + 0.5) / n
    along = np.where(row == 0, np.modf((column + 0.5) * GOLDEN)[0], along)
    return _directions((row + along) / m, 2.0 * np.pi * (column + across) / n).reshape(-1, 3)


def site_directions(side: int) -> np.ndarray:
    """Return (M·N, 3) float64: directions as from `ray_directions`, but through the middle of each stratum in φ.

    Sites have many places, so that these directions do not alias. The heights in sin²θ advance by the golden ratio: through the
    middles of strata at the horizon, no ray would reach far along a corridor, whose dark end lost a tenth of its light.
    """
    m, n = shape(side)
    row, column = np.indices((m, n))
    height = np.modf((column + 0.5 * row + 0.5) * GOLDEN)[0]
    return _directions((row + height) / m, 2.0 * np.pi * (column + 0.5) / n).reshape(-1, 3)


def closer_rays(side: int, count: int) -> np.ndarray:
    """Return (M, N, count, 3) float64: further directions into each stratum, with heights spread evenly in sin²θ.

    Their azimuths, and the shifts of both from stratum to stratum, are low-discrepancy sequences (Roberts 2018).
    """
    m, n = shape(side)
    row, column, ray = np.indices((m, n, count))
    number = row * n + column
    along, across = SQUARE_STEPS
    square = (row + (ray + np.modf(number * along)[0]) / count) / m
    azimuth = 2.0 * np.pi * (column + np.modf(ray * GOLDEN + number * across)[0]) / n
    return _directions(square, azimuth)


def reach(side: int, least: int) -> np.ndarray:
    """Return (M,) the number of strata along each elevation that are as wide as it is high, from `least` to less than half."""
    m, n = shape(side)
    return np.asarray(np.clip((m / (np.pi * (np.arange(m) + 0.5)) + 0.5).astype(int), least, n // 2 - 1))


def stratum_table(side: int) -> np.ndarray:
    """Return (M, N, 4) float64: each stratum's mean direction in the record's frame, unit, and its cosθ·dω, π/(MN).

    The direction is that of ∫ω·dω over the stratum, as in plane_table: ∫sin²θ dθ = (θ - sinθ·cosθ)/2 along the surface,
    ∫sinθ·cosθ dθ = sin²θ/2 along the normal. A ray has another direction within the stratum.
    """
    theta, phi = _edges(side)
    table = np.empty((len(theta) - 1, len(phi) - 1, 4))
    along = np.diff(0.5 * (theta - np.sin(theta) * np.cos(theta)))[:, None]
    table[..., 0] = along * np.diff(np.sin(phi))
    table[..., 1] = along * -np.diff(np.cos(phi))
    table[..., 2] = table[..., 3] = np.pi / table[..., 0].size
    table[..., :3] /= np.linalg.norm(table[..., :3], axis=-1, keepdims=True)
    return table


def stratum_edges(side: int) -> np.ndarray:
    """Return (M, 2N, 4) float64: at (y, 2x + j) stratum (x, y)'s edge to the next azimuth (j = 0) or elevation (j = 1).

    In the form of plane.plane_edges, with which ∇E = Σ (L_b - L_a)·xyz/min(r_a, r_b) is the translation gradient of Ward
    and Heckbert (1992), equation 3: along û_k, the azimuth's middle, cos²θ·sinθ·2π/N for an edge between elevations, and along
    v̂_k, an edge's own azimuth turned by a right angle, the difference of sinθ between its ends. xyz is ∫cosθ·m dl with m
    across the edge, which includes the part along the normal: -sin²θ·cosθ·2π/N.
    """
    theta, phi = _edges(side)
    m, n = len(theta) - 1, len(phi) - 1
    y, x = np.indices((m, n))
    middle, after = 0.5 * (phi[:-1] + phi[1:]), phi[1:]
    out = np.zeros((m, n, 2, 4))
    out[:, :, 0, :2] = np.diff(np.sin(theta))[:, None, None] * np.stack([-np.sin(after), np.cos(after)], axis=-1)
    out[:, :, 0, 3] = NEIGHBOUR_STRIDE * y + (x + 1) % n
    s, c = np.sin(theta[1:-1])[:, None], np.cos(theta[1:-1])[:, None]
    ring = np.stack(np.broadcast_arrays(c * c * s * np.cos(middle), c * c * s * np.sin(middle), -s * s * c), axis=-1)
    out[:-1, :, 1, :3] = 2.0 * np.pi / n * ring
    out[:, :, 1, 3] = NEIGHBOUR_STRIDE * np.minimum(y + 1, m - 1) + x  # none beyond the last elevation, at the horizon
    return out.reshape(m, 2 * n, 4)
