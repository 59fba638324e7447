"""Motions of the free camera, compared with rotations; random sequences of motions leave a valid camera."""

from __future__ import annotations

import math

import numpy as np
import pytest

from irrsplat.app.viewer.input.free_camera import FAR, NEAR, FreeCamera
from irrsplat.scene.model import Camera

DIAGONAL = 12.0
Y, Z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
PLAIN = Camera((0.0, 1.0, 5.0), (0.0, 1.0, 0.0), name="plain")  # looks down -z; its right is +x
OBLIQUE = Camera((3.0, 2.5, 4.0), (-1.0, 0.5, 0.3), fov=60.0)
ROLLED = Camera((3.0, 2.5, 4.0), (-1.0, 0.5, 0.3), (math.sin(0.4), math.cos(0.4), 0.0))
PIVOT = (0.4, 0.2, -0.7)
DEGREE = math.radians(1.0)  # per pixel: one pixel turns by one degree


def forward(flight: FreeCamera) -> np.ndarray:
    return -flight.camera.axes[2]


def on_screen(camera: Camera, point: tuple[float, float, float]) -> np.ndarray:
    """Return the image coordinates (2,) of `point`, as tangents of angles from the view axis."""
    x, y, z = camera.axes @ np.subtract(point, camera.eye)
    return np.array([x, y]) / -z


def pitch(flight: FreeCamera, up: tuple[float, float, float] = Y) -> float:
    return math.degrees(math.asin(np.clip(forward(flight) @ up, -1.0, 1.0)))


def level(flight: FreeCamera, up: tuple[float, float, float] = Y) -> bool:
    """True if right is perpendicular to the world's up, and the picture's up is not below the horizon."""
    return abs(flight.camera.axes[0] @ up) < 1e-9 and float(flight.camera.axes[1] @ up) > 0.0


@pytest.mark.parametrize("camera", [PLAIN, OBLIQUE])
def test_a_quarter_turn_faces_the_former_right(camera: Camera) -> None:
    """A turn by 90° keeps the pitch p, and the heading becomes the former right: forward' = cos p · right + sin p · up."""
    flight = FreeCamera(camera, DIAGONAL, Y)
    side, p, before = flight.camera.axes[0], math.radians(pitch(flight)), forward(flight)
    flight.turn(90 * DEGREE, 0.0)
    np.testing.assert_allclose(forward(flight), math.cos(p) * side + math.sin(p) * np.array(Y), atol=1e-12)
    assert flight.camera.eye == camera.eye
    flight.turn(270 * DEGREE, 0.0)
    np.testing.assert_allclose(forward(flight), before, atol=1e-12)
    flight.turn(0.0, 30 * DEGREE)
    assert pitch(flight) == pytest.approx(math.degrees(p) - 30.0), "the mouse down looks down"


@pytest.mark.parametrize("camera", [PLAIN, OBLIQUE, ROLLED], ids=["plain", "oblique", "rolled"])
@pytest.mark.parametrize("pivot", [PIVOT, (3.0, 2.5, 9.0)])
def test_an_orbit_keeps_the_pivot_in_its_place(camera: Camera, pivot: tuple[float, float, float]) -> None:
    """An orbit keeps the pivot's position in view space: its distance and its pixel, even behind the eye."""
    flight = FreeCamera(camera, DIAGONAL, Y)
    for dx, dy in [(40, 0), (0, 15), (-170, -60), (13, 400)]:
        flight.turn(dx * DEGREE, dy * DEGREE, pivot)
        assert math.dist(flight.camera.eye, pivot) == pytest.approx(math.dist(camera.eye, pivot))
        np.testing.assert_allclose(on_screen(flight.camera, pivot), on_screen(camera, pivot), atol=1e-9)
        assert level(flight)
    flight = FreeCamera(PLAIN, DIAGONAL, Y)
    flight.turn(90 * DEGREE, 0.0, (0, 1, 0))  # the hand drags the scene to the right: its left side, -x, comes to the front
    np.testing.assert_allclose(flight.camera.eye, [-5, 1, 0], atol=1e-12)


def test_a_step_of_the_wheel_leaves_nine_tenths_and_never_passes_the_pivot() -> None:
    """The wheel moves along the line to the pivot: the direction and the pivot's pixel stay."""
    flight = FreeCamera(PLAIN, DIAGONAL, Y)
    flight.dolly(1)
    np.testing.assert_allclose(flight.camera.eye, [0, 1, 4.5])
    flight.home()
    assert flight.camera is PLAIN
    flight.dolly(7, PIVOT)
    np.testing.assert_allclose(on_screen(flight.camera, PIVOT), on_screen(PLAIN, PIVOT), atol=1e-12)
    for steps in [3] * 40 + [1e9, math.inf]:
        flight.dolly(steps, PIVOT)
        assert np.subtract(flight.camera.eye, PIVOT) @ np.subtract(PLAIN.eye, PIVOT) > 0.0
    assert math.dist(flight.camera.eye, PIVOT) == pytest.approx(NEAR * DIAGONAL)


@pytest.mark.parametrize(("place", "diagonal", "up"), [(0.0, 12.0, Z), (1e12, 1e-3, Y), (1e6, 1e5, Y)])
def test_random_sequences_leave_a_valid_camera(place: float, diagonal: float, up: tuple[float, float, float]) -> None:
    """A Camera validates itself. The eye stays within 1000 diagonals, and motions that are not finite have no effect."""
    random = np.random.default_rng(7)
    ahead = diagonal + 1e-3 * place
    first = Camera((place, place, place), (place + ahead, place, place - ahead))
    flight = FreeCamera(first, diagonal, up)
    flight.turn(1 * DEGREE, 1 * DEGREE)
    for turn in range(300):
        pivot = tuple(place + random.normal(size=3) * diagonal) if random.random() < 0.7 else flight.camera.eye
        dx, dy, one = (math.nan,) * 3 if turn % 49 == 0 else (float(x) for x in random.normal(size=3))
        before = flight.camera
        match turn % 4:
            case 0:
                flight.turn(300 * dx * 0.005, 300 * dy * 0.005)
            case 1:
                flight.turn(300 * dx * 0.005, 300 * dy * 0.005, pivot)
            case 2:
                flight.move(dx, dy, one, 0.3, 4.0)
            case _:
                flight.dolly(20 * one, None if random.random() < 0.5 else pivot)
        assert level(flight, up) and abs(pitch(flight, up)) < 89.0 + 1e-4 and (turn % 49 or flight.camera is before)
        assert math.dist(flight.camera.eye, first.eye) <= FAR * diagonal * (1 + 1e-9)
