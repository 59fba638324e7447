"""Camera paths: a smooth curve through its keys, by valid cameras only, and the text file of its keys."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path as File

import numpy as np
import pytest

from irrsplat.core.errors import InputError
from irrsplat.scene import Camera, load
from irrsplat.scene.camera_path import Path, camera_flags, camera_line, load_path, path_text

FLIGHT = File(__file__).resolve().parents[2] / "scenes/cornell/flight.path"
ORIGIN = (0.0, 0.0, 0.0)


def view(camera: Camera) -> np.ndarray:
    """(3,): the unit view direction."""
    return -camera.axes[2]


def random_camera(rng: np.random.Generator, scale: float = 1.0) -> Camera:
    eye, gaze, up = rng.normal(size=(3, 3)) * np.array([[1.0], [scale], [1.0]])
    return Camera(tuple(eye), tuple(eye + gaze), tuple(up), float(rng.uniform(10.0, 120.0)))


# ---- the curve -----------------------------------------------------------------------------------------------------------


def test_it_passes_through_its_keys() -> None:
    rng = np.random.default_rng(1)
    keys = tuple(random_camera(rng) for _ in range(4))
    path = Path(keys, 31)  # keys at frames 0, 10, 20 and 30
    assert [path.camera(frame) for frame in (0, 10, 20, 30)] == list(keys)
    assert Path(keys, 12).camera(11) == keys[-1]  # 11 frames do not divide into three: the ends still hold
    assert (path.camera(-5), path.camera(99)) == (keys[0], keys[-1])
    assert list(path) == [path.camera(frame) for frame in range(31)]
    assert len({camera.eye for camera in path}) == 31


def test_one_key_is_a_still_and_one_frame_the_first_key() -> None:
    one, other = Camera((0, 0, 5), ORIGIN), Camera((0, 0, 9), ORIGIN)
    assert set(Path((one,), 4)) == {one}
    assert list(Path((one, other), 1)) == [one]


def test_straight_uniform_motion_stays_so() -> None:
    """Catmull and Rom's spline has linear precision: Σw = 1 and Σw·k = t for neighbours -1, 0, 1, 2 (their 1974 paper).

    In the first segment the end key counts twice: -1 is 0 there, which adds w(-1) = -t/2 + t² - t³/2 to Σw·k = t, so that
    the camera sets off gently from half the speed; the last segment is its mirror image.
    """
    step, offset = np.array([0.5, 0.25, -1.0]), np.array([1.0, -0.5, 2.0])
    keys = tuple(Camera(tuple(k * step), tuple(k * step + offset), (0, 1, 0), 40.0) for k in range(6))
    path = Path(keys, 51)
    for frame in np.linspace(0.0, 50.0, 201):
        camera, s = path.camera(frame), frame / 10.0
        t = s if s < 1.0 else 5.0 - s
        lag = -t / 2 + t**2 - t**3 / 2 if t < 1.0 else 0.0
        along = s + lag if s < 1.0 else s - lag
        np.testing.assert_allclose(camera.eye, along * step, atol=1e-12)
        np.testing.assert_allclose(camera.target, along * step + offset, atol=1e-12)
        assert camera.fov == pytest.approx(40.0, rel=1e-12)
        np.testing.assert_allclose(camera.up, (0, 1, 0), atol=1e-12)


def test_an_orbit_keeps_its_centre_in_view() -> None:
    """Keys at one distance from the centre have views -(eye - centre)/R: the same weights make both, so they stay parallel."""
    centre, angles = np.array([3.0, 1.0, -2.0]), np.radians(np.arange(0, 361, 60))
    eyes = centre + 4.0 * np.stack([np.cos(angles), 0.5 + 0 * angles, np.sin(angles)], axis=1)
    path = Path(tuple(Camera(tuple(eye), tuple(centre)) for eye in eyes), 61)
    for frame in np.linspace(0.0, 60.0, 121):
        camera = path.camera(frame)
        to_centre = centre - camera.eye
        np.testing.assert_allclose(view(camera), to_centre / np.linalg.norm(to_centre), atol=1e-12)


def test_far_and_near_targets_do_not_throw_the_view_about() -> None:
    """All keys look along -z, at targets 1 m and 1 km away: so does every camera between them, from a distance in between."""
    keys = tuple(Camera((k, 0, 0), (k, 0, -distance)) for k, distance in enumerate((1000.0, 1.0, 1.0, 1000.0)))
    for camera in Path(keys, 91):
        np.testing.assert_allclose(view(camera), (0, 0, -1), atol=1e-12)
        assert 0.1 < math.dist(camera.eye, camera.target) < 10000.0


@pytest.mark.parametrize("seed", range(6))
def test_it_bends_nowhere(seed: int) -> None:
    """C1: at each inner key the slopes of both sides agree, of eye, view, up and field of view.
    The second turn is nearly back, exactly so for seed 0: there the view swings out to the side."""
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
    """A level camera turns by 180° on the spot: halfway it looks to its right, level, and never twice the same way."""
    path = Path((Camera(ORIGIN, (0, 0, -1)), Camera(ORIGIN, (0, 0, 1))), 101)
    np.testing.assert_allclose(view(path.camera(50)), (1, 0, 0), atol=1e-12)
    headings = [math.atan2(v[0], -v[2]) for v in map(view, path)][:-1]  # the last is ±180°
    assert all(a < b for a, b in pairwise(headings))
    assert all(abs(v[1]) < 1e-12 for v in map(view, path))


def test_over_the_pole_up_is_carried_along() -> None:
    """From 45° down ahead to 45° down behind by way of straight down, where the common up (0 1 0) is no up: there the top of the
    picture is what was ahead of the nearer key, as when a head is bowed."""
    path = Path((Camera(ORIGIN, (0, -1, -1)), Camera(ORIGIN, (0, -1, 1))), 11)
    down = path.camera(5)
    np.testing.assert_allclose(view(down), (0, -1, 0), atol=1e-12)
    np.testing.assert_allclose(down.axes[1], (0, 0, 1), atol=1e-9)  # halfway, the second key counts as the nearer one


def test_no_path_leads_through_an_invalid_camera() -> None:
    """Keys on a coarse grid, so that views oppose each other, ups lie along views and eyes in targets; and wild scales."""
    rng = np.random.default_rng(5)
    for i in range(120):
        spread = (lambda: 1.0, lambda: 10.0 ** rng.uniform(-12, 12))[i % 2]
        keys: list[Camera] = []
        while len(keys) < 3:
            eye, gaze, up = (rng.integers(-1, 2, 3) * spread() for _ in range(3))
            try:
                keys.append(Camera(tuple(eye), tuple(eye + gaze), tuple(up), float(rng.choice([1e-9, 45.0, 179.9999999]))))
            except InputError:  # not a valid key
                continue
        path = Path(tuple(keys), 20)
        for frame in (*range(20), 4.75, 9.4999999, 9.5, 9.5000001):  # a key is at 9.5
            camera = path.camera(frame)  # Camera checks itself
            assert np.isfinite(camera.view_from_world).all()


@pytest.mark.parametrize(
    ("keys", "frames", "frame", "says"),
    [(0, 3, 0, "at least one camera"), (1, 0, 0, "at least 1 frame"), (1, 3, math.nan, "finite"), (1, 3, math.inf, "finite")],
)
def test_a_path_without_keys_or_frames_is_refused_and_so_is_a_frame_that_is_no_number(
    keys: int, frames: int, frame: float, says: str
) -> None:
    with pytest.raises(InputError, match=says):
        Path((Camera((0, 0, 1), ORIGIN),) * keys, frames).camera(frame)


# ---- the text ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def read(tmp_path: File) -> Callable[..., Path]:
    def read(text: str, **options: float) -> Path:
        (tmp_path / "a.path").write_text(text)
        return load_path(tmp_path / "a.path", **options)

    return read


def test_what_a_file_says(read: Callable[..., Path]) -> None:
    text = "# a path\n\ncam 0 0 5  0 0 0  0 1 0  # first\ncam left -1 .5 5e0 0 0 0 0 0 2\n"
    path = read(text, fov=30.0)
    assert path.keys == (Camera((0, 0, 5), ORIGIN, (0, 1, 0), 30.0), Camera((-1, 0.5, 5), ORIGIN, (0, 0, 2), 30.0))
    assert path.frames == 31  # 30 from key to key, and the last
    assert read(text + "frames 7\n").frames == 7
    assert read(text).keys[0].fov == 45.0
    assert read("cam 0 0 5 0 0 0 0 1 0").frames == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# nothing\n", "a.path: there is no 'cam' line; expected at least one: cam EX"),
        ("frames 3\n", "a.path: there is no 'cam' line"),
        ("", "empty"),
        ("cam 0 0 5 0 0 0 0 1 0\nobj a.obj\n", "a.path:2: unknown word 'obj'; a path knows cam, frames, mesh and light"),
        ("cam 0 0 5 0 0 0 0 1\n", "a.path:1: 'cam' has 8 values; expected: cam EX EY EZ TX TY TZ UX UY UZ"),
        ("cam 0 0 5 0 0 0 0 1 0 0\n", "a.path:1: 'cam' has 10 values"),
        ("cam a b 0 0 5 0 0 0 0 1 0\n", "a.path:1: 'cam' has 11 values"),
        ("cam 0 0 x 0 0 0 0 1 0\n", "a.path:1: 'x' is not a number; expected: cam EX"),
        ("cam 0 0 inf 0 0 0 0 1 0\n", "a.path:1: 'inf' is not a finite number"),
        ("cam 0 0 5 0 0 5 0 1 0\n", "a.path:1: the camera's eye lies at its target"),
        ("cam 0 0 5 0 0 0 0 0 1\n", "a.path:1: the camera's up vector is parallel"),
        ("cam 0 0 5 0 0 0 0 1 0\nframes 0\n", "a.path:2: expected: frames N, a whole number of at least 1"),
        ("cam 0 0 5 0 0 0 0 1 0\nframes -3\n", "a.path:2: expected: frames N"),
        ("cam 0 0 5 0 0 0 0 1 0\nframes 2.5\n", "a.path:2: expected: frames N"),
        ("cam 0 0 5 0 0 0 0 1 0\nframes\n", "a.path:2: expected: frames N"),
        ("cam 0 0 5 0 0 0 0 1 0\nframes 3 4\n", "a.path:2: expected: frames N"),
        ("frames 3\ncam 0 0 5 0 0 0 0 1 0\nframes 3\n", "a.path:3: 'frames' is given twice; first in line 1"),
    ],
)
def test_what_a_file_may_not_say(text: str, words: str, read: Callable[..., Path]) -> None:
    with pytest.raises(InputError) as caught:
        read(text)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_path_is_read_back_bit_by_bit(read: Callable[..., Path]) -> None:
    rng = np.random.default_rng(7)
    keys = tuple(random_camera(rng, 1e-3) for _ in range(5))
    again = read(path_text(Path(keys, 77)))
    assert again.frames == 77
    assert [(k.eye, k.target, k.up) for k in again.keys] == [(k.eye, k.target, k.up) for k in keys]


def test_a_camera_as_a_line_and_as_flags(read: Callable[..., Path]) -> None:
    camera = Camera((1 / 3, -2e-7, 1234567.0), (np.float64(0.5), 0, -1), (0, 1, 0), 39.3077, name="side")
    assert camera_line(camera) == "cam 0.333333 -2e-07 1234567  0.5 0 -1  0 1 0"
    assert camera_flags(camera) == "--eye 0.333333 -2e-07 1234567 --target 0.5 0 -1 --up 0 1 0 --fov 39.3077"
    read(camera_line(camera))


def test_a_line_is_a_valid_camera_whatever_six_digits_make_of_it(read: Callable[..., Path]) -> None:
    """At 1234567 m, six digits are 10 m apart: eye and target would coincide, so they are written in full."""
    close = Camera((1234567.25, 0, 0), (1234567.5, 0, 0))
    (key,) = read(camera_line(close)).keys
    assert (key.eye, key.target) == (close.eye, close.target)
    assert "1234567.25" in camera_flags(close)
    assert "--fov 179.99999999" in camera_flags(Camera((0, 0, 1), ORIGIN, fov=179.99999999))


def test_the_bundled_flight() -> None:
    """It begins and ends where the scene's own camera stands, and never leaves through a wall."""
    scene = load("cornell")
    home = scene.camera()
    path = load_path(FLIGHT, home.fov)
    assert path.frames == 90 and 5 <= len(path.keys) <= 8
    assert (path.keys[0], path.keys[-1]) == (home, home)
    eyes = np.array([camera.eye for camera in path])
    assert (eyes[:, :2] > 0.1).all() and (eyes[:, :2] < scene.bounds[1, :2] - 0.1).all()
    assert (eyes[:, 2] < 0.5).all()  # before the blocks, the nearest of which begins at 0.65 m
