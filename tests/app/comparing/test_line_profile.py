"""The line that is measured along in the viewer: how it is drawn, and that the plot has the light of closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from imgui_bundle import imgui, implot

from irrsplat.app.viewer.input.measuring_line import Point
from irrsplat.meter.light_scale import LightScale
from tests.support.viewing import LEFT, Driver, push

LAMP = "position 0 2 0 1\nintensity 10 10 10\n"
FLOOR = "v -2 0 2\nv 2 0 2\nv 2 0 -2\nv -2 0 -2\nf 1 2 3 4\n"
SCENE = "cam 0 3 3  0 0 0  0 1 0\nproj 60 1 0.1 100\nlight lamp.light\nbrdf diffuse 0 0 0 1\nobj floor.obj\n"


@pytest.fixture
def floor(driver: Driver, tmp_path: Path) -> Driver:
    """The viewer on a black floor with a lamp of 10 W/sr 2 m above its middle, the light of it on show, lines measured along."""
    for name, text in (("floor.scene", SCENE), ("floor.obj", FLOOR), ("lamp.light", LAMP)):
        (tmp_path / name).write_text(text)
    driver.resize((640, 480))  # so that the plot, at the bottom, leaves the floor free
    driver.frame()
    driver.actions.open(str(tmp_path / "floor.scene"))
    driver.actions.show("light")
    push(driver, "Ctrl+L")
    driver.settle()
    return driver


def expected(points: np.ndarray) -> np.ndarray:
    """Lux on the floor: 179·I·h/d³."""
    found: np.ndarray = 179.0 * 10.0 * 2.0 / np.linalg.norm(points - np.array([0.0, 2.0, 0.0]), axis=-1) ** 3
    return found


def drag(driver: Driver, start: tuple[float, float], end: tuple[float, float]) -> None:
    driver.move(*start)
    driver.frame()
    driver.button(True, LEFT)
    driver.move(*end, end[0] - start[0], end[1] - start[1])
    driver.button(False, LEFT)
    driver.frame(2)


def ends(driver: Driver) -> tuple[Point, Point]:
    found = driver.session.line.ends
    assert found is not None
    return found


def test_light_along_a_line_under_a_lamp(floor: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is dragged from one point of the floor to another: metres are those between them, and the light is I·h/d³ at each."""
    home = floor.session.camera
    drag(floor, (160, 170), (460, 200))
    assert floor.session.camera == home, "a drag is no orbit now"
    start, end = (np.array(point) for point in ends(floor))
    found = floor.display.profile(0)
    assert found is not None and found.unit == "lux" and found.channels == ("",)
    assert found.metres[-1] == pytest.approx(np.linalg.norm(end - start)) and abs(start[1]) < 1e-4 > abs(end[1])
    points = start + (found.metres / found.metres[-1])[:, None] * (end - start)
    assert found.values[:, 0] == pytest.approx(expected(points), rel=0.03), "as far as a pixel reaches"
    truth = expected(points)
    assert found.summary is not None
    assert [float(v[0]) for v in found.summary] == pytest.approx([truth.min(), truth.mean(), truth.max()], rel=0.01)
    assert len(found.csv.splitlines()) == 1 + len(found.metres) and found.csv.startswith("along,value\n0,")

    floor.session.options.light_scale = LightScale("W/m2")
    floor.frame()
    watts = floor.display.profile(0)
    assert watts is not None and watts.unit == "W/m²" and np.allclose(179.0 * watts.values, found.values, rtol=1e-4)

    plotted: list[np.ndarray] = []
    said: list[str] = []
    monkeypatch.setattr(implot, "plot_line", lambda name, xs, ys, spec: plotted.append(ys))
    monkeypatch.setattr(imgui, "text", said.append)
    floor.frame()
    assert np.array_equal(plotted[0], watts.values[:, 0])
    assert f"max {watts.values.max():.4g} W/m²" in said and f"over {found.metres[-1]:.4g} m" in said

    # it stays on the floor when one flies, and what lies outside of the view has no value
    monkeypatch.undo()
    floor.session.free_camera.go(floor.session.scene.camera())
    floor.session.free_camera.look(-200.0, 0.0, 0.004)
    floor.settle()
    turned = floor.display.profile(0)
    assert turned is not None and np.array_equal(turned.metres, found.metres)
    there = np.isfinite(turned.values[:, 0])
    assert 0.1 < there.mean() < 0.95 and 179.0 * turned.values[there, 0] == pytest.approx(truth[there], rel=0.03)


def test_two_clicks_make_a_line_and_any_buffer_has_one(floor: Driver) -> None:
    """Where there is no surface nothing begins. Positions along it are those of its points; the plot shows three channels."""
    floor.click(330.0, 60.0)
    assert floor.session.line.start is None and "no surface" in floor.said
    floor.click(180.0, 190.0)
    assert floor.session.line.ends is None and floor.session.line.open
    floor.click(440.0, 170.0)
    start, end = ends(floor)
    assert not floor.session.line.open and start != end
    floor.actions.show("position")
    floor.frame(2)
    found = floor.display.profile(0)
    assert found is not None and found.channels == ("x", "y", "z") and found.unit == "m"
    line = np.array(start) + (found.metres / found.metres[-1])[:, None] * np.subtract(end, start)
    assert np.abs(found.values - line).max() < 0.02, "a pixel"
    floor.click(200.0, 180.0)
    assert floor.session.line.open, "a third click begins anew"
    floor.actions.open(floor.actions.source)
    floor.frame()
    assert floor.session.line.start is None
