"""The dialog that opens scenes: folders, completion by Tab, the arrow keys, recent and bundled scenes; and framing a scene."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from irrsplat.app.viewer import preferences
from irrsplat.app.viewer.input.folder_listing import FolderListing
from irrsplat.app.viewer.input.free_camera import FreeCamera
from irrsplat.scene.model import Camera
from tests.support.counted_clock import CountedClock
from tests.support.viewing import Driver, push, write_room


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Scenes, folders and what is neither."""
    top = tmp_path / "files"
    for name in ("Rooms", "rocks", ".hidden"):
        (top / name).mkdir(parents=True)
    for name in ("room.obj", "ROOF.GLB", "notes.txt", "way.path", ".dot.obj", "rooms.scene"):
        (top / name).write_text("")
    return top


def names(listing: FolderListing, folder: Path, begin: str = "") -> list[str]:
    return [entry.shown for entry in listing.entries(str(folder), begin)]


def test_a_folder_lists_folders_then_what_can_be_opened(folder: Path, clock: CountedClock) -> None:
    """Whatever the case; a new file is seen after a second."""
    listing = FolderListing()
    before = names(listing, folder)
    assert before == ["rocks/", "Rooms/", "ROOF.GLB", "room.obj", "rooms.scene", "way.path"]
    assert names(listing, folder, "ROO") == ["Rooms/", "ROOF.GLB", "room.obj", "rooms.scene"]
    assert names(listing, folder, ".") == [".hidden/", ".dot.obj"]
    (folder / "new.ply").write_text("")
    assert names(listing, folder) == before
    clock.advance(1.5)
    assert sorted([*before, "new.ply"]) == sorted(names(listing, folder))
    assert names(listing, folder / "missing") == []


def test_a_path_is_completed_as_far_as_it_is_clear(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Relative to a folder, absolute, or from the home folder. rocks/ and Rooms/ agree in "ro" but for case."""
    monkeypatch.setenv("HOME", str(folder))
    listing, clear = FolderListing(), {"w": "way.path", "roc": "rocks/", "room": "room", "room.": "room.obj", "R": "Ro"}
    clear |= {"xyz": "xyz", "./way": "./way.path", "rocks/": "rocks/"}
    clear |= {f"{folder}/wa": f"{folder}/way.path", "~/wa": "~/way.path"}
    assert {typed: listing.completed(typed, str(folder)) for typed in clear} == clear
    assert listing.found("~/way.path", "/") == str(folder / "way.path")
    assert listing.found("cornell", str(folder)) == "cornell", "a bundled scene's name stays one"
    assert listing.found("room.obj", str(folder)) == str(folder / "room.obj")


def test_scenes_are_opened_by_tab_by_a_click_and_by_the_arrow_keys(driver: Driver, tmp_path: Path) -> None:
    """A scene in a folder; recent and bundled scenes are there too, and Esc closes the dialog."""
    inner = tmp_path / "inner"
    inner.mkdir()
    write_room(inner).rename(inner / "found.scene")
    driver.session.options.frozen = True
    driver.resize((640, 400), density=0.25)
    dialog, actions = driver.viewer.interface.dialog, driver.actions

    def opened() -> None:
        """Check that the scene is there and the dialog is closed; then open the room again, and the dialog."""
        assert driver.session.scene.name == "found" and not actions.panels.open
        actions.open(driver.source)
        begin()

    def begin() -> None:
        push(driver, "Ctrl+O")
        dialog.folder = str(tmp_path)
        driver.frame(2)

    begin()
    assert {"cornell", "furnace", Path(driver.source).name} <= {w.label.split("##")[0] for w in driver.widgets}
    for typed, completed in (("inn", "inner/"), ("fo", "inner/found.scene")):
        driver.type(typed)
        driver.press("TAB")
        driver.frame()
        assert dialog.typed == completed and driver.session.options.split == "off"
    driver.press("ENTER")
    driver.frame(2)
    opened()
    driver.choose("inner/")
    driver.frame(2)
    driver.choose("..", "inner/", "found.scene")
    opened()
    for keys in (("DOWN", "DOWN", "UP", "DOWN", "ENTER"), ("DOWN", "ENTER")):  # config/, which the test has made, is first
        for key in keys:
            driver.press(key)
        driver.frame(3)
    assert driver.session.scene.name == "box"
    push(driver, "Ctrl+O")
    push(driver, "Esc")
    assert not actions.panels.open


@pytest.mark.parametrize(("camera", "aspect"), [
    (Camera((0, 0, 5), (0, 0, 0)), 1.0), (Camera((3, 9, -4), (0, 1, 0)), 0.5),
    (Camera((9, 9, 9), (20, 9, 7), (0, 1, 1), 70.0), 2.5),
])  # fmt: skip
def test_all_of_a_box_is_in_the_picture_and_the_direction_stays(camera: Camera, aspect: float) -> None:
    """Its corners are within the picture, and one is within a twentieth of the border, in the narrower direction or the other."""
    bounds = np.array([(-1.0, 0.0, 2.0), (3.0, 5.0, 4.0)])
    flight = FreeCamera(camera, 7.0)
    axes = flight.camera.axes
    flight.frame(bounds, aspect)
    np.testing.assert_allclose(flight.camera.axes, axes, atol=1e-9)
    corners = np.array(np.meshgrid(*bounds.T)).reshape(3, -1).T
    x, y, z = axes @ (corners - np.array(flight.camera.eye)).T
    half = math.tan(math.radians(camera.fov / 2.0))
    reach = np.maximum(np.abs(x) / (-z * half * aspect), np.abs(y) / (-z * half))
    assert (z < 0.0).all() and 0.95 < reach.max() < 1.0
    assert flight.camera.target == pytest.approx((1.0, 2.5, 3.0))


def test_a_picture_of_a_recent_scene_is_kept_and_shown(driver: Driver, tmp_path: Path) -> None:
    """Small, when another scene comes; on the recent one's name in the menu."""
    other = write_room(tmp_path)
    first, shown = driver.actions.source, driver.canvas()
    driver.actions.open(str(other))
    kept = preferences.picture_path(first)
    small = np.asarray(Image.open(kept).convert("RGB"), float)
    assert max(small.shape[:2]) <= preferences.PICTURE_SIDE
    assert small.mean((0, 1)) == pytest.approx(shown.mean((0, 1)), abs=2.0)
    driver.session.options.frozen = True
    driver.resize((640, 400), density=0.25)
    driver.frame(3)
    driver.choose("Scene")
    name, before = next(w for w in driver.widgets if w.kind == "menu_item" and w.label == first), driver.window()
    driver.move(*name.at())
    driver.frame(6, dt=0.5)
    assert (driver.window() != before).any(-1).sum() > 900
    push(driver, "Esc")
