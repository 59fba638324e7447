"""A scene far from the origin in the viewer: shown, recorded and saved coordinates are in world space."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.show.display import line_profile
from irrsplat.scene.camera_path import load_path
from tests.support.viewing import Driver, push, write_room

PLACE = (2e6, -1e6, 5e5)


def move(path: Path) -> None:
    """Move the cameras and the light of a room file to PLACE, and all objects by a matrix."""
    lines = []
    for line in path.read_text().splitlines():
        words = line.split()
        if words and words[0] == "cam":
            first = len(words) - 9  # a camera may have a name first
            words[first : first + 6] = [repr(float(v) + PLACE[i % 3]) for i, v in enumerate(words[first : first + 6])]
        lines.append(" ".join(words))
        if words and words[0] == "proj":
            lines.append("trans {} {} {}".format(*PLACE))
    path.write_text("\n".join(lines) + "\n")
    point_light = path.with_name("lamp.light")
    word, *place, last = point_light.read_text().splitlines()[0].split()
    moved = [repr(float(v) + by) for v, by in zip(place, PLACE, strict=True)]
    point_light.write_text(" ".join([word, *moved, last]) + "\n" + point_light.read_text().split("\n", 1)[1])


def test_coordinates_are_in_world_space(driver: Driver, tmp_path: Path) -> None:
    """The viewer renders relative to a local origin; positions, profiles, flights and saved scenes add it again."""
    (tmp_path / "far").mkdir()
    move(write_room(tmp_path / "far"))
    session, actions = driver.session, driver.actions
    driver.resize((160, 120))
    actions.open(str(tmp_path / "far" / "room.scene"))
    driver.settle()
    assert session.origin != (0.0, 0.0, 0.0) and np.abs(session.camera.eye).max() < 10.0
    scene = irrsplat.load(driver.actions.source)
    assert session.camera.shifted(session.origin).eye == pytest.approx(scene.cameras[0].eye, abs=1e-6)
    assert session.progress[0].coverage == 1.0 and driver.canvas().any()

    source, legend = session.source(0), BUFFERS["position"].legend(session.source(0))
    low, high = (np.array([float(v) for v in end.split()]) for end in (legend.low, legend.high))
    assert np.abs(np.stack([low, high]) - scene.bounds).max() < 0.01
    profile = line_profile("position", source, (-0.5, -0.999, 0.2), (0.5, -0.999, 0.2))
    assert np.nanmax(np.abs(profile.values[:, 1] - (PLACE[1] - 1.0))) < 0.05, "the floor's height"

    push(driver, "R")
    driver.frame(3, dt=0.3)
    push(driver, "R")
    (flight,) = tmp_path.glob("*.path")
    assert load_path(flight).keys[0].eye == pytest.approx(session.camera.shifted(session.origin).eye, abs=1e-6)
    actions.save("again")
    again = irrsplat.load("again.scene")
    assert np.abs(again.bounds - scene.bounds).max() < 1e-6
    assert again.lights[0].position == pytest.approx(scene.lights[0].position, abs=1e-6)
