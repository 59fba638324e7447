"""Cameras, and parts of their pictures."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from irrsplat.core.errors import InputError
from irrsplat.core.vectors import vector
from irrsplat.scene.model.checks import check_type, checked, checked_number, put

_FARTHEST = 1e24  # of a camera's numbers; allows the distant eye of a nearly parallel projection
_WIDEST_RATIO = 2.4  # ratio of the longer to the shorter side above which a picture is a strip


def measure(size: tuple[int, int]) -> float:
    """Return the length in pixels that percentages of a picture of `size` (width, height) refer to.

    It is the height. For ratios above 2.4 it changes over to the side of a square with as many pixels, reached at 5.76.
    """
    width, height = size
    square = math.sqrt(width * height)
    if width > _WIDEST_RATIO * height:
        return min(width / _WIDEST_RATIO, square)
    return max(width * _WIDEST_RATIO, square) if height > _WIDEST_RATIO * width else float(height)


@dataclass(frozen=True)
class Part:
    """A rectangle of a picture of size `whole` (width, height): `size` and lower left `corner` in pixels.

    It may extend beyond the picture, into its plane.
    """

    whole: tuple[int, int]
    corner: tuple[int, int]
    size: tuple[int, int]

    def cropped(self, clip: np.ndarray) -> np.ndarray:
        """Return (4, 4) the clip space of this part, from a matrix (4, 4) to that of the whole picture."""
        matrix = clip.copy()
        for axis in (0, 1):
            whole, corner, side = self.whole[axis], self.corner[axis], self.size[axis]
            matrix[axis] = clip[axis] * (whole / side) + clip[3] * ((whole - 2 * corner) / side - 1.0)
        return matrix


@dataclass(frozen=True)
class Camera:
    """A pinhole camera: `eye`, `target` and `up` as in gluLookAt (world space), `fov` vertical in degrees.

    shift: of its picture, in widths to the right and heights up. part: the drawn part of its picture; None: all of it.
    Raises InputError for an invalid camera.
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    fov: float = 45.0
    name: str = ""
    shift: tuple[float, float] = field(default=(0.0, 0.0), repr=False)
    part: Part | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name in ("eye", "target", "up"):
            put(self, **{name: checked(f"a camera's {name}", getattr(self, name), 3, -_FARTHEST, _FARTHEST)})
        put(self, fov=checked_number("a camera's field of view", self.fov))
        check_type("a camera's name", self.name, str)
        if not 0.0 < self.fov < 180.0:
            raise InputError(f"field of view must lie between 0 and 180 degrees, not {self.fov:g}")
        distance = math.dist(self.eye, self.target)
        if not distance > 1e-150:  # its square is not 0
            raise InputError("the camera's eye lies at its target; move one of them")
        (x, y, z), (u, v, w) = ((t - e) / distance for t, e in zip(self.target, self.eye, strict=True)), self.up
        sine = math.hypot(y * w - z * v, z * u - x * w, x * v - y * u)
        if not sine > 1e-9 * max(math.hypot(u, v, w), 1e-300):
            raise InputError("the camera's up vector is parallel to its view; give another up")

    def shifted(self, by: npt.ArrayLike) -> Camera:
        """Return the camera shifted by `by` (3,) metres, with the same view."""
        return replace(self, eye=vector(np.add(self.eye, by)), target=vector(np.add(self.target, by)))

    @property
    def screen(self) -> float:
        """The height of the image at distance 1 from the eye, in metres."""
        return 2.0 * math.tan(math.radians(self.fov) / 2.0)

    def whole(self, size: tuple[int, int]) -> tuple[int, int]:
        """Return the size (width, height) of the whole picture, of which a part of `size` is drawn."""
        return size if self.part is None else self.part.whole

    def corner(self) -> tuple[int, int]:
        """Return the lower left corner of the drawn part within the whole picture, in pixels."""
        return (0, 0) if self.part is None else self.part.corner

    def pixel(self, size: tuple[int, int]) -> float:
        """Return the side of a pixel at distance 1 from the eye, in metres, for a drawn part of `size`."""
        return self.screen / self.whole(size)[1]

    def measure(self, size: tuple[int, int]) -> float:
        """Return the `measure` of the picture at distance 1 from the eye, in metres, for a drawn part of `size`."""
        whole = self.whole(size)
        return self.screen * (measure(whole) / whole[1])

    def measure_at(self, points: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        """Return (N,) metres: the `measure` of the picture at the distances of points (N, 3) from the eye."""
        distance = np.linalg.norm(points - np.asarray(self.eye, points.dtype), axis=1)
        return np.asarray(self.measure(size) * distance)

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
        """Return (4, 4) float64, as gluPerspective with this camera's vertical field of view; aspect: of the drawn part."""
        part, f = self.part, 1.0 / np.tan(np.radians(self.fov) / 2.0)
        if part is not None:
            aspect = part.whole[0] / part.whole[1]
        matrix = np.array(
            [
                [f / aspect, 0.0, 0.0, 0.0],
                [0.0, f, 0.0, 0.0],
                [0.0, 0.0, (far + near) / (near - far), 2.0 * far * near / (near - far)],
                [0.0, 0.0, -1.0, 0.0],
            ]
        )
        matrix[:2, 2] -= 2.0 * np.asarray(self.shift)
        return matrix if part is None else part.cropped(matrix)


def part_of(camera: Camera, part: Part) -> Camera:
    """Return `camera` for drawing only `part` of its picture."""
    return replace(camera, part=part)


def part_drawn(camera: Camera, size: tuple[int, int]) -> Part:
    """Return the part of a camera's picture that is drawn, of `size`."""
    return Part(camera.whole(size), camera.corner(), size)
