"""Transport of light between surfaces: the sites that light each other, and the light of N bounces by sums."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.core.timing.background import Steps
from irrsplat.settings import Settings

CONVERGED = 0.01  # of E: share that may be missing where the sum of bounces ends; change by the last step of moving light
_DARK = 1e-6  # of the greatest irradiance: a site with less is dark, and does not decide whether bounces may end
_DECAYS = 0.999  # greatest ratio of successive bounces for an estimate of the rest


class Transport:
    """The operator F between S sites: E_(k+1) = E_1 + F·E_k, for each of red, green and blue.

    F has a row for each site with a gather, and in the row an entry for each of its `rays`: the site that lights the hit, times
    the reflectance. F depends only on geometry and materials. known: (S,) True for complete rows.
    """

    def __init__(self, sites: int, rays: int) -> None:
        self.known = np.zeros(sites, bool)
        self._columns = np.full((sites, rays), -1)  # -1: a ray without a hit, whose value is 0
        self._values = np.zeros((3, sites, rays), np.float32)

    def fill(self, rows: np.ndarray, site: np.ndarray, share: np.ndarray) -> None:
        """Fill `rows` (N,) by the hits of their R rays, possibly fewer than the most, see TraceGather.hits."""
        rays = site.shape[1]
        self._columns[rows, :rays], self._columns[rows, rays:] = site, -1
        for values, of_channel in zip(self._values, np.moveaxis(share, -1, 0), strict=True):
            values[rows, :rays], values[rows, rays:] = of_channel, 0.0
        self.known[rows] = True

    def hits(self) -> tuple[np.ndarray, ...]:
        """Return the ray (N,) of each hit that transports light, as its row and its number, its site and its mean value."""
        share = self._values.mean(0, dtype=float)
        row, ray = np.nonzero(share)
        return row, ray, self._columns[row, ray], share[row, ray]

    def repaint(self, before: np.ndarray, after: np.ndarray) -> None:
        """Change the reflectance at hits by that of the sites that light them, (S, 3) each.

        The share of a ray that hit a black surface is 1/R: strata have equal weights.
        """
        factor = np.divide(after, before, out=np.zeros_like(after), where=before > 0.0).T.copy()
        added = np.where(before > 0.0, 0.0, after / self._columns.shape[1]).T.astype(np.float32)
        for values, times, more in zip(self._values, factor, added, strict=True):
            values *= times[self._columns]
            if more.any():
                values += np.append(more, np.float32(0.0))[self._columns]

    def received(self, radiance: np.ndarray) -> np.ndarray:
        """Return (S, 3) the irradiance at sites by the `radiance` (S, 3) of the sites that light the hits of their rays."""
        return np.pi * np.stack([np.append(light, 0.0)[self._columns].mean(1) for light in radiance.T], axis=1)

    def __call__(self, E: np.ndarray, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return F·E of E (S, 3): one more bounce; (N, 3) for the given `rows`."""
        columns = self._columns[rows]
        channels = zip(self._values, np.ascontiguousarray(E.T, np.float32), strict=True)
        return np.stack([np.einsum("sr,sr->s", values[rows], light.take(columns)) for values, light in channels], axis=1)

    def backward(self, importance: np.ndarray) -> np.ndarray:
        """Return (S,) Fᵀ·importance, the mean of all channels: how much each site contributes to sites of this importance."""
        weights = self._values.mean(0) * importance[:, None]
        return np.bincount(self._columns.ravel() + 1, weights.ravel(), minlength=len(importance) + 1)[1:]


@dataclass(frozen=True, eq=False)
class BouncedLight:
    """The irradiance E (S, 3) at sites, W/m², after all of `bounces` but the last, which a gather adds.

    converged: True if E includes an estimate of the light of all further bounces, with an error below CONVERGED.
    """

    irradiance: np.ndarray
    bounces: int
    converged: bool = False


def sum_bounces(E_1: np.ndarray, transport: Transport | None, settings: Settings) -> Steps[BouncedLight]:
    """Return E_(N−1) at the sites for the N bounces of the settings. Pause after each bounce.

    For all bounces, add an estimate of the light of further ones, and end at the first N with an estimate below CONVERGED. Each
    site's light continues to fade by r from bounce to bounce, which is r/(1 − r) of the last one (Aitken's extrapolation). While
    light spreads, a site's own r may be too great. The greatest row sums of F bound all its eigenvalues, and r.

    E_1: (S, 3) W/m². transport: not needed for two bounces.
    """
    total = term = E_1.astype(np.float32)
    made, most, everything = 2, settings.most_bounces, settings.bounces == "all"
    if transport is None or most == made:
        return BouncedLight(total, made)
    slowest = np.minimum(transport(np.ones_like(total)).max(0, initial=0.0), _DECAYS) if everything else np.zeros(3)
    while True:
        after = transport(term)  # the bounce that a gather from `total` adds
        r = np.divide(after, term, out=np.broadcast_to(slowest, after.shape).astype(np.float32), where=term > 0.0)
        r = np.minimum(r, slowest)
        remainder = (after * r / (1.0 - r)).astype(np.float32)
        whole = total + after + remainder
        if everything and _share(remainder, whole) < CONVERGED:
            return BouncedLight(whole, made, converged=True)
        if made == most:
            if everything and slowest.max() < _DECAYS:
                greatest = (after * (slowest / (1.0 - slowest))).astype(np.float32)
                return BouncedLight(whole, made, converged=_share(greatest - remainder, whole) < CONVERGED)
            return BouncedLight(total, made)
        yield
        total, term, made = total + after, after, made + 1


def _share(remainder: np.ndarray, total: np.ndarray) -> float:
    """Return the mean over the lit sites of the share of `total` (S, 3) that `remainder` (S, 3) is, in the channel of most.

    Each site counts by its own light, so that sunlight on a roof does not end the bounces in the room below. All sites count the
    same: a lit ground is far larger than the house on it, and has far fewer sites for its area.
    """
    share = np.divide(remainder, total, out=np.zeros_like(total), where=total > 0.0)
    lit = total > _DARK * total.max(0, initial=0.0)
    return float(((lit * share).sum(0) / np.maximum(lit.sum(0), 1)).max())
