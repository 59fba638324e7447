"""`irrsplat render --path`: which frames, to which files, with which records and exposure; and what is refused."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path as File
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat.app import cli
from irrsplat.image.frame import Frame, check_writable, numbered
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


@pytest.mark.parametrize(
    ("flags", "numbers"),
    [
        ([], [0, 1, 2, 3]),
        (["--frames", ":"], [0, 1, 2, 3]),
        (["--frames", "1:3"], [1, 2]),
        (["--frames", "2:"], [2, 3]),
        (["--frames", ":1"], [0]),
        (["--frames", "0:4"], [0, 1, 2, 3]),
    ],
)
def test_the_frames_are_those_of_a_python_slice(
    flags: list[str], numbers: list[int], asked: list[Any], flight: File, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([*FLIGHT, "-o", "f{frame:03d}.png", "--stats", "s.json", *flags]) == 0
    assert capsys.readouterr() == ("", "")
    path = load_path("a.path", fov=40.0)  # the scene's own field of view
    assert asked == [path.camera(number) for number in numbers]
    assert names(flight) == {"s.json", *(f"f{number:03d}.png" for number in numbers)}
    assert [stats["frame"] for stats in json.loads((flight / "s.json").read_text())["frames"]] == numbers


def test_outputs_of_every_kind(fake: Any, flight: File) -> None:
    outputs = ["-o", "f{frame}.npz", "-o", "d{frame:02x}/", "-o", "{{{frame}}}.png", "--buffers", "depth"]
    assert cli.main([*FLIGHT, *outputs, "--frames", "1:3"]) == 0
    assert names(flight) == {"f1.npz", "f2.npz", "d01", "d02", "{1}.png", "{2}.png"}
    assert fake.asked.figures is True
    assert (flight / "d01/depth.png").is_file()


def test_one_frame_needs_no_number(asked: list[Any], flight: File) -> None:
    assert cli.main([*FLIGHT, "-o", "still.png", "--frames", "3:4"]) == 0
    assert names(flight) == {"still.png"}
    assert asked[0].eye == (3, 0, 5)


def test_fov_is_that_of_the_keys(asked: list[Any], flight: File) -> None:
    assert cli.main([*FLIGHT, "-o", "f{frame}.png", "--fov", "70"]) == 0
    assert [camera.fov for camera in asked] == pytest.approx([70.0] * 4, rel=1e-12)


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


def test_unfinished_frames_are_counted(fake: Any, flight: File, capsys: pytest.CaptureFixture[str]) -> None:
    fake.stats = {"converged": False}
    assert cli.main([*FLIGHT, "-o", "f{frame}.png"]) == 0
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert err.startswith("notice: 4 of 4 frames stopped before every pixel was served")


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


def test_progress_names_the_frame(fake: Any, flight: File, monkeypatch: pytest.MonkeyPatch) -> None:
    from rich.progress import Progress

    said = []
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(Progress, "update", lambda self, task, **what: said.append(what["description"]))
    assert cli.main([*FLIGHT, "-o", "f{frame}.png", "--frames", "2:"]) == 0
    assert said == ["frame 2 of 3, round 1: 3 records, coverage", "frame 3 of 3, round 1: 3 records, coverage"]


# ---- what is refused -----------------------------------------------------------------------------------------------------

MANY = ["-o", "f{frame}.png"]
FIELDS = (
    *("{}", "{0}", "{n}", "{frame", "frame}", "{frame}{n}", "{frame.real}", "{frame[0]}", "{frame!r}", "{frame:{frame}}"),
    *("{frame:s}", "{frame:c}", "{frame:.2f}", "{frame:%}", "{frame:e}", "{frame:0<4}", "{frame:/>4}", "{frame:999d}"),
)


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        ([*FLIGHT, *MANY, "--frames", "3"], "expected A:B"),
        ([*FLIGHT, *MANY, "--frames", "1:2:3"], "expected A:B"),
        ([*FLIGHT, *MANY, "--frames", "-2:"], "expected A:B"),
        ([*FLIGHT, *MANY, "--frames", "a:b"], "expected A:B"),
        ([*FLIGHT, *MANY, "--frames", "2:2"], "holds no frame"),
        ([*FLIGHT, *MANY, "--frames", "3:1"], "holds no frame"),
        ([*FLIGHT, *MANY, "--frames", ":0"], "holds no frame"),
        ([*FLIGHT, *MANY, "--frames", "0:5"], "has 4 frames; give A:B within 0:4"),
        ([*FLIGHT, *MANY, "--frames", "4:"], "--frames 4:: the path 'a.path' has 4 frames"),
        ([*FLIGHT, *MANY, "--eye", "0", "0", "5", "--target", "0", "0", "0"], "leave --path or --eye out"),
        ([*FLIGHT, *MANY, "--camera", "top"], "leave --path or --camera out"),
        ([*FLIGHT, *MANY, "--up", "0", "1", "0"], "--up"),
        ([*FLIGHT, *MANY, "--fov", "0"], "--fov"),
        ([*FLIGHT[:-1], "none.path", *MANY], "--path 'none.path': there is no such file"),
        ([*FLIGHT[:-1], "", *MANY], "--path ''"),
        ([*FLIGHT[:-1], ".", *MANY], "directory"),
        ([*FLIGHT[:-1], "plain.scene", *MANY], "plain.scene:2: unknown word 'proj'"),
        ([*FLIGHT, "-o", "f.png"], "f.png: 4 frames would go to one name; put {frame} into it"),
        ([*FLIGHT, *MANY, "-o", "f.exr"], "f.exr: 4 frames would go to one name"),
        ([*FLIGHT, "-o", "f{{frame}}.png", "--frames", ":1"], "{frame}"),
        ([*FLIGHT, "-o", "f{frame}.avi"], "unknown ending '.avi'"),
        ([*FLIGHT, "-o", "none/f{frame}.png"], "does not exist"),
        ([*FLIGHT, "-o", "none{frame}/f.png"], "does not exist"),
        *(([*FLIGHT, "-o", f"f{field}.png"], "the one field in an output's name is {frame}") for field in FIELDS),
        (["render", "plain.scene", "-o", "f{frame}.png"], "give --path"),
        (["render", "plain.scene", "-o", "f{frame:04d}/"], "give --path"),
        (["render", "plain.scene", "-o", "f.png", "--frames", "0:2"], "give --path"),
    ],
)
def test_a_wrong_command_line_is_one_line_and_exit_status_2(
    argv: list[str], words: str, fake: Any, flight: File, refused: Callable[..., str]
) -> None:
    assert words in refused(argv)


def test_fields_are_checked_before_the_scene_is_loaded(
    flight: File, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
) -> None:
    monkeypatch.setattr(irrsplat, "load", lambda _: pytest.fail("the scene was loaded first"))
    refused([*FLIGHT, "-o", "f{n}.png"])
    refused([*FLIGHT, "-o", "none/f{frame}.png"])


@pytest.mark.parametrize(
    "field", ["{frame}", "{frame:d}", "{frame:04d}", "{frame:4}", "{frame:02x}", "{frame:b}", "a{frame}b{frame}"]
)
def test_no_two_frames_have_one_name(field: str) -> None:
    assert len({numbered(field, frame) for frame in range(3000)}) == 3000


def test_python_is_told_where_frame_belongs(place: File) -> None:
    with pytest.raises(irrsplat.InputError, match="give --path"):
        check_writable("f{frame}.png")


# ---- with the real renderer ----------------------------------------------------------------------------------------------


def test_frames_are_those_of_single_renders(flight: File) -> None:
    """Without bounces no record enters, so a frame of a path is the render of its camera alone, bit by bit."""
    size = ["--size", "20", "16", "--bounces", "0"]
    assert cli.main([*FLIGHT, *size, "-o", "f{frame}.npz"]) == 0
    path, scene = load_path("a.path", fov=40.0), irrsplat.load("plain.scene")
    depths = []
    for number in range(4):
        alone = irrsplat.render(scene, (20, 16), path.camera(number), bounces=0)
        with np.load(f"f{number}.npz") as file:
            for name in ("image", "direct", "position", "normal", "depth"):
                np.testing.assert_array_equal(file[name], getattr(alone, name))
            depths.append(file["depth"])
    assert not any(np.array_equal(a, b) for a, b in pairwise(depths))  # and the camera did move


def test_records_stay_from_frame_to_frame(place: File) -> None:
    """The second of 90 frames moves by a few percent of the way to the box: it asks for few records beyond the first one's."""
    flags = ["--size", "48", "48", "--preset", "preview", "--path", "flight.path", "--frames", "0:3"]
    assert cli.main(["render", "cornell", *flags, "-o", "f{frame}.png", "--stats", "s.json"]) == 0
    frames = json.loads((place / "s.json").read_text())["frames"]
    records = [stats["records"] for stats in frames]
    assert records[0] > 50
    assert 0 <= records[1] - records[0] < 0.2 * records[0]
    assert 0 <= records[2] - records[1] < 0.2 * records[0]
    assert all(stats["converged"] for stats in frames)
    assert len({stats["exposure"] for stats in frames}) == 1
