"""Light between surfaces: which sites see which, and what N bounces bring, by plain sums."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

CONVERGED = 0.01  # share of E that may be missing where the sum of all bounces ends
POCKETS = 0.05  # share of the lit sites that may miss more than CONVERGED
_DARK = 1e-6  # of the greatest irradiance: a site with less is dark, and does not decide whether bounces may end
_CLOSELY, _APART = 8, 4  # bounces: the rest is estimated after each of the first 8, then after every 4th, to save time


class Transport:
    """The operator F of S sites: E_(k+1) = E_1 + F·E_k, a sparse matrix (S, S) for each of red, green and blue.

    F has a row for each site that gathers, with an entry for each corner of the cell that each of its `rays` hits: which sites
    light what is there, times the reflectance. So it depends on geometry and materials alone. known: (S,) the rows that are
    filled.
    """

    def __init__(self, sites: int, rays: int) -> None:
        from scipy.sparse import csr_array  # takes a fifth of a second

        entries = 3 * rays
        self.known = np.zeros(sites, bool)
        self._columns = np.zeros((sites, entries), np.int32)
        self._values = [np.zeros((sites, entries), np.float32) for _ in range(3)]
        starts = np.arange(sites + 1, dtype=np.int32) * entries
        # they share these arrays, so that rows filled later are in them, too; columns that stand twice in a row are summed
        self.matrices = [
            csr_array((values.ravel(), self._columns.ravel(), starts), (sites, sites), copy=False) for values in self._values
        ]

    def fill(self, rows: np.ndarray, share: np.ndarray, hits: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        """Fill `rows` (N,) by what their rays hit, as TraceGather.hits has it: (N, R, 3) each of sites, weights and reflectance.

        share: (N, R) cosθ·dω of each ray, of which there may be fewer than the most; a hit that receives E sends out ρ/π·E.
        """
        sites, weights, albedo = hits
        count = 3 * sites.shape[1]
        self._columns[rows, :count] = sites.reshape(len(rows), -1)
        weights = weights * (share / np.pi)[..., None]
        for channel, values in enumerate(self._values):
            values[rows, :count] = (weights * albedo[..., channel, None]).reshape(len(rows), -1)
            values[rows, count:] = 0.0
        self.known[rows] = True

    def __call__(self, E: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
        """F·E of (S, 3): one more bounce; of these `rows` alone, (N, 3), where they are given."""
        parts = self.matrices if rows is None else [matrix[rows] for matrix in self.matrices]
        return np.stack([matrix @ E[:, channel] for channel, matrix in enumerate(parts)], axis=1)


@dataclass(frozen=True, eq=False)
class BouncedLight:
    """The irradiance E (S, 3) at sites, W/m², after all of `bounces` but the last, which a gather from the sites adds.

    remaining: about the share of E that further bounces would add, in the channel that lacks most, on all surfaces but those
    POCKETS that lack most; None where that is not known. It is the latest estimate.
    With all bounces, E includes the remaining light, as if bounces continued to fade at their rate, once less than CONVERGED
    remains. After the last of `most` bounces, the uncertainty of that extrapolation may be less than CONVERGED instead.
    complete: no more bounces follow.
    """

    irradiance: np.ndarray
    bounces: int
    remaining: float | None
    complete: bool

    @property
    def converged(self) -> bool:
        """True if the remainder is known to be less than CONVERGED."""
        return self.remaining is not None and self.remaining < CONVERGED


def sum_bounces(
    E_1: np.ndarray, transport: Transport | None, area: np.ndarray, most: int, everything: bool
) -> Iterator[BouncedLight]:
    """E_(N−1) at the sites for N = 2, 3 and so on to `most` bounces, or with `everything` until less than CONVERGED remains.

    E_1: (S, 3) W/m². area: (S,) of the surface that each site stands for. transport: not needed for two bounces.
    """
    total = term = E_1.astype(np.float32)
    remaining = former = None
    if transport is None:
        yield BouncedLight(total, 2, None, True)
        return
    for made in range(2, most + 1):
        after = transport(term)  # the bounce that a gather from `total` adds
        if made <= _CLOSELY or made % _APART == 0 or made == most:
            rest = _rest(term, after, area)
            whole = total + after + rest
            known = bool(np.isfinite(whole).all())
            remaining = _share(rest, total + after)
            if everything and made == most and known and former is not None:
                remaining = min(remaining, _share(_uncertainty(former, whole, term, after), whole))
            if everything and known and remaining < CONVERGED:
                yield BouncedLight(whole, made, remaining, True)
                return
            former = whole if known else None
        yield BouncedLight(total, made, remaining, made == most)
        total, term = total + after, after


def _rest(before: np.ndarray, last: np.ndarray, area: np.ndarray) -> np.ndarray:
    """(S, 3) about what follows the `last` bounce, where the one before it was `before`: each site's light continues to
    fade by r from bounce to bounce, which is r/(1 − r) of the last one (Aitken's extrapolation).

    While light spreads, a site's own r may be too small or too great. So it is at least their median, and at most the ratio of
    the terms' means or that of their root mean squares, which tend to the greatest eigenvalue of F: the first sees light that has
    yet to reach the brighter corners, the second those corners. It is infinite where light does not fade.
    """
    own = np.divide(last, before, out=np.where(last > 0.0, np.float32(np.inf), np.float32(0.0)), where=before > 0.0)
    rest = np.zeros_like(last)
    for channel, r in enumerate(own.T):
        one, two = before[:, channel].astype(float), last[:, channel].astype(float)
        one = np.where(two > 0.0, one, 0.0)  # the light of sites that see none, such as a roof's in the sun, is not passed on
        sums = [(_total(area, term), _total(area, term * term)) for term in (one, two)]
        most = max(sums[1][0] / max(sums[0][0], 1e-300), np.sqrt(sums[1][1] / max(sums[0][1], 1e-300)))
        order = np.argsort(r, kind="stable")
        lit = np.where(two > _DARK * two.max(initial=0.0), area, 0.0)
        median = r[order][np.searchsorted(np.cumsum(lit[order]), 0.5 * lit.sum()) :][:1]  # none of no sites
        fade = np.minimum(np.maximum(r, median), min(most, 1.0))
        rest[:, channel] = np.divide(two * fade, 1.0 - fade, out=np.full(len(r), np.inf), where=fade < 1.0)
    return np.where(last > 0.0, rest, np.float32(0.0))


def _uncertainty(former: np.ndarray, whole: np.ndarray, before: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Return (S, 3) about how far `whole`, the extrapolated sum of all bounces, is from its limit.

    former: the extrapolated sum _APART bounces before. The difference fades at the rate of the bounces from `before` to `last`.
    """
    rate = np.sqrt((last * last).sum(0, dtype=float) / np.maximum((before * before).sum(0, dtype=float), 1e-300)) ** _APART
    factor = np.divide(rate, 1.0 - rate, out=np.full(3, np.inf), where=rate < 1.0)
    error: np.ndarray = np.abs(whole - former) * np.maximum(factor, 1.0)
    return error


def _share(rest: np.ndarray, total: np.ndarray) -> float:
    """Return the mean over the lit sites of the share of `total` (S, 3) that `rest` (S, 3) is, in its greatest channel.

    Each site counts by its own light, so that sunlight on a roof does not end the bounces in the room below. All sites count the
    same, since a lit ground is far larger than the house on it, and has far fewer sites for its area. The POCKETS of the sites
    with the greatest shares are left out: a closed white frame takes hundreds of bounces, and nobody sees it.
    """
    found = []
    for one, all_of_it in zip(rest.T, total.T, strict=True):
        share = np.minimum(np.divide(one, all_of_it, out=np.zeros(len(one)), where=all_of_it > 0.0), 1.0)
        order = np.argsort(share, kind="stable")
        lit = (all_of_it > _DARK * all_of_it.max(initial=0.0)).astype(float)
        kept = order[np.cumsum(lit[order]) - lit[order] < (1.0 - POCKETS) * lit.sum()]
        counted = float(lit[kept].sum())
        found.append(_total(lit[kept], share[kept]) / counted if counted > 0.0 else 0.0)
    return max(found)


def _total(area: np.ndarray, values: np.ndarray) -> float:
    """Σ area·values, both (S,). BLAS shares so little out to all processors, and waits for them: where others keep these busy, a
    thousand times as long."""
    return float(np.einsum("s,s->", area, values))
