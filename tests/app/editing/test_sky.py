"""The sun by place, date and time: against what a file with that sky gives; with undo, in the panel, and saved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.app.viewer.editing.editor import Editor
from irrsplat.app.viewer.editing.sun_sky import SunSky
from irrsplat.app.viewer.session import overrides
from irrsplat.renderer import Renderer
from irrsplat.scene.io.text.scene_writer import write_scene
from tests.renderer.test_no_holes import holes
from tests.support.viewing import ROOM, Driver, viewing, write_room

LINE = "cie clear at 52.5 13.4 2026-06-21T15:30+02:00 turbidity 3.0 north 20"


def under_sky(folder: Path, line: str) -> Path:
    """The room without its lamp, under a sky."""
    path = write_room(folder)
    path.write_text(ROOM.replace("light lamp.light", f"sky {line}"))
    return path


def test_a_line_says_the_same_sky() -> None:
    """Read and said again; another kind, a clock west of Greenwich, and no place at all."""
    found = SunSky.of(LINE)
    assert found == SunSky("clear", 52.5, 13.4, 2026, 172, 15 * 60 + 30, 2.0, 3.0, north=20.0)
    for sky in (found, SunSky("overcast", -33.9, 151.2, minute=61, zone=-3.5, lux=9000.0)):
        assert sky is not None and SunSky.of(sky.line) == sky
    assert SunSky.of("cie clear sun 40 180") is None and SunSky.of("") is None


@pytest.mark.slow
def test_a_sky_that_is_set_is_the_sky_of_a_file(tmp_path: Path) -> None:
    """Another time, in a scene under a sky: at rest its records and its picture are as a new renderer's of a
    file with that sky, saved and read again; it is undone to the very scene, done again, and passes through the night."""
    with viewing(under_sky(tmp_path, LINE), (96, 64), bounces=2, exposure=-6.0) as driver, driver.wnd.ctx:
        driver.session.change(0, borrow=0)
        driver.settle()
        editor, before = driver.actions.editor, driver.session.scene
        assert editor.sky is not None
        night = SunSky(latitude=40.0, longitude=-3.7, minute=60)
        wanted = SunSky(latitude=40.0, longitude=-3.7, minute=10 * 60, day=80, turbidity=2.0, north=10.0)
        for sky in (night, wanted):
            editor.set_sky(sky)
            driver.frame(2)
        assert len(editor.history.past) == 2 and driver.session.scene.environment is not None
        lamps = [lamp for lamp in editor.lamps if lamp.of_sky]
        assert len(lamps) == 1 and len(driver.session.scene.environment.shown) == 1024, "fine at rest"
        driver.settle(3000)
        assert holes(driver.session.views[0]) == 0 and driver.session.progress[0].coverage == 1.0
        shown = driver.session.frame()
        said = write_scene(driver.session.scene, tmp_path / "saved.scene")
        assert said == "" and f"sky {wanted.line}" in (tmp_path / "saved.scene").read_text()
        editor.undo()
        assert driver.session.scene.environment is None and editor.redoes
        editor.undo()
        assert driver.session.scene.environment is before.environment and driver.session.scene.lights == before.lights
        editor.redo()
        editor.redo()
        assert editor.sky == wanted
        settings = driver.session.settings(0)[1]
    again = irrsplat.load(tmp_path / "saved.scene")
    kept = [light for light in again.lights if light.name == "sun"]
    assert kept == [lamps[0].light] and len(again.lights) == len(before.lights)
    with Renderer(again, (96, 64), **overrides("default", settings)) as renderer:
        fresh = renderer.render()
    seen = np.isfinite(fresh.depth)
    assert shown.direct[seen].mean() == pytest.approx(fresh.direct[seen].mean(), rel=1e-3)
    assert shown.irradiance[seen].mean() == pytest.approx(fresh.irradiance[seen].mean(), rel=0.05)


def editor(driver: Driver) -> Editor:
    return driver.actions.editor


def test_the_panel_adds_a_sky_and_moves_the_sun(driver: Driver) -> None:
    """A drag on the time is one step, and the sun goes to the west."""
    driver.session.options.frozen = driver.actions.panels.lights = True
    driver.resize((760, 640), density=0.25)
    driver.frame(3)
    driver.click(*driver.find("sun and sky", header=True).at())
    driver.choose("a clear sky by place and time")
    noon = editor(driver).sky
    assert noon == SunSky()
    driver.drag(driver.find("time").at(0.5), driver.find("time").at(0.7))
    later = editor(driver).sky
    assert later is not None and later.minute > noon.minute + 120 and later.sun[1] > noon.sun[1] + 30.0
    assert editor(driver).undoes == "the sun's place and time" and len(editor(driver).history.past) == 2
    driver.actions.undo()
    driver.actions.undo()
    assert editor(driver).sky is None and driver.session.scene.environment is None
    assert driver.session.scene.lights == editor(driver).loaded.lights
