"""`--turntable N`: a full circle around what a camera looks at, which goes on from its end as it began."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from irrsplat.scene.camera_path import Path
from irrsplat.scene.model import Camera

_LEVEL = 0.02  # the least sine between the view and the axis for which a turn shows another side


def turntable(camera: Camera, up: Sequence[float], frames: int) -> Path:
    """The path of `frames` cameras, evenly spaced on the circle of `camera` about its target, the first of them `camera` itself.

    The circle is level: its axis is the scene's `up` (3,), or the camera's own where it looks along that. Frame `frames`, if
    there were one, would be frame 0 again.
    """
    offset = np.subtract(camera.eye, camera.target)
    axis = np.divide(up, np.linalg.norm(up))
    if np.linalg.norm(np.cross(axis, offset)) < _LEVEL * np.linalg.norm(offset):
        axis = np.divide(camera.up, np.linalg.norm(camera.up))

    def turned(vector: np.ndarray, angle: float) -> np.ndarray:
        """By Rodrigues' formula."""
        along = axis * (axis @ vector)
        found: np.ndarray = along + np.cos(angle) * (vector - along) + np.sin(angle) * np.cross(axis, vector)
        return found

    keys = [camera]
    for angle in 2.0 * np.pi * np.arange(1, frames) / frames:
        eye, top = camera.target + turned(offset, angle), turned(np.asarray(camera.up, float), angle)
        keys.append(replace(camera, eye=tuple(eye.tolist()), up=tuple(top.tolist())))
    return Path(tuple(keys), frames)
