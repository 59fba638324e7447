"""`--turntable N`: a closed circle of cameras around a target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from irrsplat.scene.camera_path import Path
from irrsplat.scene.model import Camera

_LEVEL = 0.02  # least sine of the angle between view and axis for a useful turn


def turntable(camera: Camera, up: Sequence[float], frames: int) -> Path:
    """Return the path of `frames` cameras, evenly spaced on a circle about the target, starting with `camera`.

    The circle's axis is the scene's `up` (3,), or the camera's own for a view along `up`. Frame `frames` would equal frame
    0.
    """
    offset = np.subtract(camera.eye, camera.target)
    axis = np.divide(up, np.linalg.norm(up))
    if np.linalg.norm(np.cross(axis, offset)) < _LEVEL * np.linalg.norm(offset):
        axis = np.divide(camera.up, np.linalg.norm(camera.up))

    def turned(vector: np.ndarray, angle: float) -> np.ndarray:
        """Return `vector` rotated about the axis (Rodrigues' formula)."""
        along = axis * (axis @ vector)
        found: np.ndarray = along + np.cos(angle) * (vector - along) + np.sin(angle) * np.cross(axis, vector)
        return found

    keys = [camera]
    for angle in 2.0 * np.pi * np.arange(1, frames) / frames:
        eye, top = camera.target + turned(offset, angle), turned(np.asarray(camera.up, float), angle)
        keys.append(replace(camera, eye=tuple(eye.tolist()), up=tuple(top.tolist())))
    return Path(tuple(keys), frames)
