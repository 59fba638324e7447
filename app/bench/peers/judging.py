"""What all peers are measured by: the points of two views with the truth there, and the time and error of each measurement."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from irrsplat.app.bench import gather_truth
from irrsplat.core.errors import InputError
from irrsplat.image.figures.pen import Colour
from irrsplat.indirect import paper_scan
from irrsplat.reference import fine_gather
from irrsplat.reference.truth import NOTHING, in_words
from irrsplat.scene.model import Camera

if TYPE_CHECKING:
    from irrsplat.renderer import Renderer

ENOUGH = 0.03  # relative RMSE below which no peer is measured any finer
SECONDS = 120.0  # after which a peer begins no finer measurement
CPUS = max(1, os.cpu_count() or 1)  # the same for all: ours, rtrace -n and Mitsuba's threads


@dataclass(frozen=True)
class Measurement:
    """One measurement: what the `system` was set to, its seconds, and the relative RMSE of irradiance that it reaches.

    further, further_rmse: the same for a further view of the scene with all that was kept from the first; None: not known.
    """

    system: str
    quality: str
    seconds: float
    rmse: float
    further: float | None
    further_rmse: float | None


@dataclass(frozen=True)
class Series:
    """The measurements of one system, fastest first: a line of the plot, in `colour`. None where it could not take part.

    about: what came before its clock began, or why it could not take part. keeps_nothing: it has nothing for a further view, and
    its error falls with 1/√seconds.
    """

    measurements: tuple[Measurement, ...]
    about: str
    colour: Colour = (0, 0, 0)
    keeps_nothing: bool = False


@dataclass(frozen=True)
class JudgedView:
    """What a camera sees: points (N, 3) with shading and geometric normals, the numbers (M,) of those at which irradiance is
    judged, and the truth there (M, 3) in W/m²; its pixels as `fine_gather.Truth` has them."""

    camera: Camera
    position: np.ndarray
    normal: np.ndarray
    geometric: np.ndarray
    judged: np.ndarray
    truth: fine_gather.Truth

    def error(self, E: np.ndarray) -> float:
        """The relative RMSE of irradiance (N, 3) at all points."""
        off = E[self.judged] - self.truth.irradiance
        return float(np.sqrt(np.mean(off**2)) / self.truth.irradiance.mean(dtype=float))


def judged_view(renderer: Renderer, camera: Camera) -> JudgedView:
    """What `camera` sees, and its truth; raises InputError where there is none."""
    truth = gather_truth.truth(renderer, camera)
    if truth is None or not truth.irradiance.any():
        bounces = renderer.settings.bounces
        if bounces == 1:
            raise InputError(NOTHING if truth is None else "no indirect light reaches the view, so there is nothing to compare")
        size = "{} {}".format(*renderer.size)
        raise InputError(
            f"there is no truth of {in_words(bounces)}; run first: irrsplat verify SCENE --size {size} --bounces {bounces}"
        )
    shown, _ = renderer.frame(camera, gather=False)
    with renderer.ctx:
        seen = paper_scan.read_back(shown.gbuffer)
    numbers = np.cumsum(seen.mask.ravel()).reshape(seen.mask.shape) - 1
    position, normal, geometric = (array[seen.mask] for array in (seen.position, seen.normal, seen.geometric))
    return JudgedView(camera, position, normal, geometric, numbers[tuple(truth.pixels.T)], truth)


def fastest_first(measurements: Sequence[Measurement]) -> tuple[Measurement, ...]:
    """The same in the order of a Series."""
    return tuple(sorted(measurements, key=lambda one: one.seconds))
