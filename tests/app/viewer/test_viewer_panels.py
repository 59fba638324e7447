"""Panels by mouse and keyboard: widgets of settings, presets, menus, lights, and the key Tab."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.editing.objects import light_units
from irrsplat.app.viewer.input.prompts import OF_RENDERS
from irrsplat.app.viewer.show.light.measuring_plane import spacing
from irrsplat.app.viewer.view_options import Point
from irrsplat.meter.plane import Plane
from irrsplat.scene.model import Camera
from irrsplat.settings import PRESETS, SETTINGS, preset
from tests.support.viewing import ROOM, Driver, fresh, push, viewing, write_room

TALL = (760, 1500)  # so that the whole panel fits
STAGES = ("view", "composite", "examine", "splat", "gather", "shadow")


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Driver]:
    """Provide a tall window of few pixels without bounces, because most of these tests need no indirect light."""
    with viewing(write_room(tmp_path_factory.mktemp("room")), TALL, bounces=0) as driver:
        driver.density = 0.25  # drawing takes most of the time
        yield driver


@pytest.fixture
def driver(one: Driver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Driver]:
    """Provide the viewer in its initial converged state; it writes to `tmp_path`."""
    yield from fresh(one, tmp_path, monkeypatch)


@pytest.fixture
def panel(driver: Driver) -> Driver:
    """Unfold all stages of the settings, freeze the cache and show an empty view, for fast frames."""
    driver.session.free_camera.camera = Camera((0.0, 0.0, 90.0), (0.0, 0.0, 99.0))
    driver.session.options.controls = driver.session.options.settings = driver.session.options.frozen = True
    driver.frame(3)
    for stage in STAGES:
        if all(d.stage != stage or label(d.name) not in shown(driver) for d in SETTINGS.values()):
            driver.click(*driver.find(stage, header=True).at())
            driver.frame(2)
    return driver


def value(driver: Driver, name: str) -> Any:
    return getattr(driver.session.renderers[0].settings, name)


def shown(driver: Driver) -> set[str]:
    """Return the labels of all widgets except collapsible headers."""
    return {w.label.split("##")[0] for w in driver.widgets if w.kind != "collapsing_header"}


def label(name: str) -> str:
    return name.replace("_", " ")


def test_a_widget_changes_its_setting_alone_and_the_arrow_takes_it_back(panel: Driver) -> None:
    """Each setting of a view has a widget: a number typed after Ctrl+click, also beyond the slider's range, a list or a box."""
    assert {label(name) for name in SETTINGS.keys() - OF_RENDERS} <= shown(panel)
    changes = {"max_records": 9000, "radius_max": 60.0, "tolerance": 4.0, "weights": "paper", "gradients": False}
    for name, expected in changes.items():
        old, camera = panel.session.renderers[0].settings, panel.session.camera
        widget = panel.find(label(name))
        if isinstance(expected, str):
            rows = 1 + list(SETTINGS[name].choices).index(expected)
            panel.click(*widget.at())
            panel.click(widget.at()[0], widget.at()[1] + rows * 0.8 * (widget.box[3] - widget.box[1]))
        elif isinstance(expected, bool):
            panel.click(widget.box[0] + 8.0, widget.at()[1])
        else:
            panel.enter(widget, f"{expected:g}")
        changed = panel.session.renderers[0].settings
        assert getattr(changed, name) == expected
        assert [n for n in SETTINGS if getattr(changed, n) != getattr(old, n)] == [name] and panel.session.camera == camera
        panel.click(*panel.find("←", beside=label(name)).at())
        assert value(panel, name) == getattr(preset("default"), name)


def test_presets_are_in_the_list_and_in_the_menu(panel: Driver) -> None:
    for way, name, prefix in (("Render", "preview", "Preset "), ("preset", "default", "")):
        panel.choose(way)
        assert {prefix + name for name in PRESETS} <= shown(panel)
        panel.choose(prefix + name)
        assert panel.session.renderers[0].preset == name


def test_tab_goes_to_the_next_field_and_outside_of_fields_to_the_next_split(panel: Driver) -> None:
    """Esc leaves the fields. After a click into the panel, keys still belong to the picture and change no setting."""
    panel.down("LEFT_CTRL")
    panel.click(*panel.find("a").at())
    panel.press("A")
    panel.up("LEFT_CTRL")
    panel.type("0.8")
    panel.press("TAB")
    panel.frame(2)
    assert panel.viewer.backend.io.want_capture_keyboard and not panel.session.options.split
    assert value(panel, "a") == pytest.approx(0.8)
    panel.actions.editor.mesh = 0
    panel.press("ESCAPE")
    panel.frame(2)
    assert panel.actions.editor.mesh == 0  # the key has left the field, and has not deselected the object
    panel.actions.editor.mesh = None
    for on in (True, False, True):
        panel.press("TAB")
        panel.frame(3)
        assert panel.session.options.split == on and not panel.viewer.backend.io.want_capture_keyboard
        assert ("preset left" in shown(panel)) == on
        if not on:
            for _ in range(2):
                panel.click(*panel.find("gradients").at())
    before, panel.session.options.side = [renderer.settings for renderer in panel.session.renderers], 0
    push(panel, "5")
    panel.type("5")
    assert panel.session.options.buffer == "weight"
    assert [renderer.settings for renderer in panel.session.renderers] == before


def test_the_menus(driver: Driver) -> None:
    """The menus select buffers, overlays and cameras."""
    options, session = driver.session.options, driver.session
    options.frozen = True
    driver.resize((760, 900), density=0.25)
    driver.choose("View", "Buffer")
    assert {buffer.title for buffer in BUFFERS.values()} <= shown(driver)
    driver.choose(BUFFERS["light"].title)
    assert options.buffer == "light"
    driver.choose("View", "Record discs")
    assert options.discs
    driver.choose("View", "Camera", "corner")
    assert session.camera == session.scene.camera("corner")
    driver.choose("View", "Camera", "First camera")
    assert session.camera == session.scene.camera()


def test_a_light_is_dimmed_and_a_spot_is_narrowed(driver: Driver) -> None:
    """Output and cone by typed values, in a room whose only light is a spot 1 m before the rear wall.

    On the axis, 1 m away, illuminance in lux is the intensity in candela. At 0.7133 m from the axis the angle is 35.5°.
    """
    (loaded,) = driver.session.scene.lights
    spot = replace(loaded, position=(0.0, 0.2, 0.0), spot_target=(0.0, 0.2, -1.0), spot_cutoff=60.0, spot_inner=50.0)
    driver.actions.editor.set_light(0, spot)
    driver.actions.toggle("lights")
    driver.frame(3)
    middle, away = (0.0, 0.2, -1.0), (0.0, 0.9133, -1.0)

    def lux(point: Point) -> float:
        driver.settle()
        found = driver.display.light_at(point)
        assert found is not None
        return found

    candela = light_units(spot)["candela"]
    assert lux(middle) == pytest.approx(candela, rel=0.02) and lux(away) > 0.3 * candela
    driver.enter(driver.find("cone"), "30")
    (narrow,) = driver.session.scene.lights
    assert narrow.spot_cutoff == pytest.approx(30.0)
    assert lux(middle) == pytest.approx(candela, rel=0.02) and lux(away) == 0.0
    driver.enter(driver.find("candela"), f"{candela / 2:.6g}")
    assert lux(middle) == pytest.approx(candela / 2, rel=0.02)
    driver.enter(driver.find("candela"), "0")
    assert lux(middle) == 0.0


def test_a_scene_of_two_millimetres_is_edited_and_measured_as_a_room_is(panel: Driver, tmp_path: Path) -> None:
    """Handles move an object by the mouse's motion; the plane at half the height has 4 points per side, one of 20 km has 50."""
    path = write_room(tmp_path)
    small = ROOM.replace("cam 0 0 2.6", "cam 0 0 0.0026").replace("obj walls", "push\nscale 0.001 0.001 0.001\nobj walls")
    path.write_text(f"{small}pop\n")
    panel.actions.open(str(path))
    panel.session.options.frozen = True
    panel.frame(3)
    editor = panel.actions.editor
    editor.mesh = 0
    panel.frame(2)
    x, y = panel.seen((0.0, 0.0, 0.0))
    panel.drag((x, y), (x - 40.0, y))
    metres = 0.0026 * panel.session.camera.screen / panel.viewer.interface.layout.picture_size[1]  # by a pixel
    offset = editor.scene.meshes[0].positions[0] - editor.loaded.meshes[0].positions[0]
    assert offset == pytest.approx((-40.0 * metres, 0.0, 0.0), rel=0.05, abs=metres)
    assert panel.session.plane.height == pytest.approx(0.001)
    for side, points in ((0.002, 4), (2e4, 50)):
        assert spacing(Plane((0.0, 0.0, 0.0), (side, 0.0, 0.0), (0.0, 0.0, -side))) == pytest.approx(side / points)
