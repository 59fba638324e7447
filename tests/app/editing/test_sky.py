"""The sun by place, date and time: against what a file with that sky gives; with undo, and saved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import irrsplat
from irrsplat.app.viewer.editing.light_edit import LightEdit
from irrsplat.app.viewer.editing.scene_edit import SceneEdit
from irrsplat.app.viewer.editing.sun_sky import SunSky
from irrsplat.scene.io.text.scene_writer import write_scene
from irrsplat.scene.model import Light
from tests.support.viewing import ROOM, Driver, write_room

LINE = "cie clear at 52.5 13.4 2026-06-21T15:30+02:00 turbidity 3.0 north 20"


def test_a_line_says_the_same_sky() -> None:
    """Read and said again; another kind, a clock west of Greenwich, and no place at all."""
    found = SunSky.of(LINE)
    assert found == SunSky("clear", 52.5, 13.4, 2026, 172, 15 * 60 + 30, 2.0, 3.0, north=20.0)
    for sky in (found, SunSky("overcast", -33.9, 151.2, minute=61, zone=-3.5, lux=9000.0)):
        assert sky is not None and SunSky.of(sky.line) == sky
    assert SunSky.of("cie clear sun 40 180") is None and SunSky.of("") is None


def test_a_sky_that_is_set_is_the_sky_of_a_file(driver: Driver, tmp_path: Path) -> None:
    """Saved and read again, sun and sky are the same. It is undone to the very scene, and passes through the night."""
    path = write_room(tmp_path)
    path.write_text(ROOM.replace("light lamp.light", f"sky {LINE}"))
    driver.session.options.frozen = True
    driver.resize((64, 48))
    driver.actions.open(str(path))
    driver.frame()
    editor, before = driver.actions.editor, driver.session.scene
    night = SunSky(latitude=40.0, longitude=-3.7, minute=60)
    wanted = SunSky(latitude=40.0, longitude=-3.7, minute=10 * 60, day=80, turbidity=2.0, north=10.0)
    for sky in (night, wanted):
        editor.set_sky(sky)
        driver.frame(2)
    assert len(editor.past) == 2 and driver.session.scene.environment is not None
    shown = driver.session.scene.environment.shown
    (sun,) = (lamp for lamp in editor.lights if lamp.of_sky)
    assert write_scene(driver.session.scene, tmp_path / "saved.scene") == ""
    again = irrsplat.load(tmp_path / "saved.scene")
    assert [light for light in again.lights if light.name == "sun"] == [sun.light] and again.environment is not None
    assert len(shown) == 1024 and np.array_equal(again.environment.shown, shown)
    editor.undo()
    assert driver.session.scene.environment is None and editor.redoes
    editor.undo()
    assert driver.session.scene.environment is before.environment and driver.session.scene.lights == before.lights
    editor.redo()
    editor.redo()
    assert editor.sky == wanted


def test_the_sun_of_a_date_replaces_the_brightest_directional_light() -> None:
    """A scene with a sun of its own has one sun afterwards, and its other lights."""
    sun, lamp = Light((0.3, 1.0, 0.2), (2.0, 2.0, 2.0), directional=True), Light((0.0, 1.0, 0.0), (5.0, 5.0, 5.0))
    dim = replace(sun, position=(1.0, 0.2, 0.0), color=(0.1, 0.1, 0.1))
    edit = SceneEdit((LightEdit.of(lamp), LightEdit.of(dim), LightEdit.of(sun)), ())
    sky = SunSky(latitude=40.0, longitude=-3.7, minute=10 * 60, day=80)
    made = edit.with_sky(sky, sky.environment((0.0, 1.0, 0.0), rows=96))
    assert [one.light for one in made.lights[:2]] == [lamp, dim] and len(made.lights) == 3
    assert made.lights[2].of_sky and made.lights[2].light.name == "sun"
