"""Files that a running viewer opens: valid and invalid scenes and paths."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.support.viewing import ROOM, Driver, push, write_room


@pytest.fixture
def room(one: Driver) -> Iterator[Path]:
    """Provide the file of the open scene; restore it at the end."""
    path = Path(one.actions.source)
    yield path
    write_room(path.parent)
    with one.wnd.ctx:
        one.actions.attempt(lambda: one.actions.open(str(path)))


def errors(driver: Driver) -> list[str]:
    return [m.text for m in driver.actions.messages.errors]


def test_a_dropped_scene_is_opened_with_the_same_settings(driver: Driver, room: Path, tmp_path: Path) -> None:
    """The first scene of several files has its first camera, is the newest recent scene, and ends notices of the former scene.

    A message names the other scenes. A file called `scene` has its folder's name.
    """
    (tmp_path / "bare.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    driver.actions.announce, before = driver.viewer.announce, driver.session.scene
    driver.viewer.controls.files_dropped([str(tmp_path / "bare.obj")])
    driver.frame()
    assert "opening bare.obj" in driver.said and driver.session.scene is before  # the work waits until a frame announces it
    driver.frame()
    driver.actions.announce = lambda words, work: work()
    assert "opening" not in driver.said
    assert any("bare.obj: no camera" in line.text for line in driver.actions.messages.lines)
    driver.session.options.frozen = True
    driver.session.change(0, a=0.7)
    (tmp_path / "hall").mkdir()
    other = write_room(tmp_path / "hall").rename(tmp_path / "hall" / "scene.scene")
    other.write_text(ROOM.replace("cam 0 0 2.6", "cam 0 0.1 2.2"))
    driver.viewer.controls.files_dropped(["texture.png", str(other), "second.scene"])
    assert "bare.obj" not in driver.said and driver.said.endswith("second.scene") and "texture" not in driver.said
    push(driver, "F12")
    assert list(Path("pictures").glob("irrsplat-hall-*.png")) and driver.session.camera.eye == (0.0, 0.1, 2.2)
    assert driver.session.renderers[0].settings.a == 0.7
    assert driver.actions.preferences.recent[:3] == [str(other), str(tmp_path / "bare.obj"), str(room)]
    driver.resize((640, 480), density=0.25)
    driver.choose("File", "Open recent")
    driver.frame(2)
    driver.choose(next(w.label.split("##")[0] for w in driver.widgets if w.label.endswith(f"##{room}")))
    assert driver.session.scene.name == "room"


def test_a_file_that_another_program_has_changed_is_opened_again_at_the_present_camera(driver: Driver, room: Path) -> None:
    driver.session.free_camera.turn(0.2, 0.0)
    camera, lights = driver.session.camera, len(driver.session.scene.lights)
    room.write_text(ROOM + "light lamp.light\n")
    driver.frame()
    assert driver.said.endswith("has changed on disk; F5 opens the scene again") and driver.actions.changed
    push(driver, "F5")
    assert len(driver.session.scene.lights) == lights + 1 and driver.session.camera == camera
    assert not driver.said and not driver.actions.changed
    driver.actions.editor.add_light()  # unsaved changes are saved elsewhere first
    room.write_text(ROOM + 2 * "light lamp.light\n")
    push(driver, "F5")
    for _ in ("save", "the suggested name"):
        driver.frame(3)
        driver.press("ENTER")
    driver.frame(2)
    assert len(driver.session.scene.lights) == lights + 2 and driver.actions.file == str(room)


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
    """A file is in place of the pictures folder: the message contains the path and the cause."""
    (tmp_path / "taken").write_text("")
    monkeypatch.setenv("XDG_PICTURES_DIR", str(tmp_path / "taken"))
    push(driver, "F12")
    driver.frame()
    assert errors(driver) == [f"{tmp_path / 'taken'}: cannot make this folder: File exists"]
