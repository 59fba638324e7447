"""What the viewer reads while it runs: scenes and paths, dropped, typed or changed on disk, and shaders; right and wrong ones."""

from __future__ import annotations

import itertools
import os
import shutil
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from irrsplat.core import paths
from irrsplat.core.errors import InputError
from irrsplat.gpu import shader_source
from irrsplat.scene import load
from tests.support.skies import save_exr
from tests.support.viewing import ROOM, Driver, push, write_room

_SAVES = itertools.count()
PATH = "frames 31\ncam 0 0 2.6  0 0 0  0 1 0\ncam 0.5 0.2 1.6  0 0 0  0 1 0\n"


@pytest.fixture
def room(one: Driver) -> Iterator[Path]:
    """The file of the scene on show, put back in the end."""
    path = Path(one.actions.source)
    yield path
    write_room(path.parent)
    with one.wnd.ctx:
        one.actions.attempt(lambda: one.actions.open(str(path)))


@pytest.fixture
def copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the shaders, which is read instead of them."""
    folder = tmp_path / "shaders"
    shutil.copytree(paths.folder("shaders"), folder)
    monkeypatch.setattr(shader_source, "folder", lambda name: folder)
    return folder


def rewrite(driver: Driver, path: Path, text: str) -> None:
    """Somebody saved the file a second ago, and it is time to look."""
    path.write_text(text)
    then = time.time() - 1000.0 + next(_SAVES)  # another time for each
    os.utime(path, (then, then))
    driver.actions.file_watch._next = 0.0


def errors(driver: Driver) -> list[str]:
    return [m.text for m in driver.actions.messages.lines if m.error]


# ---- shaders -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["image/composite.frag", "viewer/buffers/picture.glsl", "viewer/gui.frag"])
def test_a_broken_shader_is_told_and_the_last_good_one_goes_on(driver: Driver, copied: Path, name: str) -> None:
    """File and line, whoever's shader it is; mended, F5 reads it again, and the error is gone."""
    file = copied / name
    good = file.read_text()
    lines = good.splitlines()
    at = next(i for i, line in enumerate(lines) if "void main" in line)
    file.write_text("\n".join([*lines[:at], "float wrong = nonsense;", *lines[at:]]))
    before, renderer = driver.canvas(), driver.session.renderers[0]
    push(driver, "F5")
    (said,) = errors(driver)
    assert f"{name}:{at + 1}: " in said and "nonsense" in said
    driver.frame(4)
    assert errors(driver) and driver.session.renderers[0] is renderer and np.array_equal(driver.canvas(), before)
    file.write_text(good)
    push(driver, "F5")
    assert not errors(driver) and "read again" in driver.said
    driver.settle()
    assert np.abs(driver.canvas().astype(float) - before).mean() < 2.0


def test_a_changed_shader_shows_at_once(driver: Driver, copied: Path) -> None:
    """The viewer's own shaders, the interface's among them, are read again as the core's are."""
    driver.actions.panels.settings = True
    driver.frame(4)
    assert (driver.window() != driver.canvas()).any(-1).mean() > 0.3
    file = copied / "viewer/gui.frag"
    good = file.read_text()
    assert "out_color = " in good
    file.write_text(good.replace("out_color = ", "out_color = 0.0 * "))
    push(driver, "F5")
    assert not errors(driver)
    driver.frame(3)
    assert np.array_equal(driver.window(), driver.canvas()), "no pixel of the interface is drawn"
    file.write_text(good)
    push(driver, "F5")
    driver.frame(3)
    assert (driver.window() != driver.canvas()).any(-1).mean() > 0.3


def test_a_changed_core_shader_shows_where_no_record_changes(driver: Driver, copied: Path) -> None:
    """Without bounces nothing but the composite's own texture differs, and the picture is drawn again all the same."""
    driver.session.change(0, bounces=0)
    driver.settle()
    before, file = driver.canvas().astype(int), copied / "image/composite.frag"
    good = file.read_text()
    assert "out_image = vec4(" in good
    file.write_text(good.replace("out_image = vec4(", "out_image = 2.0 * vec4("))
    driver.session.reload_shaders(*driver.actions._other_programs())
    driver.settle()
    after = driver.canvas().astype(int)
    assert (after >= before).all() and (after > before).mean() > 0.4
    file.write_text(good)
    driver.session.reload_shaders(*driver.actions._other_programs())
    driver.settle()
    assert np.array_equal(driver.canvas(), before)


# ---- scenes on disk ------------------------------------------------------------------------------------------------------


def test_a_scene_that_changes_on_disk_is_read_again_where_one_stands(driver: Driver, room: Path) -> None:
    """Camera, speed, settings and what plays stay; so they do through an error, which is told by file and line."""
    driver.session.change(0, a=0.7)
    driver.session.free_camera.move(1.0, 0.0, 0.0, 0.2)
    driver.session.free_camera.change_speed(2.0)
    driver.settle()
    camera, speed, before = driver.session.camera, driver.session.free_camera.speed, driver.canvas()
    rewrite(driver, room, ROOM.replace("brdf diffuse 0.7 0.1 0.1 1", "brdf diffuse 0.1 0.1 0.7 1"))
    driver.frame()
    assert "has changed" in driver.said and driver.session.camera == camera
    driver.settle()
    assert driver.session.free_camera.speed == speed and driver.session.settings(0)[1].a == 0.7
    left, was = driver.canvas()[100:140, 20:60].mean((0, 1)), before[100:140, 20:60].mean((0, 1))
    assert was[0] > was[2] and left[2] > left[0], "the left wall is blue now"
    good = driver.canvas()
    rewrite(driver, room, ROOM.replace("obj left.obj", "obj left.obj\nnonsense 1 2 3"))
    driver.frame()
    (said,) = errors(driver)
    line = 1 + ROOM.splitlines().index("obj left.obj") + 1
    assert f"room.scene:{line}" in said
    driver.frame(3)
    assert np.array_equal(driver.canvas(), good) and driver.session.at_rest
    rewrite(driver, room, ROOM)
    driver.frame()
    assert not errors(driver) and driver.session.camera == camera
    driver.settle()
    assert np.abs(driver.canvas().astype(float) - before).mean() < 2.0


def test_a_mesh_or_a_light_that_changes_counts_too(driver: Driver, room: Path) -> None:
    rewrite(driver, room.with_name("lamp.light"), "position 0 0.8 0 1\nintensity 1 2 3\n")
    driver.frame()
    assert driver.session.scene.lights[0].color == (1.0, 2.0, 3.0)
    assert driver.actions.editor.lamps[0].light.position == (0.0, 0.8, 0.0)


def test_while_a_file_is_being_written_nobody_reads_it(driver: Driver, room: Path) -> None:
    renderer = driver.session.renderers[0]
    room.write_text(ROOM[:40])
    driver.actions.file_watch._next = 0.0
    driver.frame()
    assert driver.session.renderers[0] is renderer and not driver.said


# ---- opened by hand -------------------------------------------------------------------------------------------------------


def test_a_dropped_scene_is_opened_with_the_same_settings(driver: Driver, room: Path, tmp_path: Path) -> None:
    """From its own first camera, remembered as the newest; two presets stay two."""
    driver.session.options.frozen = True
    driver.session.split("presets")
    driver.session.change(0, a=0.7)
    other = write_room(tmp_path).rename(tmp_path / "other.scene")
    other.write_text(ROOM.replace("cam 0 0 2.6", "cam 0 0.1 2.2"))
    driver.viewer.controls.files_dropped([str(other), "second.scene"])
    driver.frame()
    assert driver.session.scene.name == "other" and driver.session.camera.eye == (0.0, 0.1, 2.2)
    assert [r.preset for r in driver.session.renderers] == ["default", "paper"] and driver.session.settings(0)[1].a == 0.7
    assert driver.actions.preferences.recent[:2] == [str(other), str(room)] and driver.actions.source == str(other)
    driver.choose("Scene", str(room))
    assert driver.session.scene.name == "room"


@pytest.mark.parametrize("content", ["what is this\n", ""])
def test_nonsense_is_refused_and_nothing_changes(driver: Driver, tmp_path: Path, content: str) -> None:
    before, camera = driver.canvas(), driver.session.camera
    for name in ("a.scene", "a.xyz", "a.path", "a.glb", "missing.scene", "."):
        if name.startswith("a."):
            (tmp_path / name).write_text(content)
        driver.actions.messages.lines.clear()
        driver.viewer.controls.files_dropped([name])
        driver.frame()
        (said,) = errors(driver)
        assert name in said or name == "."
    assert np.array_equal(driver.canvas(), before) and driver.session.camera == camera
    driver.viewer.controls.files_dropped([])


def test_a_dropped_path_plays_to_its_end(driver: Driver, tmp_path: Path) -> None:
    (tmp_path / "flight.path").write_text(PATH)
    driver.viewer.controls.files_dropped(["flight.path"])
    driver.frame(10, 0.05)
    assert driver.session.path_recorder.playing == pytest.approx(0.5)
    assert driver.session.views[0].camera.eye == pytest.approx((0.25, 0.1, 2.1))  # half way, evenly: two keys make a line
    driver.frame(15, 0.05)
    assert driver.session.path_recorder.playing is None and driver.session.camera.eye == (0.5, 0.2, 1.6)


def test_a_scene_is_typed_into_the_dialog(driver: Driver, room: Path, tmp_path: Path) -> None:
    other = write_room(tmp_path).rename(tmp_path / "typed.scene")
    push(driver, "Ctrl+O")
    driver.frame(3)
    driver.type("nothing.scene")
    driver.press("ENTER")
    assert "nothing.scene" in errors(driver)[0] and driver.actions.panels.open
    driver.frame(2)
    (line,) = (w for w in driver.widgets if w.kind == "input_text")
    driver.enter(line, str(other))
    assert driver.session.scene.name == "typed" and not driver.actions.panels.open and not errors(driver)


def test_bookmarks_are_those_of_the_scene(driver: Driver, room: Path, tmp_path: Path) -> None:
    push(driver, "B")
    other = write_room(tmp_path)
    driver.actions.open(str(other))
    assert driver.actions.bookmarks == []
    driver.actions.open(str(room))
    assert [b.name for b in driver.actions.bookmarks] == ["bookmark 1"]


def test_too_many_lights_are_refused_and_nothing_is_lost(driver: Driver) -> None:
    """Also for two renderers, of which the first may be made already."""
    scene = load(driver.actions.source)
    driver.session.split("presets")
    with pytest.raises(InputError, match="lights"):
        driver.session.open(replace(scene, lights=scene.lights * 10_000))
    driver.frame(2)
    assert len(driver.session.scene.lights) == 1 and driver.session.renderers[0].scene is not None


# ---- skies ---------------------------------------------------------------------------------------------------------------


def test_a_map_of_the_sky_is_shown_and_watched(driver: Driver, room: Path) -> None:
    """A green map lights the room and stands before it, in what records saw as well; when its file has changed to a blue one, so
    have the picture and the room's light."""
    sky = room.parent / "sky.exr"
    for channel in (1, 2):
        radiance = np.zeros((16, 32, 3), "f4")
        radiance[..., channel] = 2.0
        save_exr(sky, radiance)
        then = time.time() - 1000.0 + next(_SAVES)
        os.utime(sky, (then, then))
        if channel == 1:
            rewrite(driver, room, ROOM.replace("light lamp.light", "sky sky.exr"))
        driver.actions.file_watch._next = 0.0
        driver.settle()
        assert driver.session.scene.environment is not None and str(sky) in driver.session.scene.files
        assert not errors(driver)
        for name in ("image", "atlas"):
            driver.actions.show(name)
            driver.settle()
            if name == "atlas":  # the last batch has as many records as the last tick had time for: the first one has many
                driver.session.change(0, budget=2000.0)
                driver.session.clear()
                driver.frame()
            picture = driver.canvas().reshape(-1, 3)
            others = np.delete(picture, channel, axis=1).max(1)
            assert ((picture[:, channel] > 100) & (others < 20)).mean() > 0.05, f"{name}: {picture.mean(0)}"
        driver.actions.show("image")
