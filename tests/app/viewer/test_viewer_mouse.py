"""Flying by keys and mouse, clicks, the divider, and whose the mouse and the keyboard are."""

from __future__ import annotations

import numpy as np
import pytest

from irrsplat.scene.model import Camera
from tests.support.viewing import LEFT, RIGHT, SIZE, Driver, push

WALL = (60.0, 100.0)  # window coordinates, of something seen
DT = 0.05


def gone(driver: Driver, since: Camera) -> np.ndarray:
    """(3,) metres that the eye has gone."""
    return np.subtract(driver.session.camera.eye, since.eye)


def pixel(camera: Camera, point: tuple[float, float, float]) -> tuple[float, float]:
    """Where a world point is seen, pixels from the upper left corner."""
    x, y, z = camera.axes @ np.subtract(point, camera.eye)
    per = SIZE[1] / camera.screen / -z
    return SIZE[0] / 2 + x * per, SIZE[1] / 2 - y * per


# ---- keys that are held ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "way"),
    [("W", (0, 0, -1)), ("S", (0, 0, 1)), ("A", (-1, 0, 0)), ("D", (1, 0, 0)), ("E", (0, 1, 0)), ("Q", (0, -1, 0))],
)
def test_a_held_key_flies_its_way(driver: Driver, name: str, way: tuple[int, int, int]) -> None:
    """The first camera looks down -z: so long as the key is held, at the flight's speed."""
    before = driver.session.camera
    driver.down(name)
    driver.frame(4, DT)
    driver.up(name)
    driver.frame(3, DT)
    assert gone(driver, before) == pytest.approx(np.array(way) * 4 * DT * driver.session.free_camera.speed)


@pytest.mark.parametrize(("name", "pace"), [("LEFT_SHIFT", 4.0), ("RIGHT_SHIFT", 4.0), ("LEFT_CTRL", 0.25)])
def test_shift_and_ctrl_change_the_pace_at_once(driver: Driver, name: str, pace: float) -> None:
    before, metre = driver.session.camera, DT * driver.session.free_camera.speed
    driver.down("W")
    for paces in (1.0, 1.0 + pace, 2.0 + pace):
        driver.frame(1, DT)
        assert -gone(driver, before)[2] == pytest.approx(paces * metre)
        (driver.up if paces == 1.0 + pace else driver.down)(name)
    driver.up("W")
    driver.up(name)


def test_keys_are_let_go_of_when_the_window_loses_the_keyboard(driver: Driver) -> None:
    driver.down("LEFT_SHIFT")
    driver.down("W")
    driver.move(*WALL)
    driver.button(True, RIGHT)
    driver.frame()
    driver.viewer.controls.focus_changed(False)
    before = driver.session.camera
    driver.frame(3)
    assert driver.session.camera == before and not driver.viewer.controls.looking and driver.viewer.controls.pace == 1.0
    driver.modifiers.shift = False


def test_flying_ends_what_plays(driver: Driver) -> None:
    driver.actions.record()
    driver.frame(10)
    driver.actions.record()
    driver.actions.play()
    driver.frame()
    driver.down("A")
    driver.frame()
    driver.up("A")
    assert driver.session.path_recorder.playing is None


# ---- looking, orbiting, the wheel ---------------------------------------------------------------------------------------


def test_right_mouse_looks_after_the_first_jump(driver: Driver) -> None:
    """A motion of the window's height turns by the field of view; the first one after the capture is a jump, and none."""
    before = driver.session.camera
    driver.move(*WALL)
    driver.button(True, RIGHT)
    assert driver.wnd.mouse_exclusivity and driver.viewer.controls.pointer is None
    driver.move(0, 0, 500, -300)
    driver.frame()
    assert driver.session.camera == before
    driver.move(0, 0, SIZE[1] / 4, 0)
    driver.frame()
    turned = np.degrees(np.arccos(driver.session.camera.axes[2] @ before.axes[2]))
    assert turned == pytest.approx(before.fov / 4) and (driver.session.camera.axes[2] @ before.axes[0]) < 0.0, "to the right"
    driver.button(True, LEFT)
    driver.button(False, LEFT)
    driver.button(False, RIGHT)
    there = driver.session.camera
    driver.move(100, 100)
    driver.frame()
    assert driver.session.camera == there and gone(driver, before) == pytest.approx(0.0) and not driver.wnd.mouse_exclusivity


def test_the_wheel_sets_the_speed_while_right_mouse_is_held(driver: Driver) -> None:
    speed, before = driver.session.free_camera.speed, driver.session.camera
    driver.move(*WALL)
    driver.button(True, RIGHT)
    for _ in range(3):
        driver.viewer.controls.wheel(0.0, 1.0)
    driver.button(False, RIGHT)
    assert driver.session.free_camera.speed > 1.5 * speed and driver.session.camera == before
    assert driver.said == f"speed {driver.session.free_camera.speed:.3g} m/s", "said once"


def test_the_wheel_dollies_to_the_point_under_the_cursor(driver: Driver) -> None:
    """A tenth of the way a step: the point stays under the cursor."""
    driver.move(*WALL)
    driver.frame()
    point, before = driver.display.point_at((60, 100)), driver.session.camera
    assert point is not None
    driver.viewer.controls.wheel(0.0, 1.0)
    driver.frame()
    assert gone(driver, before) == pytest.approx(0.1 * np.subtract(point, before.eye), abs=1e-5)
    driver.viewer.controls.wheel(0.0, -1.0)
    assert gone(driver, before) == pytest.approx(0.0, abs=1e-5)


def test_a_left_drag_orbits_about_the_point_that_was_picked(driver: Driver) -> None:
    """The picked point keeps its place on the screen and its distance."""
    driver.move(*WALL)
    driver.frame()
    point, before = driver.display.point_at((60, 100)), driver.session.camera
    assert point is not None
    driver.drag(WALL, (110.0, 90.0))
    after = driver.session.camera
    assert np.linalg.norm(np.subtract(point, after.eye)) == pytest.approx(
        np.linalg.norm(np.subtract(point, before.eye)), rel=1e-4
    )
    for camera in (before, after):
        assert pixel(camera, point) == pytest.approx((60.5, 100.5), abs=0.01)
    assert np.linalg.norm(gone(driver, before)) > 0.3


def test_a_click_moves_nothing_but_holds_a_record_where_they_are_inspected(driver: Driver) -> None:
    before = driver.session.camera
    driver.click(*WALL)
    assert driver.session.held is None and driver.session.camera == before
    push(driver, "Esc")  # lets go of the wall, whose panel covers much of so small a window
    push(driver, "I")
    driver.click(*WALL)
    assert driver.session.held is not None and driver.session.held[0] == 0
    number = driver.session.held[1]
    driver.move(200, 60)
    driver.frame(2)
    assert driver.viewer.inspected is not None and driver.viewer.inspected.number == number, "held while the mouse goes on"
    driver.session.use_preset(0, "paper")
    assert driver.session.held is None, "its records are gone"
    driver.session.use_preset(0, "default")
    driver.session.change(0, gather_size=8)


def test_the_record_held_is_that_of_its_side(driver: Driver) -> None:
    driver.split_presets()
    push(driver, "I")
    driver.click(*WALL)
    driver.move(250, 100)
    driver.frame(2)
    found = driver.viewer.inspected
    assert found is not None and (found.side, found.number) == driver.session.held and found.side == 0


# ---- the divider, two sides ---------------------------------------------------------------------------------------------


def test_the_divider_is_dragged(driver: Driver) -> None:
    """Left of it the one buffer, right of it the other, wherever it stands; never past the window's edges."""
    whole = {}
    for name in ("image", "normal"):
        driver.actions.show(name)
        driver.frame()
        whole[name] = driver.canvas()
    driver.actions.show("image")
    driver.session.split("buffers")
    driver.session.options.buffers[1] = "normal"
    before = driver.session.camera
    for x in (80, 250, 500):
        driver.drag((driver.session.options.divider * SIZE[0], 60.0), (float(x), 60.0))
        place = round(min(x, 0.98 * SIZE[0]))
        assert driver.session.options.divider * SIZE[0] == pytest.approx(place, abs=1.0)
        canvas = driver.canvas()
        assert np.array_equal(canvas[:, : place - 2], whole["image"][:, : place - 2])
        assert np.array_equal(canvas[:, place + 2 :], whole["normal"][:, place + 2 :])
    assert driver.session.camera == before and driver.session.ms == {}


def test_keys_are_about_the_side_that_was_clicked(driver: Driver) -> None:
    driver.session.split("buffers")
    driver.frame()
    for x, expected in ((250.0, ["image", "depth"]), (60.0, ["albedo", "depth"])):
        driver.click(x, 60.0)
        push(driver, "Esc")  # the picked object's panel would lie over the other side
        push(driver, "9" if x > 160 else "8")
        assert driver.session.options.buffers == expected


# ---- whose the mouse is ---------------------------------------------------------------------------------------------------


def test_the_interface_keeps_mouse_and_wheel_from_the_camera(driver: Driver) -> None:
    driver.actions.panels.settings = True
    driver.frame(3)
    before = driver.session.camera
    driver.drag((40.0, 80.0), (100.0, 100.0))
    driver.viewer.controls.wheel(0.0, 2.0)
    driver.click(40.0, 80.0, RIGHT)
    driver.frame(2)
    assert driver.session.camera == before and not driver.viewer.controls.looking and driver.viewer.controls.pointer is None


def test_a_press_right_after_a_jump_is_the_panel_s_or_the_picture_s(driver: Driver) -> None:
    """The mouse may come to a panel and press within one slow frame: who is under it counts, not who was."""
    driver.resize((640, 240))
    driver.actions.panels.settings = True
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
    driver.frame()
    assert driver.session.camera == before
    driver.move(600.0, 150.0)
    driver.button(True)
    driver.frame()
    driver.move(590.0, 120.0)
    driver.frame()
    driver.move(40.0, 120.0)  # over the panel, but the drag is the camera's
    driver.frame()
    after = driver.session.camera
    driver.button(False)
    assert after != before


# ---- at rest --------------------------------------------------------------------------------------------------------------


def test_at_rest_nothing_but_the_interface_is_drawn(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not a stage of the core, and the picture only where something lies over it that follows the mouse."""
    for name in ("image", "weight", "atlas"):
        driver.actions.show(name)
        driver.settle()
        driver.actions.panels.hud = driver.actions.panels.settings = True
        driver.frame(4)  # tiles stand clear of them
        drawn: list[object] = []
        draw = driver.display.draw
        monkeypatch.setattr(driver.display, "draw", lambda *args, draw=draw, drawn=drawn: drawn.append(args) or draw(*args))
        view = driver.session.views[0]
        for x in range(250, 300, 10):
            driver.move(x, 100)
            driver.frame()
            assert driver.session.ms == {} and driver.session.views[0] is view and driver.session.at_rest
        assert not drawn
        monkeypatch.undo()


def test_a_view_that_cannot_be_served_comes_to_rest(driver: Driver) -> None:
    driver.resize((40, 30))
    driver.session.change(0, tolerance=1e6)
    driver.settle()
    assert driver.session.progress[0].coverage < 1.0 and driver.session.ms == {}
