"""A horizontal plane of light readings. A process of its own measures them, see `irrsplat measure --height`."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from irrsplat.core.color import LUMINANCE
from irrsplat.core.timing import clock, other_process
from irrsplat.meter.light_meter import LightMeter
from irrsplat.meter.light_scale import LightScale, brightest
from irrsplat.meter.plane import Plane, horizontal
from irrsplat.meter.readings import Readings
from irrsplat.scene.model import Scene

_RESTS = 0.3  # seconds without a change of scene or height before a measurement begins
_LEAST, _MOST = 4.0, 50.0  # points along the longer edge
_USUAL = 0.75  # metres above the lowest point of the scene: the height of a desk


def scene_height(scene: Scene) -> float:
    """Return the extent of the scene along its up direction, in metres."""
    return float(np.ptp(scene.corners @ np.asarray(scene.up)))


def usual_height(scene: Scene) -> float:
    """Return the height of a desk, or half the height of a scene that is lower."""
    return min(_USUAL, 0.5 * scene_height(scene))


def spacing(plane: Plane) -> float:
    """Return the usual spacing of points, which is for rooms, within bounds for very small and very large scenes."""
    edge = max(math.hypot(*plane.u), math.hypot(*plane.v))
    return min(max(plane.usual_spacing(), edge / _MOST), edge / _LEAST)


@dataclass(frozen=True)
class MeasuredPlane:
    """The readings of a plane with `rows` times `columns` points. height: metres above the lowest point of the scene."""

    plane: Plane
    columns: int
    rows: int
    readings: Readings
    height: float

    @property
    def scale(self) -> LightScale:
        """The scale of false colours. Its upper end is a round number for the readings of the plane."""
        return LightScale().up_to(brightest((self.readings.total @ LUMINANCE)[self.readings.counts]))


class MeasuringPlane:
    """The plane of a session, measured in the background.

    height: metres above the lowest point of the scene, for the next measurement.
    """

    def __init__(self) -> None:
        self.height = 0.0
        self.measured: MeasuredPlane | None = None
        self._calling: other_process.Calling | None = None
        self._scene: Scene | None = None  # the scene of the last update
        self._height, self._since, self._done = 0.0, 0.0, False

    @property
    def share(self) -> float | None:
        """The finished share of the measurement, 0..1; None after its end."""
        return None if self._done else 0.0 if self._calling is None else self._calling.share

    def update(self, on: bool, scene: Scene) -> None:
        """Store a finished measurement. While `on`, measure again if scene or height has changed.

        Raises IrrsplatError if measuring failed.
        """
        if self._scene is not None and self._scene.meshes is not scene.meshes:
            self.measured = None
        if not on or scene is not self._scene or self.height != self._height:
            self.release()
            self._scene, self._height, self._since, self._done = scene, self.height, clock.now(), False
            return
        calling = self._calling
        if calling is None:
            if not self._done and clock.now() - self._since >= _RESTS:
                work, failure = other_process.code(measure), "the plane could not be measured ({why})"
                self._calling = other_process.Calling(work, (scene, self.height), failure)
        elif not calling.is_alive():
            self._calling, self._done = None, True
            if calling.error is not None:
                raise calling.error
            assert isinstance(calling.result, MeasuredPlane)
            self.measured = calling.result

    def release(self) -> None:
        calling, self._calling = self._calling, None
        if calling is not None:
            calling.release()


# ---- in the other process ----------------------------------------------------------------------------------------------


def measure(scene: Scene, height: float, report: Callable[[float], None]) -> MeasuredPlane:
    """Return the readings of a plane over the whole scene. Raises InputError for a scene without extent."""
    plane = horizontal(scene, height)
    grid = plane.grid(spacing(plane))
    with LightMeter(scene) as meter:
        readings = meter.measure(grid.points, grid.normals, report)
    return MeasuredPlane(plane, grid.columns, grid.rows, readings, height)
