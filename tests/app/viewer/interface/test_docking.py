"""Panels dock at the window's edges and go back to where they stand at first; what is over the picture keeps clear of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from irrsplat.app.viewer import preferences
from irrsplat.app.viewer.ui.layout import Box, Layout
from tests.support.viewing import FAST, Driver, viewing, write_room

SIZE = (1000, 640)


def layout(driver: Driver) -> Layout:
    return driver.viewer.interface.layout


def dock_settings(driver: Driver) -> None:
    """Drag the settings' title to the left edge of the window."""
    left, top, _, _ = layout(driver)._drawn["settings"]
    driver.move(left + 60.0, top + 10.0)
    driver.frame(2)
    driver.button(True)
    for x, y in ((200.0, 200.0), (420.0, 330.0), (24.0, 336.0), (25.0, 335.0)):
        driver.move(x, y)
        driver.frame(2)
    driver.button(False)
    driver.frame(4)


def test_a_panel_docks_stays_so_and_goes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The picture is the same, and takes the mouse beside the panel; the legend moves over; in the next run, and in a smaller
    window, the panel is still there; the menu puts it back."""
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path / "config"))
    room, kept = write_room(tmp_path), preferences.Preferences(values=dict(FAST))  # type: ignore[arg-type]
    with viewing(room, SIZE, kept) as driver:
        driver.session.options.frozen = True
        driver.frame(6)
        before = driver.canvas()
        assert layout(driver).area == (0.0, 30.0, *SIZE)
        dock_settings(driver)
        left = layout(driver).area[0]
        assert 250.0 < left < 400.0 and layout(driver).legend_right > left and layout(driver).panel_right == 0.0
        assert np.array_equal(driver.canvas(), before)
        driver.move(left + 100.0, 300.0)
        driver.frame(2)
        assert not driver.viewer.backend.wants_mouse
        driver.move(left - 100.0, 300.0)
        driver.frame(2)
        assert driver.viewer.backend.wants_mouse
        driver.actions.panels.hidden = True
        driver.frame(3)
        assert np.array_equal(driver.window(), driver.canvas())
        driver.actions.panels.hidden = False
        driver.frame(3)
        assert layout(driver).area[0] == left, "hidden panels stay docked"
        kept.ui["appearance"] = {"windows": driver.viewer.backend.windows}
    with viewing(room, (640, 400), kept) as driver:
        driver.session.options.frozen = True
        driver.frame(6)
        assert 200.0 < layout(driver).area[0] < 400.0
        driver.choose("Window", "standard places of panels")
        driver.frame(4)
        assert layout(driver).area == (0.0, 30.0, 640.0, 400.0) and layout(driver)._drawn["settings"][:2] == (8.0, 30.0)


def overlap(one: Box, other: Box) -> bool:
    """Whether two panels cover each other by more than their frames."""
    return all(max(one[i], other[i]) + 8.0 < min(one[i + 2], other[i + 2]) for i in (0, 1))


@pytest.mark.parametrize("lights", [False, True])
def test_an_object_is_shown_beside_the_other_panels(driver: Driver, lights: bool) -> None:
    """At 1000 x 640 its panel covers neither settings, lights nor numbers."""
    driver.session.options.frozen = True
    driver.resize(SIZE)
    panels = driver.actions.panels
    panels.settings = panels.hud = True
    driver.frame(4)
    layout(driver).restore()
    panels.lights = lights
    driver.frame(4)
    driver.actions.editor.pick_mesh(2)
    driver.frame(4)
    width, height = layout(driver).statistics_size
    boxes = [*layout(driver)._drawn.values(), (SIZE[0] - width - 8.0, 30.0, float(SIZE[0]), 30.0 + height)]
    assert len(boxes) == 3 + lights
    assert not [(a, b) for i, a in enumerate(boxes) for b in boxes[:i] if overlap(a, b)]
