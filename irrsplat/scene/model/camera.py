"""From where a scene is seen."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from irrsplat.core.errors import InputError
from irrsplat.scene.model.checks import checked, checked_number, moved, put

_FARTHEST = 1e24  # of a camera's numbers: what is drawn parallel is seen from very far away


@dataclass(frozen=True)
class Camera:
    """A pinhole: `eye`, `target` and `up` as gluLookAt (world space), `fov` vertical in degrees; raises InputError for one that
    cannot be."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    fov: float = 45.0
    name: str = ""

    def __post_init__(self) -> None:
        for name in ("eye", "target", "up"):
            put(self, **{name: checked(f"a camera's {name}", getattr(self, name), 3, -_FARTHEST, _FARTHEST)})
        put(self, fov=checked_number("a camera's field of view", self.fov))
        if not 0.0 < self.fov < 180.0:
            raise InputError(f"field of view must lie between 0 and 180 degrees, not {self.fov:g}")
        forward = np.subtract(self.target, self.eye)
        if not np.linalg.norm(forward) > 0.0:
            raise InputError("the camera's eye lies at its target; move one of them")
        sine = np.linalg.norm(np.cross(forward / np.linalg.norm(forward), self.up))
        if not sine > 1e-9 * max(float(np.linalg.norm(self.up)), 1e-300):
            raise InputError("the camera's up vector is parallel to its view; give another up")

    def shifted(self, by: npt.ArrayLike) -> Camera:
        """The camera `by` (3,) metres from here, with the same view."""
        return replace(self, eye=moved(self.eye, by), target=moved(self.target, by))

    @property
    def screen(self) -> float:
        """The height of the image at distance 1 from the eye, in metres."""
        return 2.0 * math.tan(math.radians(self.fov) / 2.0)

    @cached_property
    def axes(self) -> np.ndarray:
        """(3, 3) rows: right, up and backward, unit, world space."""
        backward = np.subtract(self.eye, self.target)
        backward = backward / np.linalg.norm(backward)
        right = np.cross(self.up, backward)
        right = right / np.linalg.norm(right)
        return np.stack([right, np.cross(backward, right), backward])

    @cached_property
    def view_from_world(self) -> np.ndarray:
        """(4, 4) float64: right-handed view space that looks down -z, as gluLookAt."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.axes
        matrix[:3, 3] = -self.axes @ np.asarray(self.eye)
        return matrix

    def clip_from_view(self, aspect: float, near: float, far: float) -> np.ndarray:
        """(4, 4) float64, as gluPerspective with this camera's vertical field of view."""
        f = 1.0 / np.tan(np.radians(self.fov) / 2.0)
        return np.array(
            [
                [f / aspect, 0.0, 0.0, 0.0],
                [0.0, f, 0.0, 0.0],
                [0.0, 0.0, (far + near) / (near - far), 2.0 * far * near / (near - far)],
                [0.0, 0.0, -1.0, 0.0],
            ]
        )
