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
_WIDEST = 2.4  # the longer side of a picture by the shorter, beyond which it is a strip


def measure(size: tuple[int, int]) -> float:
    """Pixels: what percentages on screen are of in a picture of `size` (width, height). It is the height; where the sides differ
    by more than a factor of 2.4, it goes over to that of a square of as many pixels, which it is from a factor of 5.76 on."""
    width, height = size
    square = math.sqrt(width * height)
    if width > _WIDEST * height:
        return min(width / _WIDEST, square)
    return max(width * _WIDEST, square) if height > _WIDEST * width else float(height)


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

    def whole(self, size: tuple[int, int]) -> tuple[int, int]:
        """The size (width, height) of the whole picture, where what is drawn has `size`."""
        return size

    def corner(self) -> tuple[int, int]:
        """Where in the whole picture the lower left corner of what is drawn lies, in pixels from its own."""
        return 0, 0

    def pixel(self, size: tuple[int, int]) -> float:
        """The side of a pixel at distance 1 from the eye, in metres, where what is drawn has `size`."""
        return self.screen / self.whole(size)[1]

    def measure(self, size: tuple[int, int]) -> float:
        """The `measure` of the picture at distance 1 from the eye, in metres, where what is drawn has `size`."""
        whole = self.whole(size)
        return self.screen * (measure(whole) / whole[1])

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


@dataclass(frozen=True)
class Part:
    """A rectangle of a picture of size `whole` (width, height): `size`, and its lower left `corner` in pixels from the picture's
    own. It may reach beyond the picture, whose plane goes on there."""

    whole: tuple[int, int]
    corner: tuple[int, int]
    size: tuple[int, int]

    def cropped(self, clip: np.ndarray) -> np.ndarray:
        """(4, 4) the clip space of this part, from a matrix (4, 4) to that of the whole picture."""
        matrix = clip.copy()
        for axis in (0, 1):
            whole, corner, side = self.whole[axis], self.corner[axis], self.size[axis]
            matrix[axis] = clip[axis] * (whole / side) + clip[3] * ((whole - 2 * corner) / side - 1.0)
        return matrix


@dataclass(frozen=True)
class PictureCamera(Camera):
    """A camera whose picture is shifted by `shift`: of its width to the right, and of its height up; or of which only a part is
    drawn."""

    shift: tuple[float, float] = (0.0, 0.0)
    part: Part | None = None

    def whole(self, size: tuple[int, int]) -> tuple[int, int]:
        """As Camera's."""
        return size if self.part is None else self.part.whole

    def corner(self) -> tuple[int, int]:
        """As Camera's."""
        return (0, 0) if self.part is None else self.part.corner

    def clip_from_view(self, aspect: float, near: float, far: float) -> np.ndarray:
        """(4, 4) float64, as Camera's, off its centre; aspect: of what is drawn."""
        part = self.part
        matrix = super().clip_from_view(aspect if part is None else part.whole[0] / part.whole[1], near, far)
        matrix[:2, 2] -= 2.0 * np.asarray(self.shift)
        return matrix if part is None else part.cropped(matrix)


def part_of(camera: Camera, part: Part) -> PictureCamera:
    """`camera`, of whose picture only `part` is drawn."""
    shift = camera.shift if isinstance(camera, PictureCamera) else (0.0, 0.0)
    return PictureCamera(camera.eye, camera.target, camera.up, camera.fov, camera.name, shift, part)


def part_drawn(camera: Camera, size: tuple[int, int]) -> Part:
    """Which part of a camera's picture is drawn, where what is drawn has `size`."""
    return Part(camera.whole(size), camera.corner(), size)
