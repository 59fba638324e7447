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
    """Add a path of four frames to the working folder; return the folder."""
    (place / "a.path").write_text("frames 4\ncam 0 0 5  0 0 0  0 1 0\ncam 3 0 5  0 0 0  0 1 0\n")
    return place


@pytest.fixture
def cameras(fake: Any, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return the list of rendered cameras, filled by the renderer's stand-in; frame n has exposure n + 1."""
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


# ---- frames and their files ----------------------------------------------------------------------------------------------


def test_frames_are_selected_by_a_python_slice(cameras: list[Any], flight: File, capsys: pytest.CaptureFixture[str]) -> None:
    """`--frames` selects frames as a Python slice does. The file of a single frame needs no number in its name."""
    path = load_path("a.path", fov=70.0)
    for flags, numbers in (([], [0, 1, 2, 3]), (["--frames", "1:3"], [1, 2]), (["--frames", "2:"], [2, 3])):
        cameras.clear()
        assert cli.main([*FLIGHT, "-o", "f{frame:03d}.png", "--stats", "s.json", "--fov", "70", *flags]) == 0
        assert capsys.readouterr() == ("", "")
        assert cameras == [path.camera(number) for number in numbers]
        assert [stats["frame"] for stats in json.loads((flight / "s.json").read_text())["frames"]] == numbers
    assert names(flight) == {"s.json", *(f"f{number:03d}.png" for number in range(4))}
    assert cli.main([*FLIGHT, "-o", "still.png", "--frames", "3:4"]) == 0
    assert cameras[-1].eye == (3, 0, 5) and (flight / "still.png").is_file()
    assert all(len({numbered(f, n) for n in range(3000)}) == 3000 for f in ("{frame}", "{frame:04d}", "{frame:02x}"))


def test_a_path_is_also_found_next_to_the_scene(cameras: list[Any], place: File) -> None:
    """The path of a bundled scene is found by its name from any folder; a file in the working folder has precedence."""
    command = ["render", "cornell", *SMALL, "--path", "flight.path", "--frames", ":1", "-o", "a.png"]
    assert cli.main(command) == 0
    assert cameras[-1] == irrsplat.load("cornell").camera()
    (place / "flight.path").write_text("cam 1 1 1 0 0 0 0 1 0\n")
    assert cli.main(command) == 0
    assert cameras[-1].eye == (1, 1, 1)


def test_all_frames_have_the_exposure_of_the_first(cameras: list[Any], flight: File) -> None:
    """The frames have different exposures, 1 to 4; all are saved with the exposure of the first, without flicker."""
    assert cli.main([*FLIGHT, "-o", "f{frame}.npz", "--stats", "s.json"]) == 0
    assert [stats["exposure"] for stats in json.loads((flight / "s.json").read_text())["frames"]] == [1.0] * 4
    for number in range(4):
        with np.load(flight / f"f{number}.npz") as file:
            stats = json.loads(str(file["stats"]))
        assert (stats["frame"], stats["exposure"]) == (number, 1.0)


@pytest.mark.parametrize("inside", [True, False])
def test_an_interrupted_frame_is_dropped_and_earlier_frames_are_kept(
    inside: bool, fake: Any, flight: File, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C within a round of frame 2 makes Renderer.render return early; outside of rounds Ctrl-C raises."""
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
