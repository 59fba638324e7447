"""Light between surfaces: which sites see which, and what N bounces bring, by plain sums."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

CONVERGED = 0.01  # of E: with all bounces wanted, no more are summed where less than this share is still to come


class Transport:
    """The operator F of S sites: E_(k+1) = E_1 + F·E_k, a matrix (3, S, S) for red, green and blue.

    F has a row for each site that gathers: which sites light what its rays hit, times the reflectance there. So it depends on
    geometry and materials alone. known: (S,) the rows that are filled.
    """

    def __init__(self, sites: int) -> None:
        self.matrix = np.zeros((3, sites, sites), np.float32)
        self.known = np.zeros(sites, bool)

    def fill(self, rows: np.ndarray, share: np.ndarray, hits: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        """Fill `rows` (N,) by what their rays hit, as TraceGather.hits has it: (N, R, 3) each of sites, weights and reflectance.

        share: (N, R) cosθ·dω of each ray; a hit that receives E sends out ρ/π·E.
        """
        sites, weights, albedo = hits
        count, size = len(rows), self.matrix.shape[1]
        place = (np.arange(count)[:, None, None] * size + sites).ravel()
        weights = weights * (share / np.pi)[..., None]
        for channel, matrix in enumerate(self.matrix):
            sums = np.bincount(place, weights=(weights * albedo[..., channel, None]).ravel(), minlength=count * size)
            matrix[rows] = sums.reshape(count, size)
        self.known[rows] = True

    def __call__(self, E: np.ndarray) -> np.ndarray:
        """F·E of (S, 3): one more bounce."""
        return np.stack([matrix @ E[:, channel] for channel, matrix in enumerate(self.matrix)], axis=1)


@dataclass(frozen=True)
class BouncedLight:
    """The irradiance E (S, 3) at sites, W/m², after all of `bounces` but the last, which a gather from the sites adds.

    remaining: about the share of E that further bounces would add, in the channel that lacks most; None where that is not known.
    Where all bounces are wanted and less than CONVERGED remains, E includes it, as if bounces went on fading as they did.
    complete: no more bounces follow.
    """

    irradiance: np.ndarray
    bounces: int
    remaining: float | None
    complete: bool

    @property
    def converged(self) -> bool:
        """Whether it is known that less than CONVERGED remains."""
        return self.remaining is not None and self.remaining < CONVERGED


def sum_bounces(
    E_1: np.ndarray, transport: Transport | None, area: np.ndarray, most: int, everything: bool
) -> Iterator[BouncedLight]:
    """E_(N−1) at the sites for N = 2, 3 and so on to `most` bounces, or with `everything` until less than CONVERGED remains.

    E_1: (S, 3) W/m². area: (S,) of the surface that each site stands for. transport: not needed for two bounces.
    """
    total = term = E_1.astype(np.float32)
    if transport is None:
        yield BouncedLight(total, 2, None, True)
        return
    for made in range(2, most + 1):
        after = transport(term)  # the bounce that a gather from `total` adds
        fade, remaining = _fading(total + after, term, after, area)
        if everything and remaining < CONVERGED:
            yield BouncedLight(total + after * np.float32(1.0 / (1.0 - fade)), made, remaining, True)
            return
        yield BouncedLight(total, made, remaining, made == most)
        total, term = total + after, after


def _fading(total: np.ndarray, before: np.ndarray, last: np.ndarray, area: np.ndarray) -> tuple[np.ndarray, float]:
    """The factor r (3,) by which bounces fade, and the share of the mean of E, `total` (S, 3), that follows its `last` term.

    r tends to the greatest eigenvalue of F, and what follows the last term is r/(1 − r) of it. While light has yet to reach the
    brighter corners, the ratio of the terms' means underestimates r, that of their root mean squares less so: the greater of the
    two counts.
    """
    weight, fade = area[:, None], np.zeros(3)
    for power in (1, 2):
        one, two = ((weight * x.astype(float) ** power).sum(0) ** (1.0 / power) for x in (before, last))
        fade = np.maximum(fade, two / np.maximum(one, 1e-300))
    mean, all_of_it = (weight * last.astype(float)).sum(0), (weight * total.astype(float)).sum(0)
    follows = np.divide(fade, 1.0 - fade, out=np.full(3, np.inf), where=fade < 1.0)
    share = np.divide(mean, all_of_it, out=np.zeros(3), where=all_of_it > 0.0)
    return fade, float((share * np.where(share > 0.0, follows, 0.0)).max())
