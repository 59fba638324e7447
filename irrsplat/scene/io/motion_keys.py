"""Motion of meshes and lights along a path: keys, curves between them, and their lines in path files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.words import number, quote
from irrsplat.scene.io.lines import Line
from irrsplat.scene.model import Light, Scene
from irrsplat.scene.motion import affine, find, moved

MESH = "mesh NAME FRAME X Y Z [DEG AX AY AZ], or mesh NAME FRAME and the 12 numbers of a 3x4 matrix, row by row"
LIGHT = "light NUMBER FRAME position|spotDirection|color X Y Z"
LightValue = Literal["position", "spotDirection", "color"]
_FIELDS: dict[LightValue, str] = {"position": "position", "spotDirection": "spot_target", "color": "color"}


@dataclass(frozen=True)
class MeshKey:
    """Place of a mesh at `frame`.

    It is given by `turn` (3, 3) about the centre of its bounding box and `way` (3,) metres from its loaded place, or by `matrix`
    (3, 4). mesh: its name, or its number in digits. line: for messages.
    """

    mesh: str
    frame: float
    way: tuple[float, ...] = (0.0, 0.0, 0.0)
    turn: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    matrix: tuple[float, ...] | None = None
    line: Line | None = None

    def affine(self, centre: np.ndarray) -> np.ndarray:
        """Return (3, 4) the matrix for a mesh with this centre (3,)."""
        if self.matrix is not None:
            return np.reshape(self.matrix, (3, 4))
        turn = np.reshape(self.turn, (3, 3))
        return np.column_stack([turn, centre - turn @ centre + self.way])


@dataclass(frozen=True)
class LightKey:
    """One value of the light of this `number` at `frame`; line: for messages."""

    number: int
    frame: float
    value: LightValue
    numbers: tuple[float, float, float]
    line: Line | None = None


@dataclass(frozen=True)
class Motions:
    """All motions of a path apart from its camera; objects without a key stay as loaded."""

    meshes: tuple[MeshKey, ...] = ()
    lights: tuple[LightKey, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.meshes or self.lights)

    def check(self, scene: Scene, frames: int) -> None:
        """Raise InputError, with file and line, for unknown meshes and lights, repeated keys, and frames after the last."""
        seen: dict[tuple[object, ...], Line | None] = {}
        keys: list[MeshKey | LightKey] = [*self.meshes, *self.lights]
        for key in keys:
            if not 0.0 <= key.frame <= frames - 1:
                raise _error(
                    key.line, f"frame {key.frame:g}: the path's frames are 0 to {frames - 1}; raise 'frames', or lower this"
                )
            try:
                what: tuple[object, ...] = (
                    ("mesh", _number(scene, key)) if isinstance(key, MeshKey) else ("light", _checked(scene, key), key.value)
                )
            except InputError as error:
                raise _error(key.line, str(error)) from None
            first = seen.setdefault((*what, key.frame), key.line)
            if first is not key.line:
                place = "" if first is None else f" (line {first.number})"
                raise _error(key.line, f"{what[0]} has two keys for frame {key.frame:g}{place}; take one of them out")

    def at(self, scene: Scene, frame: float) -> Scene:
        """Return the loaded scene with its moving objects at `frame`; other objects are shared."""
        for mesh in dict.fromkeys(_number(scene, key) for key in self.meshes):
            keys = sorted((key for key in self.meshes if _number(scene, key) == mesh), key=lambda key: key.frame)
            positions = scene.meshes[mesh].positions.astype(float)
            centre = 0.5 * (positions.min(0) + positions.max(0)) + scene.origin
            matrices = np.array([key.affine(centre) for key in keys])
            scene = moved(scene, scene.meshes, mesh, _pose([key.frame for key in keys], matrices, centre, frame))
        lights = list(scene.lights)
        for light, value in dict.fromkeys((key.number, key.value) for key in self.lights):
            mine = sorted((k for k in self.lights if (k.number, k.value) == (light, value)), key=lambda key: key.frame)
            found = curve([key.frame for key in mine], np.array([key.numbers for key in mine]), frame)
            found = np.maximum(found, 0.0) if value == "color" else found
            lights[light] = _with(lights[light], value, found)
        return replace(scene, lights=tuple(lights)) if self.lights else scene


def _with(light: Light, value: LightValue, numbers: np.ndarray) -> Light:
    x, y, z = (float(v) for v in numbers)
    return replace(light, **{_FIELDS[value]: (x, y, z)})  # type: ignore[arg-type]


def _number(scene: Scene, key: MeshKey) -> int:
    """Return the index of the key's mesh, by its name or else by digits; raise InputError."""
    named = any(mesh.name == key.mesh for mesh in scene.meshes)
    return find(scene, int(key.mesh) if key.mesh.isdecimal() and not named else key.mesh)


def _checked(scene: Scene, key: LightKey) -> int:
    """Return the number of the key's light; raise InputError for a light that does not exist or lacks this value."""
    if key.number >= len(scene.lights):
        raise InputError(f"there is no light {key.number}; the scene has {len(scene.lights)}, counted from 0")
    light = scene.lights[key.number]
    if key.value == "spotDirection" and light.spot_target is None:
        raise InputError(f"light {key.number} has no cone; only a spot has a spotDirection")
    if key.value == "position" and light.directional and not any(key.numbers):
        raise InputError(
            f"light {key.number} is directional; its position is the direction that it comes from, which is not 0 0 0"
        )
    return key.number


# ---- curves --------------------------------------------------------------------------------------------------------------


def curve(frames: Sequence[float], values: np.ndarray, frame: float) -> np.ndarray:
    """Return the value at `frame` of a smooth curve through `values` (K, …) at ascending `frames`; constant outside them.

    Catmull-Rom spline for keys at any distances: the tangent at a key is the slope from the key before to the one after. The end
    keys count twice, as for a camera.
    """
    t = np.asarray(frames, float)
    i = int(np.searchsorted(t, frame, side="right")) - 1
    if i < 0 or i >= len(t) - 1:
        found: np.ndarray = values[max(i, 0)]
        return found
    step = t[i + 1] - t[i]
    before, after = t[i - 1] if i else t[i] - step, t[i + 2] if i + 2 < len(t) else t[i + 1] + step
    slope = step * (values[i + 1] - values[max(i - 1, 0)]) / (t[i + 1] - before)
    next_slope = step * (values[min(i + 2, len(t) - 1)] - values[i]) / (after - t[i])
    u = (frame - t[i]) / step
    found = (1 + 2 * u) * (1 - u) ** 2 * values[i] + u * u * (3 - 2 * u) * values[i + 1]
    found += u * (1 - u) ** 2 * slope - u * u * (1 - u) * next_slope
    return found


def _pose(frames: Sequence[float], matrices: np.ndarray, centre: np.ndarray, frame: float) -> np.ndarray:
    """Return (3, 4) the matrix at `frame`, between keys (K, 3, 4) of a mesh with this `centre` (3,).

    The centre follows a curve; the linear part is a rotation, by unit quaternions, times a stretch (polar decomposition).
    """
    from scipy.spatial.transform import Rotation  # slow to import, and few paths need it

    u, s, v = np.linalg.svd(matrices[:, :, :3])
    sign = np.where(np.linalg.det(u @ v) < 0.0, -1.0, 1.0)[:, None, None]  # a mirrored one has a negative stretch
    turns, stretches = sign * (u @ v), sign * (np.swapaxes(v, 1, 2) * s[:, None] @ v)
    quaternions = Rotation.from_matrix(turns).as_quat()
    for i in range(1, len(quaternions)):
        if quaternions[i] @ quaternions[i - 1] < 0.0:
            quaternions[i] *= -1.0  # the shorter way
    turn = Rotation.from_quat(curve(frames, quaternions, frame)).as_matrix()
    linear = turn @ curve(frames, stretches, frame)
    middle = curve(frames, matrices[:, :, :3] @ centre + matrices[:, :, 3], frame)
    return np.column_stack([linear, middle - linear @ centre])


# ---- the text ------------------------------------------------------------------------------------------------------------


def mesh_key(line: Line) -> MeshKey:
    """Return the key in a `mesh` line; raise InputError."""
    if len(line.args) not in (5, 9, 14):
        raise line.error(f"'mesh' has {len(line.args)} values; expected: {MESH}")
    frame, *values = _numbers(line, line.args[1:], MESH)
    name, given = line.args[0], tuple(values)
    if len(given) == 3:
        return MeshKey(name, frame, given, line=line)
    if len(given) == 7:
        axis = np.array(given[4:])
        if not axis.any():
            raise line.error(f"the axis of the rotation is 0 0 0; expected: {MESH}")
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_rotvec(given[3] * axis / np.linalg.norm(axis), degrees=True).as_matrix()
        return MeshKey(name, frame, given[:3], tuple(turn.ravel().tolist()), line=line)
    try:
        affine(np.reshape(given, (3, 4)))
    except InputError as error:
        raise line.error(str(error)) from None
    return MeshKey(name, frame, matrix=given, line=line)


def light_key(line: Line) -> LightKey:
    """Return the key in a `light` line; raise InputError."""
    if len(line.args) != 6:
        raise line.error(f"'light' has {len(line.args)} values; expected: {LIGHT}")
    if not line.args[0].isdecimal() or len(line.args[0]) > 6:
        raise line.error(f"{quote(line.args[0])} is no number of a light, counted from 0; expected: {LIGHT}")
    if line.args[2] not in _FIELDS:
        raise line.error(f"unknown value {quote(line.args[2])} of a light; expected: {LIGHT}")
    value = line.args[2]
    frame, x, y, z = _numbers(line, (line.args[1], *line.args[3:]), LIGHT)
    if value == "color" and min(x, y, z) < 0.0:
        raise line.error(f"a colour is not negative; expected: {LIGHT}")
    return LightKey(int(line.args[0]), frame, value, (x, y, z), line)


def _numbers(line: Line, words: Sequence[str], usage: str) -> tuple[float, ...]:
    try:
        return tuple(number(word) for word in words)
    except ValueError as error:
        raise line.error(f"{error}; expected: {usage}") from None


def _error(line: Line | None, message: str) -> InputError:
    return InputError(message) if line is None else line.error(message)
