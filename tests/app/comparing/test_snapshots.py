"""Snapshots: pictures that are kept while the window is open, and compared with what it shows later."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

from irrsplat.app.viewer.show.snapshots import MOST
from irrsplat.core.errors import InputError
from tests.support.viewing import Driver, push


def kept(driver: Driver) -> np.ndarray:
    """The picture on show, of which a snapshot is kept; then the camera goes elsewhere, and is at rest."""
    picture = driver.canvas()
    push(driver, "K")
    driver.session.free_camera.go(driver.session.scene.camera("corner"))
    driver.settle()
    assert (driver.canvas() != picture).any(-1).mean() > 0.5
    return picture


def test_a_snapshot_stays_what_it_was(driver: Driver) -> None:
    """Beside the scene, which has gone on; of records and buffers the scene alone has some."""
    picture = kept(driver)
    scene = driver.canvas()
    driver.session.split("snapshot")
    driver.session.options.points = True
    driver.actions.side = 1
    driver.actions.show("image")
    driver.frame()
    middle = driver.wnd.width // 2
    assert np.array_equal(driver.canvas()[:, middle + 1 :], picture[:, middle + 1 :])
    assert (driver.canvas()[:, : middle - 1] != scene[:, : middle - 1]).any(), "points over the scene"
    driver.session.options.points = False
    driver.actions.show("normal")
    driver.frame()
    assert driver.session.options.buffers[0] == "normal"
    assert np.array_equal(driver.canvas()[:, middle + 1 :], picture[:, middle + 1 :])


def test_it_is_exposed_as_the_scene_is(driver: Driver) -> None:
    picture = kept(driver)
    driver.session.split("snapshot")
    driver.session.change(0, exposure=2.0)
    driver.frame()
    middle = driver.wnd.width // 2
    brighter = driver.canvas()[:, middle + 1 :].astype(int) - picture[:, middle + 1 :]
    assert (brighter >= 0).all() and (brighter > 0).mean() > 0.4


def test_it_differs_from_the_scene_by_what_has_changed(driver: Driver) -> None:
    """By nothing at first; by the light once a lamp is another. Its own values are read where the cursor is."""
    push(driver, "K")
    driver.session.split("snapshot")
    driver.session.options.compare = "difference"
    driver.frame()
    value = driver.display.value(0, (100, 120))
    assert value is not None and value[0] == 0.0
    before = driver.session.frame().image
    lamp = driver.session.scene.lights[0]
    driver.session.relight([replace(lamp, color=(1.0, 2.0, 3.0))])
    driver.settle()
    expected = np.abs(driver.session.frame().image - before)[120, 100].mean()
    value = driver.display.value(0, (100, 120))
    assert value is not None and value[0] == pytest.approx(expected, rel=1e-4) and expected > 0.0
    driver.session.options.compare = "divided"
    driver.frame()
    right = driver.display.value(1, (300, 200))
    assert right is not None and np.allclose(right, before[200, 300])
    driver.session.relight([lamp])


def test_it_fills_its_side_after_the_window_has_another_size(driver: Driver) -> None:
    picture = kept(driver)
    driver.session.split("snapshot")
    before = driver.display.value(1, (300, 200))
    driver.resize((160, 120))
    driver.frame(2)
    assert np.array_equal(driver.canvas()[:, 81:], picture[0::2, 1::2][:, 81:])
    assert before is not None and np.array_equal(before, driver.display.value(1, (150, 100)))  # type: ignore[arg-type]


def test_several_by_name(driver: Driver) -> None:
    session = driver.session
    for _ in range(3):
        push(driver, "K")
    first, second, third = session.snapshots
    assert [s.name for s in session.snapshots] == ["snapshot 1", "snapshot 2", "snapshot 3"]
    session.pin(second)
    session.forget_snapshot(second)
    driver.frame()
    assert (str(session.options.split), session.pinned) == ("off", None)
    assert isinstance(second.view.image.mglo, moderngl.InvalidObject)
    push(driver, "K")
    assert [s.name for s in session.snapshots] == ["snapshot 1", "snapshot 3", "snapshot 2"]
    session.pin(first)
    session.forget_snapshot(third)
    assert (str(session.options.split), session.pinned) == ("snapshot", first)
    for _ in range(MOST - 2):
        session.keep_snapshot(0)
    with pytest.raises(InputError, match=f"there are {MOST} snapshots already"):
        session.keep_snapshot(0)


def test_the_menu_shows_and_forgets_them(driver: Driver) -> None:
    driver.resize((480, 400))  # so that the menu is all there
    driver.frame(2)
    driver.choose("Compare", "a snapshot on the right")
    assert driver.session.options.split == "off", "there is none yet"
    driver.click(20.0, 390.0)  # closes the menu
    driver.frame(2)
    driver.choose("Compare", "keep this picture as a snapshot, to compare with later")
    for item, split, count in (("show it on the right", "snapshot", 1), ("forget it", "off", 0)):
        driver.choose("Compare", "snapshot 1", item)
        assert (driver.session.options.split, len(driver.session.snapshots)) == (split, count)


def test_records_are_inspected_in_the_scene_alone(driver: Driver) -> None:
    kept(driver)
    driver.session.split("snapshot")
    driver.session.options.inspect = True
    driver.move(250.0, 120.0)
    driver.frame(2)
    assert driver.viewer.inspected is None or driver.viewer.inspected.side == 0
    assert driver.display.point_at((250, 120)) is not None
