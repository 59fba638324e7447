"""Paths of cameras, meshes and lights: smooth curves through the keys, their text file, and the differences after a step."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from itertools import pairwise
from pathlib import Path as File

import numpy as np
import pytest

from irrsplat.core.errors import InputError
from irrsplat.scene import Camera
from irrsplat.scene.camera_path import Path, load_path, path_text
from irrsplat.scene.model import Light, Scene
from tests.support.worlds import box, floor, point_light, scene

Read = Callable[..., Path]
ORIGIN = (0.0, 0.0, 0.0)
CAM = "frames 21\ncam 0 0 5 0 0 0 0 1 0\n"


def view(camera: Camera) -> np.ndarray:
    """Return (3,) the unit view direction."""
    return -camera.axes[2]


def random_camera(rng: np.random.Generator, scale: float = 1.0) -> Camera:
    eye, gaze, up = rng.normal(size=(3, 3)) * np.array([[1.0], [scale], [1.0]])
    return Camera(tuple(eye), tuple(eye + gaze), tuple(up), float(rng.uniform(10.0, 120.0)))


def world() -> Scene:
    """Return a floor, a box about (1, 2, 3), a point light and a spot."""
    spot = Light((0, 5, 0), (1, 1, 1), spot_target=(0, 0, 0), spot_cutoff=20.0)
    return scene(floor(9.0), box((0, 1, 2), (2, 3, 4)), lights=(point_light((0, 3, 0)), spot))


def test_the_curve_passes_through_its_keys() -> None:
    rng = np.random.default_rng(1)
    keys = tuple(random_camera(rng) for _ in range(4))
    path = Path(keys, 31)  # keys at frames 0, 10, 20 and 30
    assert [path.camera(frame) for frame in (-5, 0, 10, 20, 30, 99)] == [keys[0], *keys, keys[-1]]
    assert Path(keys, 12).camera(11) == keys[-1]  # 11 frames do not divide into three: the ends still hold
    assert set(Path(keys[:1], 4)) == set(keys[:1]) and list(Path(keys, 1)) == [keys[0]]
    for count, frames, frame, message in ((0, 3, 0.0, "at least one camera"), (1, 0, 0.0, "1 frame"), (1, 3, math.nan, "finite")):
        with pytest.raises(InputError, match=message):
            Path(keys[:count], frames).camera(frame)


def test_uniform_motion_on_a_line_is_exact() -> None:
    """The spline of Catmull and Rom has linear precision: Σw = 1 and Σw·k = t for neighbours -1, 0, 1, 2 (their 1974 paper). In
    the first segment the end key counts twice: -1 is 0 there, which adds w(-1) = -t/2 + t² - t³/2 to Σw·k = t, so that the
    camera starts at half the speed; the last segment is its mirror image."""
    step, offset = np.array([0.5, 0.25, -1.0]), np.array([1.0, -0.5, 2.0])
    keys = tuple(Camera(tuple(k * step), tuple(k * step + offset), (0, 1, 0), 40.0) for k in range(6))
    path = Path(keys, 51)
    for frame in np.linspace(0.0, 50.0, 201):
        camera, s = path.camera(frame), frame / 10.0
        t = s if s < 1.0 else 5.0 - s
        lag = -t / 2 + t**2 - t**3 / 2 if t < 1.0 else 0.0
        travelled = s + lag if s < 1.0 else s - lag
        np.testing.assert_allclose(camera.eye, travelled * step, atol=1e-12)
        np.testing.assert_allclose(camera.target, travelled * step + offset, atol=1e-12)
        assert camera.fov == pytest.approx(40.0, rel=1e-12)
        np.testing.assert_allclose(camera.up, (0, 1, 0), atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_the_curve_has_no_kink(seed: int) -> None:
    """C1: at each inner key both slopes agree, of eye, view, up and field of view. The second turn is nearly back, exactly so for
    seed 0: there the view swings to the side."""
    rng = np.random.default_rng(seed)
    keys = [random_camera(rng) for _ in range(5)]
    gaze = np.subtract(keys[1].target, keys[1].eye)
    keys[2] = Camera(keys[2].eye, tuple(keys[2].eye - gaze * (1.0 if seed == 0 else rng.uniform(0.7, 1.3, 3))), keys[1].up)
    path, h = Path(tuple(keys), 5), 1e-6

    def state(camera: Camera) -> np.ndarray:
        return np.array([*camera.eye, *view(camera), *np.divide(camera.up, np.linalg.norm(camera.up)), camera.fov / 90.0])

    for k in (1, 2, 3):
        here = state(path.camera(k))
        before, after = (here - state(path.camera(k - h))) / h, (state(path.camera(k + h)) - here) / h
        np.testing.assert_allclose(before, after, atol=1e-3 * (1.0 + np.abs(before).max()))
    states = np.array([state(path.camera(f)) for f in np.linspace(0.0, 4.0, 401)])
    assert np.abs(np.diff(states[:, :6], axis=0)).max() < 0.05  # and no jump between them


def test_a_turn_back_is_a_turn_to_the_side() -> None:
    """A level camera turns by 180° on the spot: halfway its view is to the right, level, and no direction occurs twice."""
    path = Path((Camera(ORIGIN, (0, 0, -1)), Camera(ORIGIN, (0, 0, 1))), 101)
    np.testing.assert_allclose(view(path.camera(50)), (1, 0, 0), atol=1e-12)
    headings = [math.atan2(v[0], -v[2]) for v in map(view, path)][:-1]  # the last is ±180°
    assert all(a < b for a, b in pairwise(headings))
    assert all(abs(v[1]) < 1e-12 for v in map(view, path))


def test_over_the_pole_up_is_carried_along() -> None:
    """From 45° down ahead to 45° down behind by way of straight down, where the common up (0 1 0) is invalid. There the top of
    the picture is the forward direction of the nearer key, as for a bowed head."""
    down = Path((Camera(ORIGIN, (0, -1, -1)), Camera(ORIGIN, (0, -1, 1))), 11).camera(5)
    np.testing.assert_allclose(view(down), (0, -1, 0), atol=1e-12)
    np.testing.assert_allclose(down.axes[1], (0, 0, 1), atol=1e-9)  # halfway, the second key counts as the nearer one


def test_no_path_leads_through_an_invalid_camera() -> None:
    """Keys on a coarse grid, so that views oppose each other, ups lie along views and eyes in targets."""
    rng = np.random.default_rng(5)
    keys: list[Camera] = []
    while len(keys) < 120:
        eye, gaze, up = rng.integers(-1, 2, (3, 3)).tolist()
        with suppress(InputError):  # no valid key
            keys.append(Camera(eye, tuple(np.add(eye, gaze)), up, float(rng.choice([1e-9, 45.0, 179.9999999]))))
    for camera in Path(tuple(keys), 477):  # Camera checks itself
        assert np.isfinite(camera.view_from_world).all()


@pytest.fixture
def read(tmp_path: File) -> Read:
    def read(text: str, **options: float) -> Path:
        (tmp_path / "a.path").write_text(text)
        return load_path(tmp_path / "a.path", **options)

    return read


def test_a_file_s_keys_and_frames(read: Read) -> None:
    text = "# a path\n\ncam 0 0 5  0 0 0  0 1 0  # first\ncam left -1 .5 5e0 0 0 0 0 0 2\n"
    path = read(text, fov=30.0)
    assert path.keys == (Camera((0, 0, 5), ORIGIN, (0, 1, 0), 30.0), Camera((-1, 0.5, 5), ORIGIN, (0, 0, 2), 30.0))
    assert (path.frames, read(text + "frames 7\n").frames) == (31, 7)  # 30 from key to key, and the last


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# nothing\n", "a.path: there is no 'cam' line; expected at least one: cam EX"),
        ("", "empty"),
        (CAM + "obj a.obj\n", "a.path:3: unknown word 'obj'; expected cam or frames"),
        ("cam 0 0 5 0 0 0 0 1\n", "a.path:1: 'cam' has 8 values; expected: cam EX EY EZ TX TY TZ UX UY UZ"),
        ("cam a b 0 0 5 0 0 0 0 1 0\n", "a.path:1: 'cam' has 11 values"),
        ("cam 0 0 x 0 0 0 0 1 0\n", "a.path:1: 'x' is not a number; expected: cam EX"),
        ("cam 0 0 inf 0 0 0 0 1 0\n", "a.path:1: 'inf' is not a finite number"),
        ("cam 0 0 5 0 0 5 0 1 0\n", "a.path:1: the camera's eye lies at its target"),
        (CAM[10:] + "frames 0\n", "a.path:2: expected: frames N, a whole number of at least 1"),
        (CAM[10:] + "frames 2.5\n", "a.path:2: expected: frames N"),
        (CAM[10:] + "frames 3 4\n", "a.path:2: expected: frames N"),
        (CAM + "frames 3\n", "a.path:3: 'frames' is given twice; first in line 1"),
    ],
)
def test_an_invalid_path_file_is_one_line(read: Read, text: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        read(text)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_path_is_read_back_bit_by_bit(read: Read) -> None:
    rng = np.random.default_rng(7)
    keys = tuple(random_camera(rng, 1e-3) for _ in range(5))
    again = read(path_text(Path(keys, 77)))
    assert [(k.eye, k.target, k.up, again.frames) for k in again.keys] == [(k.eye, k.target, k.up, 77) for k in keys]
