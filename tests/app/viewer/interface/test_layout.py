"""Layout of the interface: its remembered state, small and large windows, and the settings that it offers."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np
import pytest

from irrsplat.app.viewer import preferences
from irrsplat.app.viewer.input.idle_settings import BASIC, why_idle
from irrsplat.app.viewer.session import overrides
from irrsplat.app.viewer.ui.layout import Box, Layout
from irrsplat.settings import SETTINGS, SettingValues, preset
from tests.support.viewing import Driver, viewing, write_room

SIZE = (1000, 640)


def layout(driver: Driver) -> Layout:
    return driver.viewer.interface.layout


def overlap(one: Box, other: Box) -> bool:
    """Return True if two panels cover each other by more than their frames."""
    return all(max(one[i], other[i]) + 8.0 < min(one[i + 2], other[i + 2]) for i in (0, 1))


def test_a_panel_docks_stays_so_in_the_next_run_and_goes_back(driver: Driver, tmp_path: Path) -> None:
    """The picture stays the same, and the legend moves. In the next run the panel is docked still; the menu puts it back."""
    driver.session.options.frozen = driver.actions.panels.settings = True
    driver.resize(SIZE, density=0.25)
    driver.frame(6)
    before = driver.canvas()
    assert layout(driver).area == (0.0, 30.0, *SIZE)
    left, top, _, _ = layout(driver)._drawn["settings"]
    driver.move(left + 60.0, top + 10.0)
    driver.frame(2)
    driver.button(True)
    for x, y in ((200.0, 200.0), (420.0, 330.0), (24.0, 336.0), (25.0, 335.0)):
        driver.move(x, y)
        driver.frame(2)
    driver.button(False)
    driver.frame(4)
    left = layout(driver).area[0]
    assert 250.0 < left < 400.0 and layout(driver).legend_right > left and layout(driver).panel_right == 0.0
    assert np.array_equal(driver.canvas(), before)
    driver.move(left + 100.0, 300.0)
    driver.frame(2)
    assert not driver.viewer.backend.wants_mouse
    dark = driver.window()[2:5, 150:].mean()
    driver.actions.appearance.light = True
    driver.actions.appearance.windows = driver.viewer.backend.windows
    assert driver.actions.save_preferences(None, False) is None
    remembered, notices = preferences.load()
    assert notices == []
    with viewing(write_room(tmp_path), (640, 400), remembered) as again:
        again.session.options.frozen = True
        again.frame(6)
        assert 200.0 < layout(again).area[0] < 400.0 and again.window()[8:20, 400:].mean() > 180 > 100 > dark
        again.choose("Window", "Standard layout")
        again.frame(4)
        assert layout(again).area == (0.0, 30.0, 640.0, 400.0) and layout(again)._drawn["settings"][:2] == (8.0, 30.0)


def test_panels_stand_beside_each_other(driver: Driver) -> None:
    """At 1000 x 640 an object's panel covers neither settings, lights nor numbers."""
    panels = driver.actions.panels
    driver.session.options.frozen = panels.settings = panels.hud = True
    driver.resize(SIZE, density=0.25)
    layout(driver).restore()
    driver.frame(6)
    panels.lights = True
    driver.frame(8)
    driver.actions.editor.pick_mesh(2)
    driver.frame(4)
    width, height = layout(driver).statistics_size
    boxes = [*layout(driver)._drawn.values(), (SIZE[0] - width - 8.0, 30.0, float(SIZE[0]), 30.0 + height)]
    assert len(boxes) == 4 and not [(a, b) for i, a in enumerate(boxes) for b in boxes[:i] if overlap(a, b)]


def test_what_changes_nothing_says_why(driver: Driver) -> None:
    """A change of a setting that is idle without bounces leaves the picture bit for bit."""
    driver.session.change(0, bounces=0)
    driver.settle()
    before, changes = driver.canvas(), {"a": 1.5, "gather_size": 12, "radius_min": 5.0}
    assert {why_idle(name, driver.session.settings(0)[1]) for name in changes} == {"bounces is 0: there is no indirect light"}
    driver.session.change(0, **cast(SettingValues, changes))
    driver.settle()
    assert np.array_equal(driver.canvas(), before)


def test_the_settings_panel(driver: Driver) -> None:
    """Basic settings come first, and what differs from the preset; the help is on the whole row; a click types a number, and a
    double click takes it back."""
    driver.session.options.frozen = driver.actions.panels.settings = True
    driver.resize((640, 700), density=0.25)
    driver.frame(6)
    layout(driver).restore()
    driver.frame(6)
    changed = set(overrides(*driver.session.settings(0)))
    wanted = {name.replace("_", " ") for name in {*BASIC, *changed}}
    labels = {w.label for w in driver.widgets}
    assert {name.replace("_", " ") for name in SETTINGS} & labels == wanted
    slider = driver.find("blend")
    for x in (slider.box[0] - 30.0, slider.at()[0], slider.box[2] + 20.0):
        driver.move(620.0, 690.0)
        driver.frame(3)
        before = driver.window()
        driver.move(x, slider.at()[1])
        driver.frame(6, dt=0.5)
        assert (driver.window()[:, 90:] != before[:, 90:]).any(-1).sum() > 125, x
    driver.click(slider.box[0] - 30.0, slider.at()[1])
    driver.press("A", ctrl=True)
    driver.type("0.8")
    driver.press("ENTER")
    driver.frame(2)
    assert driver.session.settings(0)[1].blend == pytest.approx(0.8)
    driver.move(*slider.at(0.2))
    driver.frame(2)
    for down in (True, False, True, False):
        driver.button(down)
        driver.frame(dt=0.02)
    driver.frame(2)
    assert driver.session.settings(0)[1].blend == preset("default").blend
    driver.choose("expert settings too")
    driver.frame(2)
    assert driver.actions.panels.expert and "adapt" in {w.label for w in driver.widgets}


@pytest.mark.parametrize(("size", "scale"), [((640, 400), 1.0), ((640, 400), 2.0), ((1280, 720), 1.5)])
def test_the_picture_is_fitted_beside_the_panel(driver: Driver, size: tuple[int, int], scale: float) -> None:
    """The window shows the whole picture, pixel for pixel, right of the panel and below the menus; without the panel it fills the
    window. A click picks the mesh at that pixel. The first settings are within the panel."""
    driver.session.options.frozen = driver.actions.panels.controls = True
    driver.actions.enlarge(scale)
    driver.resize(size)
    driver.frame(8)
    left, top, width, height = driver.viewer._place
    assert driver.session.size == (width, height) and left >= 0.3 * size[0] and top > 0 and left + width <= size[0]
    x, y = driver.session.size[0] // 2, driver.session.size[1] // 4
    assert np.array_equal(driver.window()[top : top + height // 2, left + 8 : left + width], driver.canvas()[: height // 2, 8:])
    expected = driver.display.mesh_at((x, y))
    driver.click(left + x, top + y)
    assert expected is not None and driver.actions.editor.mesh == expected
    driver.actions.editor.pick_mesh(None)
    named = [w for w in driver.widgets if w.label.lstrip("#") in ("a", "blend", "buffer")]
    assert len(named) == 3 and all(w.box[2] < left for w in named)
    driver.actions.panels.controls = False
    driver.frame(3)
    assert driver.session.size == size and np.array_equal(driver.canvas().shape[:2], size[::-1])
