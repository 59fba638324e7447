"""Line profiles in the viewer: drawing of the line, and illuminance of closed forms along it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from imgui_bundle import imgui

from tests.support.viewing import Driver, push

LIGHT = "position 0 2 0 1\nintensity 10 10 10\n"
FLOOR = "v -2 0 2\nv 2 0 2\nv 2 0 -2\nv -2 0 -2\nf 1 2 3 4\n"
SCENE = "cam 0 3 3  0 0 0  0 1 0\nproj 60 1 0.1 100\nlight lamp.light\nbrdf diffuse 0 0 0 1\nobj floor.obj\n"


def test_light_along_a_line_under_a_light(driver: Driver, tmp_path: Path) -> None:
    """A point light of 10 W/sr is 2 m above a black floor: the illuminance is 179·I·h/d³ lux."""
    for name, text in (("floor.scene", SCENE), ("floor.obj", FLOOR), ("lamp.light", LIGHT)):
        (tmp_path / name).write_text(text)
    driver.resize((640, 480), density=0.5)  # so that the plot leaves the floor free
    driver.frame()
    driver.actions.open(str(tmp_path / "floor.scene"))
    driver.actions.show("light")
    push(driver, "Ctrl+L")
    driver.frame(2)
    home = driver.session.camera
    driver.drag((200, 150), (440, 165))
    assert driver.session.camera == home and driver.session.options.line is not None, "a drag draws the line and does not orbit"
    start, end = (np.array(point) for point in driver.session.options.line)
    plot = imgui.internal.find_window_by_name("along a line")
    legend = imgui.internal.find_window_by_name("legend 0")
    assert plot.pos.y + plot.size.y <= legend.pos.y, "the plot covers no legend"
    found = driver.display.profile(0)
    assert found is not None and found.unit == "lux" and found.channels == ("",) and found.summary is not None
    assert found.metres[-1] == pytest.approx(np.linalg.norm(end - start)) and abs(start[1]) < 1e-4 > abs(end[1])
    points = start + (found.metres / found.metres[-1])[:, None] * (end - start)
    lux = 179.0 * 10.0 * 2.0 / np.linalg.norm(points - np.array([0.0, 2.0, 0.0]), axis=-1) ** 3
    assert found.values[:, 0] == pytest.approx(lux, rel=0.03), "equal within a pixel"
    assert [float(v[0]) for v in found.summary] == pytest.approx([lux.min(), lux.mean(), lux.max()], rel=0.013)
    # the line stays on the floor when the camera turns; points outside of the view have no value
    driver.session.free_camera.turn(-0.8, 0.0)
    driver.frame(2)
    turned = driver.display.profile(0)
    assert turned is not None and np.array_equal(turned.metres, found.metres)
    there = np.isfinite(turned.values[:, 0])
    assert 0.1 < there.mean() < 0.95 and turned.values[there, 0] == pytest.approx(lux[there], rel=0.03)
    driver.click(100.0, 60.0)
    assert driver.session.options.line is not None and "no surface" in driver.said


def test_maps_of_lights_cannot_be_measured_or_picked(driver: Driver) -> None:
    """A shadow map does not show the camera's view: a line or a click finds no surface in it."""
    driver.actions.show("shadow")
    push(driver, "Ctrl+L")
    driver.drag((60.0, 100.0), (160.0, 120.0))
    assert driver.session.options.line is None and "no surface" in driver.said
    push(driver, "Ctrl+L")
    driver.click(60.0, 100.0)
    assert driver.actions.editor.mesh is None
