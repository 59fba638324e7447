"""Blender's Cycles as a peer: its pass of indirect diffuse light, and Open Image Denoise."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator, Sequence
from typing import cast

from irrsplat.app.bench.peers import judging
from irrsplat.app.bench.peers.judging import Series
from irrsplat.app.bench.peers.table import Notify
from irrsplat.core.errors import IrrsplatError
from irrsplat.core.timing import other_process
from irrsplat.reference.timed_levels import JudgedView, TimedLevels
from irrsplat.reference.truth import vertices
from irrsplat.scene.model import Scene
from irrsplat.settings import All

_NAME = "Cycles"
_COLOURS = (40, 140, 90), (90, 190, 130), (20, 90, 60)


def measure(
    scene: Scene, size: tuple[int, int], bounces: int | All, views: Sequence[JudgedView], notify: Notify
) -> Iterator[Series]:
    """Yield measurements with growing sample counts, and the same with each filter of Open Image Denoise."""
    if importlib.util.find_spec("bpy") is None:
        raise IrrsplatError("Blender's module is not installed; with Python 3.11, run: pip install bpy")
    judging.check_plain(scene)
    if any(not light.directional and (not light.physical or light.spot_exponent) for light in scene.lights):
        raise IrrsplatError("lights with OpenGL's attenuation or spotExponent are not written for it; give lights an intensity")
    notify(_NAME)
    view = views[0]
    arguments = scene, view.camera, size, vertices(bounces), view
    found = cast(TimedLevels, other_process.call(other_process.code(timed), arguments, failure="Cycles failed ({why})"))
    yield from judging.by_samples(_NAME, found, _COLOURS)


def timed(*arguments: object) -> object:
    """Return the result of `cycles_scene.timed`, in the other process; the import prints to stdout, so that it comes late."""
    from irrsplat.app.bench.peers import cycles_scene

    work: Callable[..., object] = cycles_scene.timed
    return work(*arguments)
