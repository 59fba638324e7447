"""`irrsplat fill` gathers the records of a flight; frames from its frozen cache are independent of their order."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat.app import cli
from irrsplat.scene.camera_path import load_path
from tests.support.viewing import write_room

SIZE = (32, 32)
SETTINGS: Any = {"bounces": 1, "gather": "trace", "gather_size": 8, "shadow_size": 64}
FAST = ["--size", "32", "32", "--bounces", "1", "--gather", "trace", "--gather-size", "8", "--shadow-size", "64"]
FLIGHT = [*FAST, "--path", "a.path", "--cache", "film.cache"]
RENDER = ["render", "room.scene", *FLIGHT, "--cache-mode", "frozen"]


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a room, a flight of eight frames and the filled cache."""
    folder = tmp_path_factory.mktemp("film")
    write_room(folder)
    (folder / "a.path").write_text("frames 8\ncam -0.3 0 0.9 0 0 -1 0 1 0\ncam 0.2 0.1 0.7 0.4 0 -1 0 1 0\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert cli.main(["fill", "room.scene", *FLIGHT, "--stats", "fill.json"]) == 0
    return folder


@pytest.fixture
def place(filled: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(filled)
    return filled


def test_every_frame_is_covered(place: Path) -> None:
    """Each frame is covered completely, and a second run gathers no further record."""
    stats = json.loads((place / "fill.json").read_text())
    assert [one["frame"] for one in stats["frames"]] == list(range(8)) and stats["records"] > 0
    assert all(one["coverage"] == 1.0 for one in stats["frames"])
    before = (place / "film.cache").read_bytes()
    assert cli.main(["fill", "room.scene", *FLIGHT, "--stats", "again.json"]) == 0
    assert json.loads((place / "again.json").read_text())["records"] == stats["records"]
    (place / "film.cache").write_bytes(before)  # undoes the second run's marks of used records


def test_frozen_frames_are_independent_of_their_order(place: Path) -> None:
    """Frames equal those of other runs with fewer, earlier or later frames; all have the exposure of frame 0."""
    before = (place / "film.cache").read_bytes()
    assert cli.main([*RENDER, "-o", "f{frame}.npz", "-o", "f{frame}.png"]) == 0
    assert cli.main([*RENDER, "--frames", "5:7", "-o", "g{frame}.png", "--stats", "g.json"]) == 0
    assert (place / "film.cache").read_bytes() == before
    for number in (5, 6):
        assert (place / f"f{number}.png").read_bytes() == (place / f"g{number}.png").read_bytes()
    scene = irrsplat.load("room.scene")
    path = load_path("a.path", scene.camera().fov)
    with irrsplat.Renderer(scene, SIZE, **SETTINGS) as renderer:
        renderer.render(path.camera(3))
        renderer.load_cache("film.cache")
        for number in (7, 2):
            frame = renderer.render(path.camera(number), gather=False)
            with np.load(f"f{number}.npz") as file:
                assert all(np.array_equal(file[name], getattr(frame, name)) for name in file.files if name != "stats")
        assert frame.stats["uncovered"] == 0 and frame.stats["converged"]
        exposures = [renderer.render(path.camera(number), gather=False).exposure for number in (0, 6)]
    stats = json.loads((place / "g.json").read_text())["frames"]
    assert stats[1]["exposure"] == pytest.approx(exposures[0], abs=1e-3) and abs(exposures[0] - exposures[1]) > 1e-2


def test_ctrl_c_keeps_complete_frames(place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """The cache then contains a part of the records, and the message counts the complete frames."""
    converge: Callable[..., Any] = irrsplat.Renderer.converge
    frames = iter(range(8))

    def interrupted(*args: Any, **rest: Any) -> Any:
        if next(frames) == 3:
            raise KeyboardInterrupt
        return converge(*args, **rest)

    command = ["fill", "room.scene", *FLIGHT[:-1], "part.cache"]
    with monkeypatch.context() as patch:
        patch.setattr(irrsplat.Renderer, "converge", interrupted)
        assert cli.main(command) == 130
    assert "interrupted; 3 of 8 frames have their records" in capsys.readouterr().err
    with irrsplat.Renderer(irrsplat.load("room.scene"), SIZE, **SETTINGS) as renderer:
        renderer.load_cache("part.cache")
        assert 0 < renderer.cache.count < json.loads((place / "fill.json").read_text())["records"]
