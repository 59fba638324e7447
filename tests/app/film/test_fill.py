"""`irrsplat fill`, and frames from the frozen cache that it leaves: whichever are rendered, in whatever order, by whom."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat.app import cli
from irrsplat.app.bench.film_flicker import film_flicker
from irrsplat.scene.camera_path import load_path
from tests.support.viewing import write_room

SETTINGS: Any = {"bounces": 1, "gather": "trace", "gather_size": 8, "shadow_size": 64}
FAST = ["--size", "48", "48", "--bounces", "1", "--gather", "trace", "--gather-size", "8", "--shadow-size", "64"]
FLIGHT = [*FAST, "--path", "a.path", "--cache", "film.cache"]
RENDER = ["render", "room.scene", *FLIGHT, "--cache-mode", "frozen"]


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a room, a flight of eight frames and the cache that it fills."""
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


def test_every_frame_has_its_records(place: Path) -> None:
    """Also those that later frames could have taken some from; and nothing is gathered a second time."""
    told = json.loads((place / "fill.json").read_text())
    assert [one["frame"] for one in told["frames"]] == list(range(8)) and told["records"] > 0
    assert all(one["coverage"] == 1.0 for one in told["frames"])
    before = (place / "film.cache").read_bytes()
    scene = irrsplat.load("room.scene")
    path = load_path("a.path", scene.camera().fov)
    with irrsplat.Renderer(scene, (48, 48), **SETTINGS) as renderer:
        renderer.load_cache("film.cache")
        assert [renderer.coverage(camera) for camera in path] == [1.0] * 8
    assert cli.main(["fill", "room.scene", *FLIGHT, "--stats", "again.json"]) == 0
    assert json.loads((place / "again.json").read_text())["records"] == told["records"]
    (place / "film.cache").write_bytes(before)  # but for which views have seen which records


def test_frozen_frames_are_the_same_in_whatever_order(place: Path) -> None:
    """By the command line, all and some; and by a renderer that goes backwards, after it has gathered elsewhere and by another
    cache. The exposure is frame 0's, rendered or not."""
    before = (place / "film.cache").read_bytes()
    assert cli.main([*RENDER, "-o", "f{frame}.npz", "-o", "f{frame}.png"]) == 0
    assert cli.main([*RENDER, "--frames", "5:7", "-o", "g{frame}.png"]) == 0
    assert (place / "film.cache").read_bytes() == before
    for number in (5, 6):
        assert (place / f"f{number}.png").read_bytes() == (place / f"g{number}.png").read_bytes()
    scene = irrsplat.load("room.scene")
    path = load_path("a.path", scene.camera().fov)
    with irrsplat.Renderer(scene, (48, 48), **SETTINGS) as renderer:
        renderer.render(path.camera(3))
        renderer.load_cache("film.cache")
        for number in (7, 2):
            frame = renderer.render(path.camera(number), gather=False)
            with np.load(f"f{number}.npz") as file:
                assert all(np.array_equal(file[name], getattr(frame, name)) for name in file.files if name != "stats")
        assert frame.stats["uncovered"] == 0 and frame.stats["converged"]


def test_the_exposures_are_frame_zeros(place: Path) -> None:
    assert cli.main([*RENDER, "--frames", "6:7", "-o", "h.png", "--stats", "h.json"]) == 0
    scene = irrsplat.load("room.scene")
    with irrsplat.Renderer(scene, (48, 48), **SETTINGS) as renderer:
        renderer.load_cache("film.cache")
        exposures = [renderer.render(load_path("a.path", scene.camera().fov).camera(n), gather=False).exposure for n in (0, 6)]
    assert json.loads((place / "h.json").read_text())["frames"][0]["exposure"] == pytest.approx(exposures[0], abs=1e-3)
    assert abs(exposures[0] - exposures[1]) > 1e-2


def test_what_no_record_reaches_is_counted(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Seen from behind the flight there are other surfaces; none of them gets records."""
    elsewhere = ["--eye", "0", "0", "-0.9", "--target", "0", "0", "1"]
    command = ["render", "room.scene", *FAST, *elsewhere, "--cache", "film.cache", "--cache-mode", "frozen"]
    assert cli.main([*command, "-o", "b.npz", "--stats", "b.json"]) == 0
    told = json.loads((place / "b.json").read_text())
    with np.load("b.npz") as file:
        seen, alone = np.isfinite(file["depth"]), file["weight"] == 0.0
        assert 0 < told["uncovered"] <= np.count_nonzero(seen & alone)
        assert (file["irradiance"][seen].sum(-1) > 0.0).all()
    assert f"no record reaches some pixels (at most {told['uncovered']})" in capsys.readouterr().err


def test_what_else_is_known_of_a_scene_is_not_in_a_frozen_view(place: Path) -> None:
    """Where no record reaches, a renderer that has a surface cache would take that; one that has but the file cannot."""
    scene = irrsplat.load("room.scene")
    settings = {**SETTINGS, "bounces": 2}
    behind = irrsplat.Camera((0, 0, -0.9), (0, 0, 1))
    with irrsplat.Renderer(scene, (24, 24), **settings) as renderer:
        renderer.render()
        renderer.save_cache("two.cache")
        frames = [renderer.render(behind, gather=False)]
    with irrsplat.Renderer(scene, (24, 24), **settings) as renderer:
        renderer.load_cache("two.cache")
        frames += [renderer.render(behind, gather=False)]
    assert frames[0].stats["uncovered"] == frames[1].stats["uncovered"] > 0
    assert np.array_equal(frames[0].irradiance, frames[1].irradiance) and np.array_equal(frames[0].image, frames[1].image)


def test_a_frozen_film_flickers_less(place: Path) -> None:
    """At the same places, from frame to frame: what is left is the view's bounds of the records' radii, else every frame's new
    records show. Six seeds: 0.0013 to 0.0029, 0.12 to 0.38 times the film's (with 390 records; it is half as much with 700 of
    the same error)."""
    scene = irrsplat.load("room.scene")
    cameras = list(load_path("a.path", scene.camera().fov))
    with irrsplat.Renderer(scene, (48, 48), **SETTINGS) as renderer:
        film = film_flicker(renderer, cameras, frozen=False)
        renderer.load_cache("film.cache")
        frozen = film_flicker(renderer, cameras, frozen=True)
    assert 0.0 < frozen.rms < 0.004 and frozen.rms < 0.5 * film.rms
    assert frozen.jumps <= 0.2 * film.jumps


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (["render", "--cache-mode", "frozen", "-o", "x.png"], "give --cache FILE as well"),
        (["render", "--cache-mode", "frozen", "--cache", "no.cache", "-o", "x.png"], "there is no such file"),
        ([*RENDER, "--quality", "1", "-o", "x{frame}.png"], "--quality gathers records"),
        ([*RENDER, "--a", "0.5", "--seed", "3", "-o", "x{frame}.png"], "--seed 0, not --seed 3"),
        (["fill", "room.scene", "--cache", "x.cache"], "give --path FILE or --turntable N"),
        (["fill", "room.scene", "--path", "a.path"], "--cache is missing"),
        (["fill", "room.scene", "--path", "a.path", "--turntable", "8", "--cache", "x.cache"], "two different flights"),
        (["fill", "room.scene", "--path", "moving.path", "--cache", "x.cache"], "holds the light of one moment"),
        ([*RENDER[:-4], "--path", "moving.path", *RENDER[-4:], "-o", "x{frame}.png"], "holds the light of one moment"),
    ],
)
def test_what_cannot_be_is_refused(command: list[str], said: str, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (place / "moving.path").write_text(
        (place / "a.path").read_text() + "light 0 0 position 0 0.5 0\nlight 0 7 position 0 0.6 0\n"
    )
    assert cli.main(command) == 2
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1 and not list(place.glob("x*"))


def test_ctrl_c_keeps_what_is_there(place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """The same command goes on from it."""
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
    with irrsplat.Renderer(irrsplat.load("room.scene"), (48, 48), **SETTINGS) as renderer:
        renderer.load_cache("part.cache")
        assert 0 < renderer.cache.count < json.loads((place / "fill.json").read_text())["records"]
