"""Flight by keys and mouse, clicks, the divider, and distribution of mouse events to panel or picture."""

from __future__ import annotations

import numpy as np
import pytest

from irrsplat.app.viewer.editing.objects import on_screen
from irrsplat.scene.model import Camera
from tests.support.viewing import LEFT, RIGHT, SIZE, Driver, push

WALL = (60.0, 100.0)  # window coordinates, of something seen
DT = 0.05


def gone(driver: Driver, since: Camera) -> np.ndarray:
    """Return the motion (3,) of the eye in metres."""
    return np.subtract(driver.session.camera.eye, since.eye)


def test_a_held_key_flies_its_way(driver: Driver) -> None:
    """A held key moves the eye at the flight's speed, changed by Shift and Alt; a window without focus releases all keys."""
    ways = {"S": (0, 0, 1), "A": (-1, 0, 0), "E": (0, 1, 0)}
    driver.session.options.frozen = True
    metre = DT * driver.session.free_camera.speed
    for name, way in ways.items():
        before = driver.session.camera
        driver.down(name)
        driver.frame(2, DT)
        driver.up(name)
        driver.frame(1, DT)
        assert gone(driver, before) == pytest.approx(np.array(way) * 2 * metre)
    driver.down("W")
    for name, pace in (("LEFT_SHIFT", 4.0), ("RIGHT_SHIFT", 4.0), ("LEFT_ALT", 0.25)):
        before = driver.session.camera
        driver.down(name)
        driver.frame(1, DT)
        driver.up(name)
        assert -gone(driver, before)[2] == pytest.approx(pace * metre)
    driver.move(*WALL)
    driver.button(True, RIGHT)
    driver.frame()
    driver.viewer.controls.focus_changed(False)
    before = driver.session.camera
    driver.frame(2)
    assert driver.session.camera == before and not driver.viewer.controls.looking


def test_right_mouse_looks_after_the_first_jump(driver: Driver) -> None:
    """A motion of the window's height turns by the field of view. The first motion after the capture is a jump and ignored."""
    before = driver.session.camera
    driver.move(*WALL)
    driver.button(True, RIGHT)
    driver.move(0, 0, 500, -300)
    driver.frame()
    assert driver.session.camera == before and driver.wnd.mouse_exclusivity
    driver.move(0, 0, SIZE[1] / 4, 0)
    driver.frame()
    axis = driver.session.camera.axes[2]
    assert np.degrees(np.arccos(axis @ before.axes[2])) == pytest.approx(before.fov / 4)
    assert axis @ before.axes[0] < 0.0, "to the right"
    driver.button(False, RIGHT)
    driver.move(100, 100)
    driver.frame()
    assert (driver.session.camera.axes[2] == axis).all() and not driver.wnd.mouse_exclusivity


def test_wheel_and_left_drag_keep_the_point_under_the_cursor(driver: Driver) -> None:
    """A step of the wheel moves by a tenth of the distance. A drag orbits with constant pixel and distance of the point."""
    driver.move(*WALL)
    driver.frame()
    point, before = driver.display.point_at((60, 100)), driver.session.camera
    assert point is not None
    driver.viewer.controls.wheel(0.0, 1.0)
    driver.frame()
    assert gone(driver, before) == pytest.approx(0.1 * np.subtract(point, before.eye), abs=1e-5)
    driver.viewer.controls.wheel(0.0, -1.0)
    assert gone(driver, before) == pytest.approx(0.0, abs=1e-5)
    driver.frame()
    driver.drag(WALL, (110.0, 90.0))
    after = driver.session.camera
    distance = np.linalg.norm(np.subtract(point, before.eye))
    assert np.linalg.norm(np.subtract(point, after.eye)) == pytest.approx(distance, rel=1e-4)
    for camera in (before, after):
        assert on_screen(camera, SIZE, point) == pytest.approx((60.5, 100.5), abs=0.01)
    assert np.linalg.norm(gone(driver, before)) > 0.3


def test_the_record_under_the_cursor_is_of_its_side(driver: Driver) -> None:
    """A click inspects a record of the clicked side; the camera and the selection stay."""
    before = driver.session.camera
    driver.split_presets()
    push(driver, "I")
    for place, side in ((WALL, 0), ((250.0, 100.0), 1)):
        driver.click(*place)
        found = driver.display.inspected
        assert found is not None and found.side == side
    assert driver.session.camera == before and driver.actions.editor.mesh is None


def test_the_divider_is_dragged_and_keys_are_about_the_side_that_was_clicked(driver: Driver) -> None:
    """Each side of the divider shows its preset at each position; the divider stays within the window."""
    whole, options = {}, driver.session.options
    driver.split_presets()
    for side in (1, 0):
        options.divider = 1.0 - side
        driver.frame()
        whole[side] = driver.canvas()
    options.divider = 0.5
    driver.frame()
    before = driver.session.camera
    for x in (80, 500, 160):
        driver.drag((options.divider * SIZE[0], 60.0), (float(x), 60.0))
        place = round(min(x, 0.98 * SIZE[0]))
        assert options.divider * SIZE[0] == pytest.approx(place, abs=1.0)
        canvas = driver.canvas()
        assert np.array_equal(canvas[:, : place - 2], whole[0][:, : place - 2])
        assert np.array_equal(canvas[:, place + 2 :], whole[1][:, place + 2 :])
    assert driver.session.camera == before and driver.session.renderers[0].timers.milliseconds() == {}
    for across, side in ((250.0, 1), (60.0, 0)):
        driver.click(across, 60.0)
        push(driver, "Esc")  # the picked object's panel would lie over the other side
        assert options.side == side


def test_a_press_right_after_a_jump_is_the_panel_s_or_the_picture_s(driver: Driver) -> None:
    """The mouse may reach a panel and press within one slow frame: the event belongs to the panel or picture under it."""
    driver.resize((640, 240))
    driver.session.options.controls = driver.session.options.frozen = True
    driver.settle()
    driver.frame(3)
    before = driver.session.camera
    driver.move(600.0, 150.0)
    driver.frame(2)
    driver.move(40.0, 80.0)
    driver.button(True)
    driver.move(100.0, 100.0)
    driver.frame()
    driver.button(False)
    driver.viewer.controls.wheel(0.0, 2.0)
    driver.click(40.0, 80.0, RIGHT)
    assert driver.session.camera == before and not driver.viewer.controls.looking


def test_a_click_counts_where_the_last_motion_was(driver: Driver) -> None:
    """A slow frame delays events, and glfw gives a button's event a later position of the cursor, which is ignored."""
    controls = driver.viewer.controls
    wall = driver.display.mesh_at((int(WALL[0]), int(WALL[1])))
    driver.move(*WALL)
    elsewhere = (SIZE[0] / 2.0 + 30.0, SIZE[1] - 70.0)
    controls.mouse_pressed(*elsewhere, LEFT)
    controls.mouse_released(*elsewhere, LEFT)
    driver.move(*elsewhere)
    assert driver.actions.editor.mesh == wall != driver.display.mesh_at((int(elsewhere[0]), int(elsewhere[1])))
