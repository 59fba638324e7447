"""Error estimate of a picture by reference gathers at random pixels (docs/METHOD.md, 8.3).

The estimate needs no model of the error: importance sampling draws pixels of large estimated variance more often. Each test
gathers along as many rays as the records around it. Some tests are gathered again along four times as many rays. The difference
separates the noise of the tests, and shows if records need more rays.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from irrsplat.core.buffers import Sites
from irrsplat.core.color import LUMINANCE
from irrsplat.indirect.paper_scan import Seen

CHECKS = 384  # pixels under test for the error estimate
_AGAIN = 4  # of so many of them one is gathered again, with four times as many rays
_KEPT = 0.5  # weight of the sums of earlier steps
_LEAST = 0.4  # of the squared difference of picture and tests: least squared error, since one test in a dark place may dominate
_BLUR = 0.005  # of the image's height: radius over which inter-record variance is averaged
GAIN = 6.0  # times less is a gather's own squared error where its side is doubled


def blur_of(height: int) -> float:
    """Return the radius over which inter-record variance is averaged in an image of this height, both in pixels."""
    return max(_BLUR * height, 1.0)


@dataclass(frozen=True, eq=False)
class Check:
    """N pixels under test.

    shown: (N, 3) E of the picture, W/m². drawn_by: (N,) estimated variance by which each pixel was drawn. uncertainty: (H, W)
    this variance at all pixels. mean_uncertainty, mean: means of variance and E over the pixels of the error. coarse: (N, 3) E
    of the tests. fine: (K, 3) E of the repeated tests, with four times as many rays. Both are empty at first.
    """

    sites: Sites
    shown: np.ndarray
    drawn_by: np.ndarray
    uncertainty: np.ndarray
    mean_uncertainty: float
    mean: float
    coarse: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    fine: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def again(self) -> np.ndarray:
        """The indices (K,) of the tests that are gathered again."""
        return np.arange(0, len(self.sites), _AGAIN)


class ErrorSums(NamedTuple):
    """Sums of the results of tests, in which earlier steps have less weight.

    errors, tests: squared differences between picture and tests, divided by the variance by which the pixels were drawn, and
    their number. For repeated tests: excess, the decrease of these differences with four times as many rays; rays, the squared
    differences of both gathers; repeated, their number.
    """

    errors: float = 0.0
    tests: float = 0.0
    excess: float = 0.0
    rays: float = 0.0
    repeated: float = 0.0

    def including(self, check: Check) -> ErrorSums:
        """Return the sums with further tests."""
        again, uncertainty = check.again, check.drawn_by[check.again]
        errors = squares(check.shown, check.coarse) / check.drawn_by
        excess = errors[again] - squares(check.shown[again], check.fine) / uncertainty
        rays = squares(check.coarse[again], check.fine) / uncertainty
        sums = errors.sum(), len(errors), excess.sum(), rays.sum(), len(again)
        return ErrorSums(*(_KEPT * old + float(new) for old, new in zip(self, sums, strict=True)))

    @property
    def ratio(self) -> float:
        """The mean squared error over the mean estimated variance."""
        mean = self.errors / max(self.tests, 1.0)
        return max(mean - self.excess / max(self.repeated, 1.0), _LEAST * mean)

    @property
    def ray_ratio(self) -> float:
        """The mean squared error by the number of rays, over the mean estimated variance."""
        return self.rays / max(self.repeated, 1.0)


def squares(values: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return (N,) the squared differences of (N, 3), mean over channels."""
    return np.asarray(((values.astype(float) - others) ** 2).mean(1))


def drawn(seen: Seen, sums: np.ndarray, weight: np.ndarray, seed: tuple[int, ...], off: float) -> Check:
    """Return CHECKS of the smooth pixels, as the error leaves out edges. sums, weight: of the splat buffer.

    Pixels are drawn in proportion to their uncertainty: the variance of the records there, averaged over the pixels around, plus
    its mean. off: see Seen.smooth.
    """
    from scipy import ndimage

    sums, weight = sums.astype(float), weight.astype(float)
    k = np.maximum(sums[..., 3], 1e-20)
    variance = np.where(seen.mask, np.maximum(weight[..., 1] / k - ((sums[..., :3] @ LUMINANCE) / k) ** 2, 0.0), 0.0)
    sigma = blur_of(len(variance))
    share = ndimage.gaussian_filter(seen.mask.astype(float), sigma)
    uncertainty = np.where(seen.mask, ndimage.gaussian_filter(variance, sigma) / np.maximum(share, 1e-6), 0.0)
    uncertainty += seen.mask * (float(uncertainty[seen.mask].mean()) + 1e-20)
    smooth = seen.smooth(off)
    counting = smooth if smooth.any() else seen.mask
    random, candidates = np.random.default_rng(seed), np.flatnonzero(counting)
    sum_to = np.cumsum(uncertainty.ravel()[candidates])
    count = min(CHECKS, len(candidates))
    places = (np.arange(count) + random.random(count)) / max(count, 1) * sum_to[-1]
    chosen = np.unique(candidates[np.minimum(np.searchsorted(sum_to, places), len(candidates) - 1)])
    at = np.unravel_index(chosen, seen.mask.shape)
    E = sums[..., :3] / k[..., None]
    return Check(
        seen.sites(at), E[at], uncertainty[at], uncertainty, float(uncertainty[counting].mean()), float(E[counting].mean())
    )
