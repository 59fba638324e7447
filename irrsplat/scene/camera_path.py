"""Camera paths: keys, a smooth curve through them, and their text file."""

from __future__ import annotations

import math
import os
import pathlib
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from irrsplat.core.errors import InputError
from irrsplat.core.vectors import vector
from irrsplat.core.words import is_number, quote
from irrsplat.scene.io.lines import Line, lines
from irrsplat.scene.io.text.scene_text import USAGE
from irrsplat.scene.model import Camera

SEGMENT = 30  # frames from key to key by default
_CAM = f"{USAGE['cam']} (a name may follow 'cam')"
_FRAMES = "frames N, a whole number of at least 1"
_LEAST_UP_SINE = 0.01  # least sine of the angle between view and up vector
_LEAST_DISTANCE = 1e-9  # least distance of the target, relative to the eye's coordinates; smaller ones are lost in rounding


@dataclass(frozen=True)
class Path:
    """Keys (at least one) and a number of frames (at least one), else InputError."""

    keys: tuple[Camera, ...]
    frames: int

    def __post_init__(self) -> None:
        if not self.keys:
            raise InputError("a path needs at least one camera as its key")
        if self.frames < 1:
            raise InputError(f"a path has at least 1 frame, not {self.frames}")

    def __iter__(self) -> Iterator[Camera]:
        """Yield the cameras of all frames, in order."""
        return map(self.camera, range(self.frames))

    def shifted(self, by: npt.ArrayLike) -> Path:
        """Return the path with its keys shifted by `by` (3,) metres, to another origin."""
        return replace(self, keys=tuple(key.shifted(by) for key in self.keys)) if np.any(by) else self

    def camera(self, frame: float) -> Camera:
        """Return the camera at `frame`, which may be fractional: 0 is the first key, frames - 1 the last.

        The camera is constant before and after these. Keys are evenly spaced in time. The result is always a valid camera.
        """
        if not math.isfinite(frame):
            raise InputError(f"a frame is a finite number, not {frame}")
        last = len(self.keys) - 1
        place = min(max(frame * last / max(self.frames - 1, 1), 0.0), float(last))
        i = math.floor(place)
        if place == i:
            return self.keys[i]
        around = [self.keys[min(max(k, 0), last)] for k in range(i - 1, i + 3)]  # the end keys count twice
        return _between(around, place - i)


def load_path(file: str | os.PathLike[str], fov: float = 45.0) -> Path:
    """Read the path in the text file `file`: `cam` lines are keys, `frames N` is optional.

    fov: of every key, vertical, in degrees. Raises InputError with file and line for any error in it.
    """
    where = pathlib.Path(file)
    keys: list[Camera] = []
    frames: Line | None = None
    for line in lines(where):
        if line.word == "cam":
            keys.append(_cam(line, fov))
        elif line.word != "frames":
            raise line.error(f"unknown word {quote(line.word)}; expected cam or frames")
        elif frames is not None:
            raise line.error(f"'frames' is given twice; first in line {frames.number}")
        else:
            frames = line
    if not keys:
        raise InputError(f"there is no 'cam' line; expected at least one: {_CAM}", where)
    count = SEGMENT * (len(keys) - 1) + 1 if frames is None else _count(frames)
    return Path(tuple(keys), count)


def path_text(path: Path) -> str:
    """Return the text of a path file, from which `load_path` restores eyes, targets, ups and frames exactly.

    Field of view and names of keys are not included.
    """
    points = ((key.eye, key.target, key.up) for key in path.keys)
    cams = ("  ".join(" ".join(repr(float(x)) for x in point) for point in of_key) for of_key in points)
    return "".join([f"frames {path.frames}\n", *(f"cam {words}\n" for words in cams)])


# ---- the curve -----------------------------------------------------------------------------------------------------------


def _between(around: list[Camera], t: float) -> Camera:
    """Return the camera at 0 < t < 1 from the second to the third of four keys, by the spline of Catmull and Rom (1974).

    Eye, unit view direction, unit up, log target distance and log tan(fov/2) are interpolated. Directions are better than
    targets: the target never meets the eye, and targets at different distances do not swing the view. In an orbit at constant
    distance the view stays on the centre exactly.
    """
    w = _weights(t)
    eye = w @ np.array([key.eye for key in around])
    aims = [np.subtract(key.target, key.eye) for key in around]
    distance = math.exp(w @ np.log([np.linalg.norm(g) for g in aims]))
    distance = max(distance, _LEAST_DISTANCE * float(np.abs(eye).max()))
    view = _view(around, w, t)
    zoom = w @ np.log(np.clip([key.screen / 2.0 for key in around], 1e-9, 1e9))  # beyond these limits the fov rounds to 0 or 180
    fov = math.degrees(2.0 * math.atan(math.exp(zoom)))
    return Camera(vector(eye), vector(eye + distance * view), vector(_up(around, w, t, view)), fov)


def _weights(t: float) -> np.ndarray:
    """Return (4,) the weights of the keys at t, of sum 1: 0 1 0 0 at t = 0 and 0 0 1 0 at t = 1."""
    return 0.5 * np.array([-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, -(t**2) + t**3])


def _view(around: list[Camera], w: np.ndarray, t: float) -> np.ndarray:
    """Return (3,) the interpolated view direction, unit.

    Where the view turns by more than 120°, the directions would nearly cancel: a sideways swing is added, of length 1 for a turn
    back. It vanishes at both keys with its slope. The sum is never shorter than 0.36.
    """
    views = np.array([-key.axes[2] for key in around])
    half = views[1] + views[2]
    swing = max(0.0, 1.0 - float(np.linalg.norm(half)))
    right = around[1].axes[0]
    side = right if half @ right >= 0.0 else -right
    view = w @ views + 16.0 * (t * (1.0 - t)) ** 2 * swing * side
    return np.asarray(view / np.linalg.norm(view))


def _up(around: list[Camera], w: np.ndarray, t: float, view: np.ndarray) -> np.ndarray:
    """Return (3,) the interpolated up vector; where nearly parallel to `view`, the nearer key's, rotated with the view."""
    up: np.ndarray = w @ np.array([np.divide(key.up, np.linalg.norm(key.up)) for key in around])
    if np.linalg.norm(np.cross(view, up)) > _LEAST_UP_SINE:
        return up
    key = around[1] if t < 0.5 else around[2]
    ahead, up = -key.axes[2], key.axes[1]
    return np.asarray(up - (up @ view) / (1.0 + ahead @ view) * (ahead + view))  # by the smallest rotation from ahead to view


# ---- the text ------------------------------------------------------------------------------------------------------------


def _cam(line: Line, fov: float) -> Camera:
    args = line.args
    if len(args) == 10 and not is_number(args[0]):
        args = args[1:]
    if len(args) != 9:
        raise line.error(f"'cam' has {len(args)} values; expected: {_CAM}")
    values = line.numbers(USAGE["cam"], args)
    with line.named_in_errors():
        return Camera(vector(values[0:3]), vector(values[3:6]), vector(values[6:9]), fov)


def _count(line: Line) -> int:
    if len(line.args) != 1 or not re.fullmatch(r"0*[1-9][0-9]{0,8}", line.args[0]):
        raise line.error(f"expected: {_FRAMES}")
    return int(line.args[0])
