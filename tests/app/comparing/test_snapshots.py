"""Snapshots: pictures that are kept while the window is open, and compared with what it shows later."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

from irrsplat.app.viewer.show.snapshots import MOST
from irrsplat.core.errors import InputError
from tests.support.viewing import Driver, push


def test_a_snapshot_stays_what_it_was_and_is_exposed_as_the_scene(driver: Driver) -> None:
    """The other side shows the scene with its records and another buffer."""
    picture = driver.canvas()
    push(driver, "K")
    driver.session.options.frozen = driver.session.options.points = True
    driver.session.free_camera.go(driver.session.scene.camera("corner"))
    driver.session.split("snapshot")
    driver.actions.side = 1
    driver.actions.show("normal")
    driver.frame()
    middle = driver.wnd.width // 2
    assert driver.session.options.buffers[0] == "normal"
    assert np.array_equal(driver.canvas()[:, middle + 1 :], picture[:, middle + 1 :])
    assert (driver.canvas()[:, : middle - 1] != picture[:, : middle - 1]).any(-1).mean() > 0.5
    driver.session.change(0, exposure=2.0)
    driver.frame()
    brighter = driver.canvas()[:, middle + 1 :].astype(int) - picture[:, middle + 1 :]
    assert (brighter >= 0).all() and (brighter > 0).mean() > 0.4


def test_it_differs_from_the_scene_by_what_has_changed(driver: Driver) -> None:
    """The difference is 0 at first, and that of the images once the light has another colour."""
    push(driver, "K")
    driver.session.split("snapshot")
    driver.session.options.compare = "difference"
    driver.frame()
    value = driver.display.value(0, (100, 120))
    assert value is not None and value[0] == 0.0
    before = driver.session.frame().image
    driver.session.options.frozen = True
    driver.session.relight([replace(driver.session.scene.lights[0], color=(1.0, 2.0, 3.0))])
    driver.frame(2)
    expected = np.abs(driver.session.frame().image - before)[120, 100].mean()
    value = driver.display.value(0, (100, 120))
    assert value is not None and value[0] == pytest.approx(expected, rel=1e-4) and expected > 0.0
    driver.session.options.compare = "divided"
    driver.frame()
    right = driver.display.value(1, (300, 200))
    assert right is not None and np.allclose(right, before[200, 300])


def test_several_by_name(driver: Driver) -> None:
    session = driver.session
    for _ in range(3):
        push(driver, "K")
    second = session.snapshots[1]
    session.pin(second)
    session.forget_snapshot(second)
    driver.frame()
    assert (str(session.options.split), session.pinned) == ("off", None)
    assert isinstance(second.view.image.mglo, moderngl.InvalidObject)
    push(driver, "K")
    assert [s.name for s in session.snapshots] == ["snapshot 1", "snapshot 3", "snapshot 2"]
    for _ in range(MOST - 3):
        session.keep_snapshot(0)
    session.pin(session.snapshots[0])
    driver.resize((200, 160))
    driver.frame()
    assert driver.display.mesh_at((190, 80)) is not None, "a click on a snapshot of another size picks the scene's object"
    with pytest.raises(InputError, match=f"there are {MOST} snapshots already"):
        session.keep_snapshot(0)
