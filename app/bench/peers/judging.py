"""Common measure of all peers: points of two views with their reference, and time and error of each measurement."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from irrsplat.app.bench import gather_truth
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.image.false_colours import Colour
from irrsplat.indirect import paper_scan
from irrsplat.reference.timed_levels import JudgedView, TimedLevels
from irrsplat.reference.truth import NOTHING, in_words
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera, Scene

CPUS = max(1, os.cpu_count() or 1)  # threads, equal for all: ours, rtrace -n and Mitsuba


@dataclass(frozen=True)
class Measurement:
    """One measurement: settings of the `system`, seconds of processor time by all threads, and relative RMSE of irradiance.

    further, further_rmse: the values of a further view with all kept data.
    """

    system: str
    quality: str
    seconds: float
    rmse: float
    further: float
    further_rmse: float


@dataclass(frozen=True)
class Series:
    """Measurements of one system, fastest first: a line of the plot in `colour`; empty if it cannot take part.

    about: preparation outside the timing, or the reason for absence. keeps_nothing: True for a system without data for
    further views; its error falls with 1/√seconds.
    """

    measurements: tuple[Measurement, ...]
    about: str
    colour: Colour = (0, 0, 0)
    keeps_nothing: bool = False


def judged_view(renderer: Renderer, camera: Camera) -> JudgedView:
    """Return the visible points of `camera` and their reference; raise InputError without one."""
    truth = gather_truth.truth(renderer, camera, trace=True)
    if truth is None or not truth.irradiance.any():
        bounces = renderer.settings.bounces
        if bounces == 1:
            raise InputError(NOTHING if truth is None else "no indirect light reaches the view, so there is nothing to compare")
        size = "{} {}".format(*renderer.size)
        raise InputError(
            f"there is no reference of {in_words(bounces)}; run first: irrsplat verify SCENE --size {size} --bounces {bounces}"
        )
    shown, _ = renderer.frame(camera, gather=False)
    with renderer.ctx:
        seen = paper_scan.read_back(shown.gbuffer)
    numbers = np.cumsum(seen.mask.ravel()).reshape(seen.mask.shape) - 1
    position, normal, geometric = (array[seen.mask] for array in (seen.position, seen.normal, seen.geometric))
    return JudgedView(camera, position, normal, geometric, numbers[tuple(truth.pixels.T)], truth, seen.mask)


def by_samples(name: str, found: TimedLevels, colours: Sequence[Colour]) -> Iterator[Series]:
    """Yield the series of a renderer that is timed by sample counts, and the same with each filter of Open Image Denoise.

    Further views take as long, as it keeps no data.
    """
    about = f"after {found['load']:.2f} s of loading, compiled; {found['threads']} threads"
    for (quality, levels), colour in zip(found["levels"].items(), colours, strict=False):
        system = f"{name} + OIDN {quality}" if quality else name
        rows = [
            Measurement(system, f"{count} samples", seconds, rmse, seconds, rmse)
            for count, seconds, rmse in levels
            if seconds > 0.0
        ]
        yield Series(tuple(rows), about, colour, keeps_nothing=not quality)
    if len(found["levels"]) == 1:
        yield Series((), f"{name} + OIDN: Open Image Denoise (pyoidn) is not installed")


def check_plain(scene: Scene) -> None:
    """Raise IrrsplatError for a scene with more than plain colours, a uniform sky and lights without photometry."""
    if any(scene.sky_gradient) or scene.environment is not None:
        raise IrrsplatError("a sky that is not the same all around has no counterpart here")
    for mesh in scene.meshes:
        if mesh.material.textures or mesh.material.light_cutoff > 0.0:
            raise IrrsplatError("textures and what light passes are not written for it; give a scene of plain colours")
        if mesh.colors is not None:
            raise IrrsplatError("colours of vertices have no counterpart here")
    if any(light.photometry is not None for light in scene.lights):
        raise IrrsplatError("luminaires (IES) are not written for it; give a scene of other lights")


def fastest_first(measurements: Sequence[Measurement]) -> tuple[Measurement, ...]:
    """Return the measurements in the order of a Series."""
    return tuple(sorted(measurements, key=lambda one: one.seconds))
