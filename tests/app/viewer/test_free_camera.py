"""The flight: what each motion keeps and what it changes, derived from rotations; and that no sequence breaks the camera."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from irrsplat.app.viewer.input.free_camera import FAR, NEAR, STALL, FreeCamera
from irrsplat.core.errors import InputError
from irrsplat.scene import bundled, load
from irrsplat.scene.model import Camera

DIAGONAL = 12.0
Y, Z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
PLAIN = Camera((0.0, 1.0, 5.0), (0.0, 1.0, 0.0), name="plain")  # looks down -z; its right is +x
OBLIQUE = Camera((3.0, 2.5, 4.0), (-1.0, 0.5, 0.3), fov=60.0)
ROLLED = Camera((3.0, 2.5, 4.0), (-1.0, 0.5, 0.3), (math.sin(0.4), math.cos(0.4), 0.0))
PIVOT = (0.4, 0.2, -0.7)
DEGREE = math.radians(1.0)  # per pixel: one pixel turns by one degree

eye = lambda flight: np.array(flight.camera.eye)  # noqa: E731
forward = lambda flight: -flight.camera.axes[2]  # noqa: E731
right = lambda flight: flight.camera.axes[0]  # noqa: E731


def on_screen(camera: Camera, point: tuple[float, float, float]) -> np.ndarray:
    """(2,) where the camera sees `point`, in units of the distance along its axis."""
    x, y, z = camera.axes @ np.subtract(point, camera.eye)
    return np.array([x, y]) / -z


def pitch(flight: FreeCamera, up: tuple[float, float, float] = Y) -> float:
    return math.degrees(math.asin(np.clip(forward(flight) @ up, -1.0, 1.0)))


def roll_free(flight: FreeCamera, up: tuple[float, float, float] = Y) -> bool:
    """A level horizon: right is perpendicular to the world's up, and the picture's up is not below it."""
    return abs(right(flight) @ up) < 1e-9 and float(flight.camera.axes[1] @ up) > 0.0


@pytest.mark.parametrize("camera", [PLAIN, OBLIQUE])
def test_a_quarter_turn_faces_the_former_right(camera: Camera) -> None:
    # about the world's up by 90°: the level part of the old right becomes the heading, at the same pitch p:
    # forward' = cos p · right + sin p · up, and right, being level already, is that part whole
    flight = FreeCamera(camera, DIAGONAL)
    side, p = right(flight), math.radians(pitch(flight))
    flight.look(90, 0, DEGREE)
    np.testing.assert_allclose(forward(flight), math.cos(p) * side + math.sin(p) * np.array(Y), atol=1e-12)
    assert flight.camera.eye == camera.eye


def test_the_mouse_down_looks_down_and_four_quarters_are_none() -> None:
    flight = FreeCamera(PLAIN, DIAGONAL)
    flight.look(0, 30, DEGREE)
    assert pitch(flight) == pytest.approx(-30.0)
    before = forward(flight)
    for _ in range(4):
        flight.look(90, 0, DEGREE)
    np.testing.assert_allclose(forward(flight), before, atol=1e-12)


@pytest.mark.parametrize("turn", [FreeCamera.look, lambda flight, *d: flight.orbit(PIVOT, *d)])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_pitch_ends_short_of_the_pole(turn: Callable[..., None], sign: int) -> None:
    flight = FreeCamera(OBLIQUE, DIAGONAL)
    heading = forward(flight)[[0, 2]] / np.linalg.norm(forward(flight)[[0, 2]])
    turn(flight, 0, 1000 * sign, DEGREE)
    assert pitch(flight) == pytest.approx(-89.0 * sign)
    assert roll_free(flight)
    # it did not flip over the pole: the heading, 1/57 of the forward's length here, is the same
    np.testing.assert_allclose(forward(flight)[[0, 2]] / math.cos(math.radians(89.0)), heading, atol=1e-9)
    stopped = flight.camera
    turn(flight, 0, 3 * sign, DEGREE)
    assert flight.camera is stopped  # a mouse pushed against the stop draws nothing anew


def test_the_speed_is_the_same_in_every_direction() -> None:
    # the view is level: right, ahead and up are perpendicular, so that a cube's diagonal would be √3 times as fast
    keys = np.array(np.meshgrid(*[[-1, 0, 1]] * 3)).reshape(3, -1).T
    for one in keys[np.any(keys != 0, axis=1)]:
        flight = FreeCamera(PLAIN, DIAGONAL)
        right, up, ahead = one
        flight.move(right, up, ahead, 0.1)
        assert np.linalg.norm(eye(flight) - PLAIN.eye) == pytest.approx(0.1 * DIAGONAL / 6)
        np.testing.assert_allclose((eye(flight) - PLAIN.eye) @ (one * [1, 1, -1]) > 0, True)  # ahead is -z


def test_half_a_key_is_half_as_fast_and_the_pace_multiplies() -> None:
    way = {}
    for name, key, pace in (("whole", 1.0, 1.0), ("half", 0.5, 1.0), ("shift", 1.0, 4.0), ("beyond", 7.0, 1.0)):
        flight = FreeCamera(PLAIN, DIAGONAL)
        flight.move(0, 0, key, 0.1, pace)
        way[name] = PLAIN.eye[2] - flight.camera.eye[2]
    assert way == pytest.approx({"whole": 0.2, "half": 0.1, "shift": 0.8, "beyond": 0.2})  # 12 m / 6 s · 0.1 s


def test_ahead_is_the_views_and_up_is_the_worlds() -> None:
    flight = FreeCamera(OBLIQUE, DIAGONAL)
    flight.move(0, 0, 1, 0.1)
    np.testing.assert_allclose(eye(flight) - OBLIQUE.eye, 0.2 * forward(flight), atol=1e-12)
    flight = FreeCamera(OBLIQUE, DIAGONAL)
    flight.move(0, 1, 0, 0.1)
    np.testing.assert_allclose(eye(flight) - OBLIQUE.eye, [0, 0.2, 0], atol=1e-12)


@pytest.mark.parametrize(
    "whole, half",
    [
        (lambda f: f.move(1, -0.3, 1, 0.2), lambda f: f.move(1, -0.3, 1, 0.1)),
        (lambda f: f.look(8, 6, 0.01), lambda f: f.look(4, 3, 0.01)),
        (lambda f: f.orbit(PIVOT, 8, 6, 0.01), lambda f: f.orbit(PIVOT, 4, 3, 0.01)),
        (lambda f: f.dolly(3, PIVOT), lambda f: f.dolly(1.5, PIVOT)),
        (lambda f: f.dolly(-3), lambda f: f.dolly(-1.5)),
        (lambda f: f.change_speed(3), lambda f: f.change_speed(1.5)),
    ],
    ids=["move", "look", "orbit", "dolly", "dolly out", "speed"],
)
@pytest.mark.parametrize("camera", [PLAIN, OBLIQUE, ROLLED], ids=["plain", "oblique", "rolled"])
def test_two_half_steps_are_one_whole(
    camera: Camera, whole: Callable[[FreeCamera], None], half: Callable[[FreeCamera], None]
) -> None:
    one, two = FreeCamera(camera, DIAGONAL), FreeCamera(camera, DIAGONAL)
    whole(one)
    half(two)
    half(two)
    assert one.speed == pytest.approx(two.speed)
    for part in ("eye", "target", "up"):
        np.testing.assert_allclose(getattr(one.camera, part), getattr(two.camera, part), atol=1e-12)


def test_a_stall_counts_a_quarter_second() -> None:
    flight, slow = FreeCamera(PLAIN, DIAGONAL), FreeCamera(PLAIN, DIAGONAL)
    flight.move(0, 0, 1, STALL)
    slow.move(0, 0, 1, 2.0)
    assert slow.camera == flight.camera
    before = slow.camera
    slow.move(0, 0, 1, -1.0)  # a clock that went back
    assert slow.camera is before


@pytest.mark.parametrize("camera", [PLAIN, OBLIQUE, ROLLED], ids=["plain", "oblique", "rolled"])
def test_the_same_camera_where_nothing_moved(camera: Camera) -> None:
    flight = FreeCamera(camera, DIAGONAL)
    for _ in range(2):
        before = flight.camera
        flight.look(0, 0, DEGREE)
        flight.orbit(PIVOT, 0, 0, DEGREE)
        flight.dolly(0)
        flight.dolly(0, PIVOT)
        flight.move(0, 0, 0, 0.1)
        flight.move(1, 1, 1, 0.0)
        flight.change_speed(2)
        assert flight.camera is before
        flight.look(3, 4, DEGREE)
        flight.move(0.3, 0.1, 1, 0.1)
        assert flight.camera != before
    assert flight.camera.fov == camera.fov


@pytest.mark.parametrize("camera", [PLAIN, OBLIQUE], ids=["plain", "oblique"])
@pytest.mark.parametrize("pivot", [PIVOT, (-2.0, 3.0, -1.0), (3.0, 2.5, 9.0)])
def test_an_orbit_keeps_the_pivot_in_its_place(camera: Camera, pivot: tuple[float, float, float]) -> None:
    # the view space position of the pivot stays, so its distance does, and its place on the screen, even behind the eye
    flight = FreeCamera(camera, DIAGONAL)
    for dx, dy in [(40, 0), (0, 15), (-170, -60), (13, 400)]:
        flight.orbit(pivot, dx, dy, DEGREE)
        assert np.linalg.norm(eye(flight) - pivot) == pytest.approx(math.dist(camera.eye, pivot))
        np.testing.assert_allclose(on_screen(flight.camera, pivot), on_screen(camera, pivot), atol=1e-9)
        assert roll_free(flight)


def test_an_orbit_by_hand() -> None:
    # PLAIN looks along -z at the pivot, 5 m ahead. The hand drags the scene to the right by 90°: its left side comes to the
    # front, so the eye stands 5 m to the left of the pivot, at -x, and looks along +x
    flight = FreeCamera(PLAIN, DIAGONAL)
    flight.orbit((0, 1, 0), 90, 0, DEGREE)
    np.testing.assert_allclose(eye(flight), [-5, 1, 0], atol=1e-12)
    np.testing.assert_allclose(forward(flight), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(flight.camera.target, [0, 1, 0], atol=1e-12)
    flight.orbit((0, 1, 0), 0, 30, DEGREE)  # dragged down: its top comes to the front, the eye is 5 m · sin 30° above it
    np.testing.assert_allclose(eye(flight), [-5 * math.cos(math.radians(30)), 1 + 2.5, 0], atol=1e-12)


def test_a_step_of_the_wheel_leaves_nine_tenths() -> None:
    flight = FreeCamera(PLAIN, DIAGONAL)
    flight.dolly(1)
    np.testing.assert_allclose(eye(flight), [0, 1, 4.5])
    flight.dolly(1, (0.0, 11.0, 4.5))  # 10 m above, out of sight: one metre towards it, and the view does not turn
    np.testing.assert_allclose(eye(flight), [0, 2, 4.5])
    np.testing.assert_allclose(forward(flight), [0, 0, -1])
    flight.home()
    flight.dolly(7, PIVOT)
    np.testing.assert_allclose(on_screen(flight.camera, PIVOT), on_screen(PLAIN, PIVOT), atol=1e-12)  # zoom to the cursor
    flight.dolly(-7, PIVOT)
    np.testing.assert_allclose(flight.camera.eye, PLAIN.eye, atol=1e-12)


@pytest.mark.parametrize("pivot", [None, PIVOT, PLAIN.target])
def test_a_dolly_never_passes_the_pivot(pivot: tuple[float, float, float] | None) -> None:
    flight = FreeCamera(PLAIN, DIAGONAL)
    point = np.array(PLAIN.target if pivot is None else pivot)
    for steps in [3] * 40 + [1e9, math.inf]:
        flight.dolly(steps, pivot)
        offset = eye(flight) - point
        assert np.linalg.norm(offset) >= NEAR * DIAGONAL * (1 - 1e-9)
        assert offset @ (PLAIN.eye - point) > 0.0  # still on the side that it came from
    assert np.linalg.norm(offset) == pytest.approx(NEAR * DIAGONAL)
    stopped = eye(flight)
    flight.dolly(5, pivot)
    np.testing.assert_allclose(eye(flight), stopped, atol=1e-12)


def test_a_dolly_away_from_the_eye_itself_goes_backward() -> None:
    flight = FreeCamera(PLAIN, DIAGONAL)
    flight.dolly(1, PLAIN.eye)
    assert flight.camera is PLAIN
    flight.dolly(-1, PLAIN.eye)
    np.testing.assert_allclose(flight.camera.eye, [0, 1, 5 + NEAR * DIAGONAL])


def test_the_target_lies_at_the_distance_of_the_last_pivot() -> None:
    # the depth of a pivot (0.4, 0.2, -0.7) before PLAIN, which looks down -z from z = 5, is 5.7
    flight = FreeCamera(PLAIN, DIAGONAL)
    flight.orbit(PIVOT, 10, 5, DEGREE)
    assert math.dist(flight.camera.eye, flight.camera.target) == pytest.approx(5.7)
    flight.move(0, 0, 1, 0.2)
    assert math.dist(flight.camera.eye, flight.camera.target) == pytest.approx(5.7)
    flight.orbit((0.0, 0.0, 100.0), 10, 5, DEGREE)  # behind the eye: no target there
    assert math.dist(flight.camera.eye, flight.camera.target) == pytest.approx(5.7)


def test_the_speed_is_bounded() -> None:
    flight = FreeCamera(PLAIN, DIAGONAL)
    flight.change_speed(2)
    assert flight.speed == pytest.approx(DIAGONAL / 6 * 1.44)
    flight.change_speed(1e6)
    assert flight.speed == pytest.approx(10 * DIAGONAL)
    flight.change_speed(-1e6)
    assert flight.speed == pytest.approx(DIAGONAL / 1000)


def test_home_and_go_jump_to_their_cameras() -> None:
    flight = FreeCamera(PLAIN, DIAGONAL)
    flight.look(10, 10, DEGREE)
    assert flight.camera.name == ""  # no longer the scene's own
    flight.go(OBLIQUE)
    assert flight.camera is OBLIQUE
    flight.move(0, 0, 1, 0.1)
    np.testing.assert_allclose(flight.camera.axes, OBLIQUE.axes, atol=1e-12)
    flight.home()
    assert flight.camera is PLAIN
    flight.look(90, 0, DEGREE)  # from the first camera's heading, not from where it came
    np.testing.assert_allclose(forward(flight), [1, 0, 0], atol=1e-12)


def test_a_roll_stays_until_the_first_look() -> None:
    flight = FreeCamera(ROLLED, DIAGONAL)
    flight.move(1, 1, 1, 0.1)
    flight.dolly(2)
    np.testing.assert_allclose(flight.camera.axes, ROLLED.axes, atol=1e-12)
    straight = forward(flight)
    flight.look(1e-9, 0, DEGREE)
    assert roll_free(flight)
    np.testing.assert_allclose(forward(flight), straight, atol=1e-9)  # levelled about the view, not turned away


def test_an_orbit_levels_about_the_pivot() -> None:
    # the pivot's place in view space stays while the roll goes: its distance and its place on the screen hold here too
    flight = FreeCamera(ROLLED, DIAGONAL)
    flight.orbit(PIVOT, 2, 1, DEGREE)
    assert roll_free(flight)
    np.testing.assert_allclose(on_screen(flight.camera, PIVOT), on_screen(ROLLED, PIVOT), atol=1e-9)
    assert np.linalg.norm(eye(flight) - PIVOT) == pytest.approx(math.dist(ROLLED.eye, PIVOT))


def steep(up: tuple[float, float, float], heading: float, degrees: float) -> Camera:
    """A roll-free view with an up perpendicular to it, as a glTF's matrix gives, that looks down by `degrees`."""
    upward, p = np.array(up), math.radians(degrees)
    level = np.roll(upward, 1) * math.cos(heading) + np.roll(upward, 2) * math.sin(heading)
    ahead, above = level * math.cos(p) - upward * math.sin(p), level * math.sin(p) + upward * math.cos(p)
    return Camera((0.0, 0.0, 0.0), tuple(ahead), tuple(above))


@pytest.mark.parametrize("up", [Y, Z, (0.0, -1.0, 0.0)])
@pytest.mark.parametrize("heading, degrees", [(0.0, 0.0), (0.0, 40.0), (0.8, 60.0), (2.5, 75.0), (4.0, -60.0)])
def test_the_worlds_up_is_found(up: tuple[float, float, float], heading: float, degrees: float) -> None:
    # straight up moves along the world's up; 60° down, the picture's up leans nearer to the horizon than to it
    flight = FreeCamera(steep(up, heading, degrees), DIAGONAL)
    flight.move(0, 1, 0, 0.1)
    np.testing.assert_allclose(flight.camera.eye, 0.2 * np.array(up), atol=1e-12)
    assert pitch(flight, up) == pytest.approx(-degrees)
    flight.look(33, 1, DEGREE)
    assert roll_free(flight, up)
    assert pitch(flight, up) == pytest.approx(-degrees - 1)


@pytest.mark.parametrize("name", bundled())
def test_the_bundled_cameras_are_level(name: str) -> None:
    scene = load(name)
    for camera in scene.cameras:
        flight = FreeCamera(camera, scene.diagonal)
        flight.look(0.001, 0, DEGREE)
        np.testing.assert_allclose(flight.camera.axes, camera.axes, atol=1e-4)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_view_straight_down_turns_about_its_own_heading(sign: float) -> None:
    # the picture's top is north, -z: after the first look, clamped to 89°, it still is. Straight up, the picture's top is south
    camera = Camera((0.0, 5.0, 0.0), (0.0, 5.0 - sign, 0.0), (0.0, 0.0, -sign))
    flight = FreeCamera(camera, DIAGONAL, up=Y)
    np.testing.assert_allclose(right(flight), [1, 0, 0], atol=1e-12)
    flight.look(0, 1e-6, DEGREE)
    np.testing.assert_allclose(right(flight), [1, 0, 0], atol=1e-12)
    assert pitch(flight) == pytest.approx(-89.0 * sign)
    flight.look(90, 0, DEGREE)
    np.testing.assert_allclose(right(flight), [0, 0, 1], atol=1e-12)


def test_a_given_up_is_any_direction_but_none() -> None:
    up = np.array([1.0, 2.0, -2.0]) / 3.0
    flight = FreeCamera(PLAIN, DIAGONAL, up=(3.0, 6.0, -6.0))
    flight.look(20, 10, DEGREE)
    assert roll_free(flight, tuple(up))
    for nothing in ((0.0, 0.0, 0.0), (math.nan, 0.0, 1.0)):
        with pytest.raises(InputError, match="up"):
            FreeCamera(PLAIN, DIAGONAL, up=nothing)


def test_arguments_that_are_not_finite_move_nothing() -> None:
    flight, bad = FreeCamera(OBLIQUE, DIAGONAL), math.nan
    with np.errstate(invalid="ignore"):
        flight.look(bad, 0, DEGREE)
        flight.look(0, math.inf, DEGREE)
        flight.orbit(PIVOT, 1, bad, DEGREE)
        flight.orbit((bad, 0, 0), 1, 1, DEGREE)
        flight.move(bad, 0, 1, 0.1)
        flight.move(0, 0, 1, bad)
        flight.move(0, 0, 1, 0.1, math.inf)
        flight.dolly(bad)
        flight.dolly(1, (bad, bad, bad))
        flight.change_speed(bad)
    assert flight.camera is OBLIQUE
    assert flight.speed == DIAGONAL / 6


@pytest.mark.parametrize("place", [0.0, 1e6, 1e12])
@pytest.mark.parametrize("diagonal", [1e-3, 12.0, 1e5])
def test_random_sequences_leave_a_valid_camera(place: float, diagonal: float) -> None:
    # the Camera checks itself when made (finite, eye ≠ target, up not parallel): 2000 moves make 2000 of them or raise
    random = np.random.default_rng(7)
    ahead = diagonal + 1e-3 * place
    first = Camera((place, place, place), (place + ahead, place, place - ahead))
    flight = FreeCamera(first, diagonal, up=Y)
    flight.look(1, 1, DEGREE)
    number: Callable[..., Any] = lambda scale: float(random.normal() * scale)  # noqa: E731
    for _ in range(600):
        pivot = tuple(place + random.normal(size=3) * diagonal) if random.random() < 0.7 else flight.camera.eye
        match random.integers(6):
            case 0:
                flight.look(number(300), number(300), 0.005)
            case 1:
                flight.orbit(pivot, number(300), number(300), 0.005)
            case 2:
                right, up, ahead = random.integers(-1, 2, 3)
                flight.move(right, up, ahead, abs(number(0.3)), random.choice([0.25, 1, 4]))
            case 3:
                flight.dolly(number(20), None if random.random() < 0.5 else pivot)
            case 4:
                flight.change_speed(number(10))
            case _:
                flight.move(0, 0, 1, 0.25, 4)
        assert roll_free(flight)
        assert abs(pitch(flight)) < 89.0 + 1e-4
        assert math.dist(flight.camera.eye, first.eye) <= FAR * diagonal * (1 + 1e-9)
        assert flight.camera.fov == first.fov


def test_the_camera_stays_within_a_thousand_diagonals() -> None:
    flight = FreeCamera(PLAIN, DIAGONAL)
    for _ in range(100):
        flight.dolly(-10)
    assert 0.3 * FAR * DIAGONAL < math.dist(flight.camera.eye, PLAIN.eye) <= FAR * DIAGONAL
    outside = Camera((0.0, 1.0, 2e4), (0.0, 1.0, 0.0))  # a camera may stand there, and come back
    flight.go(outside)
    flight.move(0, 0, -1, 0.1)
    assert flight.camera is outside
    flight.move(0, 0, 1, 0.1)
    assert flight.camera.eye[2] < 2e4
