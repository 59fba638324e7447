"""What the viewer measures beside its picture: a horizontal plane."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from irrsplat.meter.light_meter import LightMeter
from irrsplat.meter.plane import horizontal
from tests.support.viewing import Driver, fresh, push, viewing, write_room


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Driver]:
    with viewing(write_room(tmp_path_factory.mktemp("room"))) as driver:
        yield driver


@pytest.fixture
def driver(one: Driver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Driver]:
    yield from fresh(one, tmp_path, monkeypatch)


def test_the_plane_has_the_values_of_a_light_meter(driver: Driver) -> None:
    """Its own process finds what LightMeter finds here; it is drawn between its edges at the back wall and in front."""
    session = driver.session
    push(driver, "Ctrl+M")
    while session.plane.share is not None:
        driver.frame()
    driver.frame(2)
    measured, plane = session.plane.measured, horizontal(session.scene, 0.75)
    assert measured is not None and measured.plane == plane
    grid = plane.grid(plane.usual_spacing())
    with LightMeter(session.scene, ctx=session.ctx) as meter:
        expected = meter.measure(grid.points, grid.normals)
    assert measured.readings.total == pytest.approx(expected.total) and not measured.readings.counts.all(), "the box is cut"
    shown = driver.canvas()
    push(driver, "Ctrl+M")
    driver.frame(2)
    rows = np.flatnonzero((driver.canvas() != shown).any((1, 2)))
    away = session.camera.eye[2] - np.array([-1.0, 1.0])  # of the edges at the back and in front; they are 0.25 m below the eye
    assert rows[[0, -1]] == pytest.approx(len(shown) * (0.5 + 0.25 / (away * session.camera.screen)), abs=1.5)
