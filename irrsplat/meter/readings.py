"""What a light meter has read: irradiance at points, its parts, and the mean, extremes and uniformity of them all."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, TypedDict

import numpy as np

from irrsplat.core.color import LUMINOUS_EFFICACY, photometric

Unit = Literal["W/m2", "lux"]


class Status(IntEnum):
    """Whether light can be measured at a point. INSIDE: it lies within a solid. BEHIND: a surface lies on it, or just before."""

    OK = 0
    INSIDE = 1
    BEHIND = 2

    @property
    def word(self) -> str:
        """As tables have it."""
        return self.name.lower()


class Summary(TypedDict):
    """Of the points that count, in `unit`: mean, least and greatest value, and U0 = minimum/mean (EN 12665), None in the dark.

    W/m² are those of the three channels weighted as for luminance. points: those that count; inside, behind: those left out.
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
    """N points, facing along unit normals, both (N, 3), and W/m² there, (N, 3): `direct` of lamps, `indirect` of emitters, sky
    and all bounces. status: (N,) numbers of Status."""

    position: np.ndarray
    normal: np.ndarray
    direct: np.ndarray
    indirect: np.ndarray
    status: np.ndarray

    @property
    def total(self) -> np.ndarray:
        """(N, 3) W/m²."""
        found: np.ndarray = self.direct + self.indirect
        return found

    @property
    def counts(self) -> np.ndarray:
        """(N,) whether light can be measured there."""
        found: np.ndarray = self.status == Status.OK
        return found

    def values(self, unit: Unit) -> dict[str, np.ndarray]:
        """`direct`, `indirect` and `total`: (N,) lux, or (N, 3) W/m²."""
        parts = {"direct": self.direct, "indirect": self.indirect, "total": self.total}
        return {name: photometric(E) for name, E in parts.items()} if unit == "lux" else parts

    def summary(self, unit: Unit) -> Summary:
        """Mean, extremes and uniformity of the total."""
        light = photometric(self.total[self.counts].astype(float)) / (1.0 if unit == "lux" else LUMINOUS_EFFICACY)
        inside, behind = (int((self.status == status).sum()) for status in (Status.INSIDE, Status.BEHIND))
        found = Summary(
            unit=unit, points=len(light), inside=inside, behind=behind, mean=None, minimum=None, maximum=None, uniformity=None
        )
        if not len(light):
            return found
        mean, low, high = float(light.mean()), float(light.min()), float(light.max())
        found |= {"mean": mean, "minimum": low, "maximum": high, "uniformity": low / mean if mean > 0.0 else None}
        return found
