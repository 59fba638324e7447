"""Files that the viewer reads while it runs: scenes and paths, correct and wrong ones."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.support.viewing import ROOM, Driver, push, write_room

PATH = "frames 31\ncam 0 0 2.6  0 0 0  0 1 0\ncam 0.5 0.2 1.6  0 0 0  0 1 0\n"


@pytest.fixture
def room(one: Driver) -> Iterator[Path]:
    """The file of the scene on show, put back in the end."""
    path = Path(one.actions.source)
    yield path
    write_room(path.parent)
    with one.wnd.ctx:
        one.actions.attempt(lambda: one.actions.open(str(path)))


def rewrite(driver: Driver, path: Path, text: str) -> None:
    """Write a file, and press F5."""
    path.write_text(text)
    push(driver, "F5")


def errors(driver: Driver) -> list[str]:
    return [m.text for m in driver.actions.messages.errors]


def test_f5_reads_the_scene_again_where_one_stands(driver: Driver, room: Path) -> None:
    """Camera, speed and settings stay, also through an error, whose message has file and line. Lights are read as well."""
    session = driver.session
    session.change(0, a=0.7, bounces=0)
    session.free_camera.move(1.0, 0.0, 0.0, 0.2)
    session.free_camera.change_speed(2.0)
    driver.settle()
    camera, speed, before = session.camera, session.free_camera.speed, driver.canvas()
    rewrite(driver, room, ROOM.replace("brdf diffuse 0.7 0.1 0.1 1", "brdf diffuse 0.1 0.1 0.7 1"))
    driver.frame()
    assert "read again" in driver.said and session.camera == camera
    driver.settle()
    assert session.free_camera.speed == speed and session.settings(0)[1].a == 0.7
    left, was = driver.canvas()[100:140, 20:60].mean((0, 1)), before[100:140, 20:60].mean((0, 1))
    assert was[0] > was[2] and left[2] > left[0], "the left wall is blue now"
    good = driver.canvas()
    rewrite(driver, room, ROOM.replace("obj left.obj", "obj left.obj\nnonsense 1 2 3"))
    driver.frame()
    (said,) = errors(driver)
    assert f"room.scene:{ROOM.splitlines().index('obj left.obj') + 2}" in said
    driver.frame(2)
    assert np.array_equal(driver.canvas(), good) and session.at_rest
    rewrite(driver, room, ROOM)
    driver.frame()
    assert not errors(driver) and session.camera == camera
    rewrite(driver, room.with_name("lamp.light"), "position 0 0.8 0 1\nintensity 1 2 3\n")
    driver.frame()
    assert session.scene.lights[0].color == (1.0, 2.0, 3.0)


def test_a_dropped_scene_is_opened_with_the_same_settings(driver: Driver, room: Path, tmp_path: Path) -> None:
    """From its own first camera, remembered as the newest. One whose file is called `scene` has the name of its folder."""
    driver.session.options.frozen = True
    driver.session.change(0, a=0.7)
    (tmp_path / "hall").mkdir()
    other = write_room(tmp_path / "hall").rename(tmp_path / "hall" / "scene.scene")
    other.write_text(ROOM.replace("cam 0 0 2.6", "cam 0 0.1 2.2"))
    driver.viewer.controls.files_dropped([str(other), "second.scene"])
    push(driver, "F12")
    assert list(Path("pictures").glob("irrsplat-hall-*.png")) and driver.session.camera.eye == (0.0, 0.1, 2.2)
    assert driver.session.settings(0)[1].a == 0.7
    assert driver.actions.preferences.recent[:2] == [str(other), str(room)]
    driver.resize((640, 480), density=0.25)
    driver.choose("File", "Open recent")
    driver.frame(2)
    driver.choose(next(w.label.split("##")[0] for w in driver.widgets if w.label.endswith(f"##{room}")))
    assert driver.session.scene.name == "room"


def test_nonsense_is_refused_and_nothing_changes(driver: Driver, tmp_path: Path) -> None:
    before, camera = driver.canvas(), driver.session.camera
    for name in ("a.scene", "a.xyz", "a.path", "a.glb", "missing.scene", "."):
        if name.startswith("a."):
            (tmp_path / name).write_text("what is this\n")
        driver.actions.messages.lines.clear()
        driver.viewer.controls.files_dropped([name])
        driver.frame()
        (said,) = errors(driver)
        assert name in said or name == "."
    assert np.array_equal(driver.canvas(), before) and driver.session.camera == camera


def test_a_picture_that_cannot_be_written_is_named(driver: Driver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file stands where the pictures folder should be. The message has the path and the cause in words."""
    (tmp_path / "taken").write_text("")
    monkeypatch.setenv("XDG_PICTURES_DIR", str(tmp_path / "taken"))
    push(driver, "F12")
    driver.frame()
    assert errors(driver) == [f"{tmp_path / 'taken'}: cannot make this folder: File exists"]


def test_a_dropped_path_plays_to_its_end(driver: Driver, tmp_path: Path) -> None:
    """Half way it is in the middle: two keys make a line."""
    driver.session.options.frozen = True
    (tmp_path / "flight.path").write_text(PATH)
    driver.viewer.controls.files_dropped(["flight.path"])
    driver.frame(5, 0.1)
    assert driver.session.path_recorder.playing == pytest.approx(0.5)
    assert driver.session.views[0].camera.eye == pytest.approx((0.25, 0.1, 2.1))
    driver.frame(6, 0.1)
    assert driver.session.path_recorder.playing is None and driver.session.camera.eye == (0.5, 0.2, 1.6)
