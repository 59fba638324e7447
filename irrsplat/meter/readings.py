"""The readings of a light meter: irradiance at points, its parts, mean, extremes and uniformity."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, TypedDict

import numpy as np

from irrsplat.core.color import LUMINOUS_EFFICACY, photometric

Unit = Literal["W/m2", "lux"]


class Status(IntEnum):
    """Measurability of a point. INSIDE: within a solid. BEHIND: a surface lies on it, or closely in front."""

    OK = 0
    INSIDE = 1
    BEHIND = 2


class Summary(TypedDict):
    """Summary of the valid points, in `unit`: mean, least and greatest value, and U0 = minimum/mean (EN 12665), None in the dark.

    W/m² are weighted over the three channels like luminance. points: number of valid points; inside, behind: numbers left out.
    """

    unit: str
    points: int
    inside: int
    behind: int
    mean: float | None
    minimum: float | None
    maximum: float | None
    uniformity: float | None


@dataclass(frozen=True)
class Readings:
    """N points with unit normals, both (N, 3), and W/m², (N, 3): `direct` from lights, `indirect` from emitters, sky and all
    bounces. status: (N,) numbers of Status."""

    position: np.ndarray
    normal: np.ndarray
    direct: np.ndarray
    indirect: np.ndarray
    status: np.ndarray

    @property
    def total(self) -> np.ndarray:
        """(N, 3) W/m²."""
        return np.asarray(self.direct + self.indirect)

    @property
    def counts(self) -> np.ndarray:
        """(N,) bool, True for measurable points."""
        return np.asarray(self.status == Status.OK)

    def values(self, unit: Unit) -> dict[str, np.ndarray]:
        """Return `direct`, `indirect` and `total`: (N,) lux, or (N, 3) W/m²."""
        parts = {"direct": self.direct, "indirect": self.indirect, "total": self.total}
        return {name: photometric(E) for name, E in parts.items()} if unit == "lux" else parts

    def summary(self, unit: Unit) -> Summary:
        """Return mean, extremes and uniformity of the total."""
        light = photometric(self.total[self.counts].astype(float)) / (1.0 if unit == "lux" else LUMINOUS_EFFICACY)
        inside, behind = (int((self.status == status).sum()) for status in (Status.INSIDE, Status.BEHIND))
        mean, low, high = (float(of(light)) if len(light) else None for of in (np.mean, np.min, np.max))
        even = low / mean if low is not None and mean is not None and mean > 0.0 else None
        return Summary(
            unit=unit, points=len(light), inside=inside, behind=behind, mean=mean, minimum=low, maximum=high, uniformity=even
        )
