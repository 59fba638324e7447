"""Order of gathering while the camera moves: first the sites that stay in view."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irrsplat.records.culling import within
from irrsplat.scene.model import Camera

AHEAD = 4  # frames: the flight is extrapolated so far


class FlightOrder:
    """Remembers the last camera.

    That what waits longest should come before what has just appeared was tried as well: more pixels go without a record then,
    since what waits is small, and what appears is large.
    """

    def __init__(self) -> None:
        self._camera: Camera | None = None

    def __call__(self, position: np.ndarray, camera: Camera, size: tuple[int, int]) -> np.ndarray:
        """Return (N,) the numbers of the sites at `position` (N, 3), world space, in the order of gathering.

        Sites that are soon out of sight come last. camera: of this frame, in pictures of `size` (width, height).
        """
        if not len(position):
            self._camera = camera
            return np.zeros(0, np.intp)
        soon = within(position, self._ahead(camera), size)
        self._camera = camera
        order: np.ndarray = np.argsort(~soon, kind="stable")
        return order

    def _ahead(self, camera: Camera) -> Camera:
        """Return the camera AHEAD frames from now, or `camera` if it stands still or would face along its up vector."""
        before = self._camera
        if before is None or before == camera:
            return camera
        eye, forward = np.asarray(camera.eye), -camera.axes[2]
        eye = eye + AHEAD * (eye - np.asarray(before.eye))
        forward = forward + AHEAD * (forward + before.axes[2])
        if np.linalg.norm(np.cross(forward, camera.up)) < 1e-3 * np.linalg.norm(camera.up):
            return camera
        return replace(camera, eye=tuple(eye.tolist()), target=tuple((eye + forward).tolist()))
