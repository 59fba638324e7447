"""`irrsplat bench`: its JSON keeps to the contract, its tables have the paper's rows, and its cases are what they say."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.app import cli
from irrsplat.app.bench import cases, fly_through, gather_truth, machine, paper_times
from irrsplat.gather.hemicube import hemisphere_table
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.indirect import paper_scan
from irrsplat.indirect.paper_scan import Seen
from irrsplat.reference import fine_gather
from irrsplat.scene.model import Camera
from tests.support.worlds import floor, material, sphere
from tests.support.worlds import scene as scene_of

FLIGHTS = ("filling", "filling worst", "warm", "warm worst")
CASES = ("empty", "warm", "moved", "light")
KEYS = {"scene", "preset", "size", "case", "seconds", "records", "rmse", "stages_ms", "clock"}  # the contract's
KEYS |= {"bounces", "seconds_all", "picture_seconds", "memory_mib"}


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Everything once and small, and truths in a folder of the test's own."""
    monkeypatch.setattr(cases, "REPETITIONS", 1)
    monkeypatch.setattr(fine_gather, "SIDE", 32)
    monkeypatch.setattr(gather_truth, "COUNT", 150)
    monkeypatch.setattr(fly_through, "FRAMES", 4)
    monkeypatch.setenv("IRRSPLAT_CACHE", str(tmp_path / "cache"))


@pytest.mark.long
def test_json_and_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["bench", "cornell-paper", "furnace", "--preset", "paper", "--preset", "default", "--size", "20", "18"]
    assert cli.main([*command, "--json", str(tmp_path / "b.json")]) == 0
    written = json.loads((tmp_path / "b.json").read_text())
    assert set(written) == {"machine", "runs"}
    assert written["machine"]["renderer"] and isinstance(written["machine"]["cpus"], int)
    for scene in ("cornell-paper", "furnace"):
        start = written["machine"]["startup_s"][scene]
        assert set(start) == {"import", "context", "load", "shaders"} and min(start.values()) > 0.0
    found = [(r["scene"], r["preset"], r["case"]) for r in written["runs"]]
    expected = []
    for scene, some in (("cornell-paper", CASES), ("furnace", CASES[:3])):  # no lamp, so none that could move
        expected += [(scene, preset, case) for preset in ("paper", "default") for case in some]
        expected += [(scene, "default", f"flight {case}") for case in FLIGHTS]
    assert found == expected
    for run in written["runs"]:
        assert set(run) == KEYS
        flight = run["case"].startswith("flight")
        assert run["size"] == ([20, 15] if flight else [20, 18]) and run["clock"] in ("gpu", "wall")
        assert run["bounces"] == ("all" if flight else 1)
        assert isinstance(run["records"], int) and run["records"] > 0
        assert run["seconds"] > 0.0 and run["seconds_all"] == [run["seconds"]]
        assert {"splat", "composite", "display" if flight else "direct"} <= set(run["stages_ms"]) or run["case"] == "light"
        assert all(ms >= 0.0 for ms in run["stages_ms"].values())
        assert (run["rmse"] is None) == flight
        assert flight or (run["memory_mib"]["gpu"] > 0.1 and run["memory_mib"]["process"] > 10.0)
        assert flight or run["picture_seconds"] >= run["seconds"]
    of = {(r["scene"], r["preset"], r["case"]): r for r in written["runs"]}
    for scene in ("cornell-paper", "furnace"):
        for preset in ("paper", "default"):
            empty, warm, moved = (of[scene, preset, case] for case in CASES[:3])
            assert {"shadow", "gather"} <= set(empty["stages_ms"]), "from nothing, not from the throw-away run"
            assert warm["records"] == empty["records"] and "shadow" not in warm["stages_ms"]
            assert warm["rmse"] == pytest.approx(empty["rmse"], rel=0.05), "it is the same view"
            assert {"gbuffer", "direct"} <= set(warm["stages_ms"]), "every buffer of the view is drawn again"
            assert moved["records"] >= empty["records"]
    for preset in ("paper", "default"):
        light, empty = of["cornell-paper", preset, "light"], of["cornell-paper", preset, "empty"]
        assert {"shadow", "gather"} <= set(light["stages_ms"]), "all of it is lit anew"
        assert light["records"] >= empty["records"], "records are gathered again in place"
        assert light["rmse"] == pytest.approx(empty["rmse"], rel=1.0), "against the truth by the lamp's new place"
    assert of["furnace", "default", "empty"]["rmse"] < 0.01, "E is π everywhere"
    assert of["furnace", "paper", "empty"]["rmse"] == pytest.approx(1.0 - 0.945, abs=0.01), "a 150° plane sees .945 of it"

    for scene in ("cornell-paper", "furnace"):
        for case in ("filling", "warm"):
            middle, worst = of[scene, "default", f"flight {case}"], of[scene, "default", f"flight {case} worst"]
            assert 0.0 < middle["seconds"] <= worst["seconds"]

    out = capsys.readouterr().out
    for line, most in (("filling", 1e9), ("warm", 0)):
        cells = next(words for words in map(str.split, out.splitlines()) if words[:1] == [line] and len(words) == 7)
        assert 0 <= int(cells[4]) <= most and float(cells[6]) > 0.0, "the flight's table: new records, first picture"
    for name, ms, _ in paper_times.ROWS:
        assert any(line.startswith(name) and f"{ms:.2f}" in line for line in out.splitlines()), f"{name} is missing"
    for preset in ("paper", "default"):
        for case in CASES:
            assert any(line.split()[:3] == ["cornell-paper", preset, case] for line in out.splitlines())
    assert "times faster than paper" in out and "8800 GT" in out and written["machine"]["renderer"] in out


def test_sizes_and_what_is_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two sizes, the default preset alone, no flight, and all bounces, whose truth is not there."""
    command = ["bench", "furnace", "--size", "16", "12", "--size", "12", "16", "--flight", "off", "--bounces", "all"]
    assert cli.main([*command, "--json", str(tmp_path / "b.json")]) == 0
    runs = json.loads((tmp_path / "b.json").read_text())["runs"]
    assert [(r["size"], r["preset"], r["case"], r["bounces"]) for r in runs] == [
        (size, "default", case, "all") for size in ([16, 12], [12, 16]) for case in CASES[:3]
    ]
    assert all(run["rmse"] is None for run in runs)
    assert "surface" in runs[0]["stages_ms"], "from empty, the light of further bounces is not there either"
    assert "all bounces" in capsys.readouterr().out


def test_the_truth_is_gathered_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Again it is read; of another view, by another lamp, or from a damaged file it is gathered."""
    scene = irrsplat.load("cornell-paper")
    made: list[int] = []
    gather = fine_gather.gather
    monkeypatch.setattr(fine_gather, "gather", lambda *given: made.append(1) or gather(*given))
    with irrsplat.Renderer(scene, size=(16, 12), bounces=1) as renderer:
        camera = scene.camera()
        first = gather_truth.truth(renderer, camera)
        assert first is not None and 10 < len(first.pixels) <= 16 * 12 and len(made) == 1
        again = gather_truth.truth(renderer, camera)
        assert again is not None and len(made) == 1
        assert np.array_equal(first.pixels, again.pixels) and np.array_equal(first.irradiance, again.irradiance)
        gather_truth.truth(renderer, cases.turned(camera, 5.0))
        assert len(made) == 2
        renderer.relight(cases.shifted(scene))
        relit = gather_truth.truth(renderer, camera)
        assert relit is not None and len(made) == 3 and not np.allclose(relit.irradiance, first.irradiance, rtol=1e-3)
        assert capsys.readouterr().err == ""
        for file in (tmp_path / "cache").iterdir():
            file.write_bytes(file.read_bytes()[:-9])
        assert np.array_equal(gather_truth.truth(renderer, camera).irradiance, relit.irradiance) and len(made) == 4
        assert "damaged" in capsys.readouterr().err


def test_truth_by_rays_is_that_by_rasters(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same pixels, whichever way the scene is looked at."""
    monkeypatch.setattr(fine_gather, "SIDE", 64)
    scene = irrsplat.load("cornell-paper")
    found = []
    with irrsplat.Renderer(scene, size=(24, 24), bounces=1) as renderer:
        view, _ = renderer.frame(gather=False)
        with renderer.ctx:
            seen = paper_scan.read_back(view.gbuffer)
            for rasters in (True, False):
                monkeypatch.setattr(fine_gather, "rasters", lambda scene, rasters=rasters: rasters)
                found.append(fine_gather.gather(renderer.world, seen, 512, 100))
                assert fine_gather.directions(scene) == (6 * 64**2 // 2 if rasters else 64**2)
    assert np.array_equal(found[0].pixels, found[1].pixels)
    mean = found[0].irradiance.mean()
    assert np.sqrt(np.mean((found[0].irradiance - found[1].irradiance) ** 2)) < 0.03 * mean
    assert abs(found[0].irradiance.mean() - found[1].irradiance.mean()) < 0.01 * mean


@pytest.mark.parametrize("rasters", [False, True])
def test_the_truth_of_a_small_bulb_is_free_of_noise(monkeypatch: pytest.MonkeyPatch, rasters: bool) -> None:
    """A bulb of 6 cm two metres above the floor: E = I·cosθ/d², I = π·r²·L; few of the directions hit it."""
    monkeypatch.setattr(fine_gather, "rasters", lambda _: rasters)
    radius, centre = 0.03, np.array((0.3, 2.0, 0.1))
    bulb = sphere(centre, radius, material(0.0, 1e3), 12, 24)
    world = scene_of(floor(3.0, paint=material(0.0)), bulb, camera=Camera((0, 1.5, 0), (0, 0, 0), (0, 0, -1)))
    with irrsplat.Renderer(world, size=(16, 16), bounces=1) as renderer:
        view, _ = renderer.frame(gather=False)
        with renderer.ctx:
            seen = paper_scan.read_back(view.gbuffer)
            found = fine_gather.gather(renderer.world, seen, 64, 100, 1e6)
    away = centre - seen.position[tuple(found.pixels.T)]
    truth = np.pi * radius**2 * 1e3 * away[:, 1] / np.linalg.norm(away, axis=1) ** 3
    assert len(truth) == 100 and np.abs(found.irradiance[:, 0] / truth - 1.0).max() < 0.05


def test_a_lamp_moves_towards_the_middle() -> None:
    scene = irrsplat.load("cornell")
    (light,) = cases.shifted(scene)
    way = np.subtract(light.position, scene.lights[0].position)
    assert np.linalg.norm(way) == pytest.approx(cases.SHIFT * scene.diagonal)
    assert np.dot(way, scene.bounds.mean(0) - scene.lights[0].position) > 0.0
    sun = replace(scene.lights[0], position=(0.0, 3.0, 0.0), directional=True)
    (turned,) = cases.shifted(replace(scene, lights=(sun,)))
    assert turned.position[1] / np.linalg.norm(turned.position) == pytest.approx(np.cos(np.arctan(cases.SHIFT)))


def test_memory_counts_textures_and_buffers_once(ctx: moderngl.Context) -> None:
    """A 4x2 RGBA32F texture that is listed twice, a buffer of 100 bytes, and a released one that counts no more."""

    class Kept(Owner):
        def __init__(self) -> None:
            self.texture = ctx.texture((4, 2), 4, dtype="f4")
            self.buffer, self.gone = ctx.buffer(reserve=100), ctx.buffer(reserve=1000)

        def owned(self) -> tuple[Resource, ...]:
            return (self.texture, self.texture, self.buffer, self.gone)

    kept = Kept()
    kept.gone.release()
    assert machine.gpu_memory(kept) == 4 * 2 * 4 * 4 + 100
    kept.release()
    assert machine.gpu_memory(kept) == 0


def test_rows_take_the_first_round_for_the_first_samples() -> None:
    """Times add up over the rounds; a round splats first, and gathers at its end."""
    rounds = [(10, {"splat": 1.0, "gather": 5.0, "reduce": 2.0, "examine": 1.0}), (14, {"splat": 4.0, "gather": 8.0})]
    end = {"splat": 4.5, "gather": 9.0, "reduce": 3.0, "examine": 2.5, "direct": 7.0, "composite": 6.0}
    rows = paper_times.rows(cases.Timing(1.0, 1.5, 15, end, rounds))
    assert rows == [(7.0, 10), (7.0, None), (3.0, 10), (2.5 + 4.0 + 1.0, 5), (0.5, 5), (6.0, None)]
    assert len(rows) == len(paper_times.ROWS)


def test_the_camera_turns_by_five_degrees_about_its_up_axis() -> None:
    camera = Camera((1.0, 2.0, 3.0), (2.0, 1.0, -4.0), (0.0, 1.0, 0.0), 40.0)
    moved = cases.turned(camera, 5.0)
    assert moved.eye == camera.eye and moved.fov == camera.fov
    assert np.allclose(moved.axes[1], camera.axes[1])
    assert moved.axes[2] @ camera.axes[2] == pytest.approx(np.cos(np.radians(5.0)))


def test_ctrl_c_ends_it(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """converge() takes Ctrl-C for the end of its rounds; a time that was cut short is no time."""
    interrupted = (None, {"interrupted": True, "records": 0})
    monkeypatch.setattr(irrsplat.Renderer, "converge", lambda self, camera, watch: interrupted)
    assert cli.main(["bench", "cornell-paper", "--size", "8", "8", "--json", str(tmp_path / "b.json")]) == 130
    assert not (tmp_path / "b.json").exists()
    assert capsys.readouterr().err.count("\n") == 1


def test_an_unknown_scene_is_an_error_before_any_work(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["bench", "cornell-paper", "no-such-scene"]) == 2
    assert capsys.readouterr().out == ""


def test_truth_has_sixteen_thousand_directions_and_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    assert (hemisphere_table("raster", fine_gather.SIDE)[..., 3] > 0.0).sum() >= 1 << 14
    assert fine_gather.directions(irrsplat.load("curved")) >= 1 << 14


def test_error_is_relative_to_the_mean() -> None:
    """A picture that is 10 % too bright everywhere is off by 0.1; without light there is nothing to be relative to."""
    pixels = np.array([[0, 0], [1, 2]])
    picture = np.full((2, 3, 3), 2.2)
    assert fine_gather.Truth(pixels, np.full((2, 3), 2.0)).error(picture) == pytest.approx(0.1)
    assert fine_gather.Truth(pixels, np.zeros((2, 3))).error(picture) is None
    assert fine_gather.Truth(pixels[:0], np.zeros((0, 3))).error(picture) is None


def test_smooth_leaves_out_edges_steps_and_the_sky() -> None:
    """A floor whose right half lies a step lower, with one pixel of sky."""
    y, x = np.mgrid[0:9, 0:12].astype(float)
    position = np.stack([x, np.where(x < 6, 0.0, -1.0), y], axis=-1)
    normal = np.zeros((9, 12, 3)) + np.array([0.0, 1.0, 0.0])
    mask = np.ones((9, 12), bool)
    mask[2, 2] = False
    expected = np.zeros((9, 12), bool)
    expected[1:-1, 1:-1] = True
    expected[:, 5:7] = False
    expected[1:4, 1:4] = False
    seen = Seen(position, normal, normal, mask)
    assert np.array_equal(seen.smooth(0.5), expected)
