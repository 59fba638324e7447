"""Light that goes on from surface to surface: which sites see which, and what N bounces bring, by plain sums."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

REST = 0.01  # of E: `all` bounces are made where less is still to come


class Transport:
    """F of S sites: E_(k+1) = E_1 + F·E_k, for each channel. F has a row for each site that gathers; what its rays hit, with the
    hits' reflectance, is its content, so that it depends on geometry and materials alone."""

    def __init__(self, sites: int) -> None:
        self.matrix = np.zeros((3, sites, sites), np.float32)

    def fill(self, rows: np.ndarray, share: np.ndarray, hits: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        """Rows (N,) from what their rays hit, as TraceGather.hits has it: sites and weights (N, R, 3), reflectance (N, R, 3).

        share: (N, R) cosθ·dω of each ray; a hit that receives E sends out ρ/π·E.
        """
        sites, weights, albedo = hits
        count, size = len(rows), self.matrix.shape[1]
        place = (np.arange(count)[:, None, None] * size + sites).ravel()
        weights = weights * (share / np.pi)[..., None]
        for channel, matrix in enumerate(self.matrix):
            sums = np.bincount(place, weights=(weights * albedo[..., channel, None]).ravel(), minlength=count * size)
            matrix[rows] = sums.reshape(count, size)

    def __call__(self, E: np.ndarray) -> np.ndarray:
        """F·E of (S, 3): one more bounce."""
        return np.stack([matrix @ E[:, channel] for channel, matrix in enumerate(self.matrix)], axis=1)


@dataclass(frozen=True)
class Bounced:
    """E (S, 3) of all of so many `bounces` but the last, which those add that gather from it; `whole`: no more are made.

    rest: the share of E that is still to come, about, of the channel that lacks most (None: not known). Where all bounces are
    wanted and it is less than REST, E has it already, by what it comes to if it goes on fading as it did.
    """

    irradiance: np.ndarray
    bounces: int
    rest: float | None
    whole: bool

    @property
    def settled(self) -> bool:
        """Whether it is known that less than REST is still to come."""
        return self.rest is not None and self.rest < REST


def bounces(E_1: np.ndarray, transport: Transport | None, area: np.ndarray, most: int, everything: bool) -> Iterator[Bounced]:
    """E_(N−1) at the sites for N = 2, 3 and so on, to N = `most`, or with `everything` until less than REST is still to come.

    E_1: (S, 3) W/m². area: (S,) of the surface that each site stands for. transport: not needed for two bounces.
    """
    total = term = E_1.astype(np.float32)
    if transport is None:
        yield Bounced(total, 2, None, True)
        return
    for made in range(2, most + 1):
        after = transport(term)  # the bounce that those who gather from `total` add themselves
        fade, rest = _fading(total + after, term, after, area)
        if everything and rest < REST:
            yield Bounced(total + after * np.float32(1.0 / (1.0 - fade)), made, rest, True)
            return
        yield Bounced(total, made, rest, made == most)
        total, term = total + after, after


def _fading(total: np.ndarray, before: np.ndarray, last: np.ndarray, area: np.ndarray) -> tuple[np.ndarray, float]:
    """By what factor r the bounces fade (3,), and the share of the mean of E, `total` (S, 3), that comes after its `last` term.

    The factor tends to the greatest eigenvalue of F; what follows the last term is r/(1 − r) of it. In the mean r may seem less
    for a while, where light has yet to find the brighter corners; by the root of the squares less so: the greater counts.
    """
    weight, fade = area[:, None], np.zeros(3)
    for power in (1, 2):
        one, two = ((weight * x.astype(float) ** power).sum(0) ** (1.0 / power) for x in (before, last))
        fade = np.maximum(fade, two / np.maximum(one, 1e-300))
    mean, all_of_it = (weight * last.astype(float)).sum(0), (weight * total.astype(float)).sum(0)
    follows = np.divide(fade, 1.0 - fade, out=np.full(3, np.inf), where=fade < 1.0)
    share = np.divide(mean, all_of_it, out=np.zeros(3), where=all_of_it > 0.0)
    return fade, float((share * np.where(share > 0.0, follows, 0.0)).max())
