"""`irrsplat render --path`: frames, files and exposure."""

from __future__ import annotations

import json
from pathlib import Path as File
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat.app import cli
from irrsplat.image.frame import Frame, numbered
from irrsplat.scene.camera_path import load_path

SMALL = ["--size", "2", "2"]
FLIGHT = ["render", "plain.scene", *SMALL, "--path", "a.path"]


@pytest.fixture
def flight(place: File) -> File:
    """The working folder, with a path of four frames in it."""
    (place / "a.path").write_text("frames 4\ncam 0 0 5  0 0 0  0 1 0\ncam 3 0 5  0 0 0  0 1 0\n")
    return place


@pytest.fixture
def asked(fake: Any, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The cameras that the stand-in for the renderer was asked for; the n-th of its frames has exposure n + 1."""
    cameras: list[Any] = []
    render = fake.render

    def watched(self: Any, camera: Any, **options: Any) -> Frame:
        cameras.append(camera)
        frame = render(self, camera, **options)
        frame.stats["exposure"] = float(len(cameras))
        return frame

    monkeypatch.setattr(fake, "render", watched)
    return cameras


def names(folder: File) -> set[str]:
    return {path.name for path in folder.iterdir()} - {"plain.scene", "triangle.obj", "a.path"}


# ---- which frames, and where to ------------------------------------------------------------------------------------------


def test_the_frames_are_those_of_a_python_slice(asked: list[Any], flight: File, capsys: pytest.CaptureFixture[str]) -> None:
    """One frame alone needs no number in its name."""
    path = load_path("a.path", fov=70.0)
    for flags, numbers in (([], [0, 1, 2, 3]), (["--frames", "1:3"], [1, 2]), (["--frames", "2:"], [2, 3])):
        asked.clear()
        assert cli.main([*FLIGHT, "-o", "f{frame:03d}.png", "--stats", "s.json", "--fov", "70", *flags]) == 0
        assert capsys.readouterr() == ("", "")
        assert asked == [path.camera(number) for number in numbers]
        assert [stats["frame"] for stats in json.loads((flight / "s.json").read_text())["frames"]] == numbers
    assert names(flight) == {"s.json", *(f"f{number:03d}.png" for number in range(4))}
    assert cli.main([*FLIGHT, "-o", "still.png", "--frames", "3:4"]) == 0
    assert asked[-1].eye == (3, 0, 5) and (flight / "still.png").is_file()
    assert all(len({numbered(f, n) for n in range(3000)}) == 3000 for f in ("{frame}", "{frame:04d}", "{frame:02x}"))


def test_a_path_is_looked_for_beside_the_scene_too(asked: list[Any], place: File) -> None:
    """A bundled scene's own path goes by its name, from any folder; a file of that name here comes first."""
    command = ["render", "cornell", *SMALL, "--path", "flight.path", "--frames", ":1", "-o", "a.png"]
    assert cli.main(command) == 0
    assert asked[-1] == irrsplat.load("cornell").camera()
    (place / "flight.path").write_text("cam 1 1 1 0 0 0 0 1 0\n")
    assert cli.main(command) == 0
    assert asked[-1].eye == (1, 1, 1)


def test_the_first_frame_meters_for_all(asked: list[Any], flight: File) -> None:
    """The stand-in's frames have exposures 1 2 3 4, which would flicker: each is saved with the first one's."""
    assert cli.main([*FLIGHT, "-o", "f{frame}.npz", "--stats", "s.json"]) == 0
    assert [stats["exposure"] for stats in json.loads((flight / "s.json").read_text())["frames"]] == [1.0] * 4
    for number in range(4):
        with np.load(flight / f"f{number}.npz") as file:
            stats = json.loads(str(file["stats"]))
        assert (stats["frame"], stats["exposure"]) == (number, 1.0)


@pytest.mark.parametrize("inside", [True, False])
def test_an_interrupted_frame_is_dropped_and_those_before_it_stay(
    inside: bool, fake: Any, flight: File, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C in the rounds of frame 2 (Renderer.render returns what it has) or outside of them (it is raised)."""
    render, calls = fake.render, []

    def interrupted(self: Any, camera: Any, **options: Any) -> Frame:
        calls.append(camera)
        if len(calls) == 3:
            if not inside:
                raise KeyboardInterrupt
            fake.stats = {"interrupted": True, "converged": False}
        return render(self, camera, **options)

    monkeypatch.setattr(fake, "render", interrupted)
    assert cli.main([*FLIGHT, "-o", "f{frame}.png", "--stats", "s.json"]) == 130
    assert capsys.readouterr() == ("", "irrsplat: interrupted; 2 of 4 frames were written\n")
    assert names(flight) == {"f0.png", "f1.png", "s.json"}
    assert len(json.loads((flight / "s.json").read_text())["frames"]) == 2
