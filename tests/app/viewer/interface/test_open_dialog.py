"""The dialog that opens scenes: folders, completion by Tab, the arrow keys, recent and bundled scenes; and framing a scene."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from irrsplat.app.viewer import preferences
from irrsplat.app.viewer.input.folder_listing import ENDINGS, FolderListing
from irrsplat.app.viewer.input.free_camera import FreeCamera
from irrsplat.core.errors import InputError
from irrsplat.scene.model import Camera
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


def test_a_folder_lists_folders_then_what_can_be_opened(folder: Path) -> None:
    listing = FolderListing()
    assert names(listing, folder) == ["rocks/", "Rooms/", "ROOF.GLB", "room.obj", "rooms.scene", "way.path"]
    assert names(listing, folder, "ROO") == ["Rooms/", "ROOF.GLB", "room.obj", "rooms.scene"], "whatever the case"
    assert names(listing, folder, ".") == [".hidden/", ".dot.obj"]
    assert names(listing, folder / "missing") == []
    assert ".path" in ENDINGS and ".scene" in ENDINGS


def test_a_new_file_is_seen_after_a_second(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [5.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    listing = FolderListing()
    before = names(listing, folder)
    (folder / "new.ply").write_text("")
    assert names(listing, folder) == before
    now[0] = 6.5
    assert sorted([*before, "new.ply"]) == sorted(names(listing, folder))


@pytest.mark.parametrize(("typed", "completed"), [
    ("w", "way.path"), ("roc", "rocks/"), ("room", "room"), ("room.", "room.obj"), ("R", "Roo"), ("xyz", "xyz"),
    ("./way", "./way.path"), ("rocks/", "rocks/"),
])  # fmt: skip
def test_a_path_is_completed_as_far_as_it_is_clear(folder: Path, typed: str, completed: str) -> None:
    if typed == "R":  # rocks/ and Rooms/ agree in "ro" but for case
        completed = "Ro"
    assert FolderListing().completed(typed, str(folder)) == completed


def test_an_absolute_path_is_completed_too_and_home_is_known(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(folder))
    listing = FolderListing()
    assert listing.completed(f"{folder}/wa", "/") == f"{folder}/way.path"
    assert listing.completed("~/wa", "/") == "~/way.path"
    assert listing.found("~/way.path", "/") == str(folder / "way.path")
    assert listing.found("cornell", str(folder)) == "cornell", "a bundled scene's name stays one"
    assert listing.found("room.obj", str(folder)) == str(folder / "room.obj")


@pytest.fixture
def dialog(driver: Driver, tmp_path: Path) -> Driver:
    """The dialog, open, in a folder with a scene in a folder."""
    inner = tmp_path / "inner"
    inner.mkdir()
    write_room(inner).rename(inner / "found.scene")
    driver.resize((640, 400), density=0.25)
    push(driver, "Ctrl+O")
    driver.viewer.interface.dialog.folder = str(tmp_path)
    driver.frame(2)
    return driver


def source_again(driver: Driver, before: str) -> None:
    with driver.wnd.ctx:
        driver.actions.open(before)


def test_tab_completes_and_enter_opens(dialog: Driver) -> None:
    before = dialog.actions.source
    dialog.type("inn")
    dialog.press("TAB")
    dialog.frame()
    assert dialog.viewer.interface.dialog.typed == "inner/" and dialog.session.options.split == "off"
    dialog.type("fo")
    dialog.press("TAB")
    dialog.frame()
    assert dialog.viewer.interface.dialog.typed == "inner/found.scene"
    dialog.press("ENTER")
    dialog.frame(2)
    assert dialog.session.scene.name == "found" and not dialog.actions.panels.open
    source_again(dialog, before)


def test_folders_and_files_are_clicked(dialog: Driver) -> None:
    before = dialog.actions.source
    dialog.choose("inner/")
    dialog.frame(2)
    assert {"..", "found.scene"} <= {w.label for w in dialog.widgets}
    dialog.choose("..", "inner/", "found.scene")
    assert dialog.session.scene.name == "found" and not dialog.actions.panels.open
    source_again(dialog, before)


def test_the_arrow_keys_choose(dialog: Driver) -> None:
    before = dialog.actions.source
    for keys in (("DOWN", "ENTER"), ("DOWN", "DOWN", "DOWN", "UP", "ENTER")):
        for key in keys:
            dialog.press(key)
        dialog.frame(3)
    assert "found.scene" not in dialog.said and dialog.viewer.interface.dialog.folder.endswith("inner")
    assert dialog.actions.messages.errors or dialog.session.scene.name in ("found", "box", "left")
    dialog.actions.messages.close_errors()
    source_again(dialog, before)


def test_recent_and_bundled_scenes_are_there_and_esc_closes(dialog: Driver) -> None:
    labels = {w.label.split("##")[0] for w in dialog.widgets}
    assert {"cornell", "furnace", Path(dialog.actions.source).name} <= labels
    push(dialog, "Esc")
    dialog.frame()
    assert not dialog.actions.panels.open


# ---- cameras -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.5])
@pytest.mark.parametrize("camera", [
    Camera((0, 0, 5), (0, 0, 0)), Camera((3, 9, -4), (0, 1, 0)), Camera((9, 9, 9), (20, 9, 7), (0, 1, 1), 70.0),
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


def test_a_key_frames_the_scene(driver: Driver) -> None:
    before = driver.session.camera
    driver.session.free_camera.move(0.0, 0.0, 1.0, 0.25)
    push(driver, "End")
    driver.frame(2)
    x, y, z = driver.session.camera.axes @ (driver.session.scene.corners - np.array(driver.session.camera.eye)).T
    half = math.tan(math.radians(before.fov / 2.0))
    assert (np.abs(y) < -z * half).all() and (np.abs(x) < -z * half * 320 / 240).all()


def test_bookmarks_are_renamed(driver: Driver) -> None:
    driver.resize((640, 400), density=0.25)
    push(driver, "B")
    push(driver, "B")
    first, second = driver.actions.bookmarks
    driver.choose("Camera", "bookmark 1")
    driver.frame(2)
    (line,) = (w for w in driver.widgets if w.kind == "input_text")
    driver.enter(line, "by the door")
    assert [b.name for b in driver.actions.bookmarks] == ["by the door", "bookmark 2"]
    for wrong in ("", "  ", "by the door"):
        with pytest.raises(InputError):
            driver.actions.rename(driver.actions.bookmarks[1], wrong)
    driver.actions.rename(driver.actions.bookmarks[1], "bookmark 2")
    assert [b.eye for b in driver.actions.bookmarks] == [first.eye, second.eye]


# ---- pictures of recent scenes ---------------------------------------------------------------------------------------------


def test_a_scene_s_picture_is_kept_and_shown(driver: Driver, tmp_path: Path) -> None:
    """Small, when another scene comes; on the recent one's name in menu and dialog; a damaged one shows nothing."""
    other = write_room(tmp_path)
    first, shown = driver.actions.source, driver.canvas()
    driver.actions.open(str(other))
    kept = preferences.picture_path(first)
    small = np.asarray(Image.open(kept).convert("RGB"), float)
    assert max(small.shape[:2]) <= preferences.PICTURE_SIDE
    assert small.mean((0, 1)) == pytest.approx(shown.mean((0, 1)), abs=2.0)
    driver.session.options.frozen = True
    driver.resize((640, 400))
    driver.frame(3)
    driver.choose("Scene")
    name = next(w for w in driver.widgets if w.kind == "menu_item" and w.label == first)
    areas = []
    for text in (kept.read_bytes(), b"no picture"):
        kept.write_bytes(text)
        driver.move(600.0, 390.0)
        driver.frame(3)
        before = driver.window()
        driver.move(*name.at())
        driver.frame(30, dt=0.1)
        areas.append((driver.window() != before).any(-1).sum())
    assert areas[0] > areas[1] + 10_000
    push(driver, "Esc")


def test_pictures_of_scenes_that_are_no_longer_recent_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path))
    for name in ("/a", "/b", "/c"):
        assert preferences.keep_picture(name, np.full((333, 500, 3), 0.5, "f4"), ["/a", "/c"]) is None
    assert {p.name for p in (tmp_path / "pictures").iterdir()} == {preferences.picture_path(n).name for n in ("/a", "/c")}
    assert np.asarray(Image.open(preferences.picture_path("/c"))).shape == (111, 166, 3)
    assert preferences.keep_picture("/d", np.zeros((1, 1, 3), "f4"), []) is None
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path / "file"))
    assert "file" in str(preferences.keep_picture("/d", np.zeros((1, 1, 3), "f4"), []))
