"""`irrsplat bench`: its JSON keeps to the contract, its tables have the paper's rows, and its cases are what they say."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import irrsplat
from irrsplat import exact
from irrsplat.app import bench, cli, flythrough
from irrsplat.hemisphere import hemisphere_table
from irrsplat.scene.model import Camera

FLIGHTS = ("filling", "filling worst", "warm", "warm worst")
KEYS = {"scene", "preset", "size", "case", "seconds", "records", "rmse", "stages_ms", "clock"}


def test_json_and_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "REPETITIONS", 1)
    monkeypatch.setattr(exact, "SIDE", 32)
    monkeypatch.setattr(flythrough, "FRAMES", 8)
    assert cli.main(["bench", "cornell-paper", "furnace", "--size", "32", "28", "--json", str(tmp_path / "b.json")]) == 0
    written = json.loads((tmp_path / "b.json").read_text())
    assert set(written) == {"machine", "runs"}
    assert written["machine"]["renderer"] and isinstance(written["machine"]["cpus"], int)
    cases = [(r["scene"], r["preset"], r["case"]) for r in written["runs"]]
    expected = []
    for scene in ("cornell-paper", "furnace"):
        expected += [(scene, preset, case) for preset in bench.PRESETS for case in ("empty", "warm", "moved")]
        expected += [(scene, "default", f"flight {case}") for case in FLIGHTS]
    assert cases == expected
    for run in written["runs"]:
        assert set(run) == KEYS
        flight = run["case"].startswith("flight")
        assert run["size"] == ([32, 24] if flight else [32, 28]) and run["clock"] in ("gpu", "wall")
        assert isinstance(run["records"], int) and run["records"] > 0
        assert run["seconds"] > 0.0
        assert {"splat", "composite", "display" if flight else "direct"} <= set(run["stages_ms"])
        assert all(ms >= 0.0 for ms in run["stages_ms"].values())
        assert (run["rmse"] is None) == (run["case"] != "empty")
    of = {(r["scene"], r["preset"], r["case"]): r for r in written["runs"]}
    for scene in ("cornell-paper", "furnace"):
        for preset in bench.PRESETS:
            empty, warm, moved = (of[scene, preset, case] for case in ("empty", "warm", "moved"))
            assert {"shadow", "gather"} <= set(empty["stages_ms"]), "from nothing, not from the throw-away run"
            assert warm["records"] == empty["records"] and "shadow" not in warm["stages_ms"]
            assert {"gbuffer", "direct"} <= set(warm["stages_ms"]), "every buffer of the view is drawn again"
            assert moved["records"] >= empty["records"]
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
    for name, ms, _ in bench.ROWS:
        assert any(line.startswith(name) and f"{ms:.2f}" in line for line in out.splitlines()), f"{name} is missing"
    for preset in bench.PRESETS:
        for case in ("empty", "warm", "moved"):
            assert any(line.split()[:3] == ["cornell-paper", preset, case] for line in out.splitlines())
    assert "times faster than paper" in out and "8800 GT" in out and written["machine"]["renderer"] in out


def test_rows_take_the_first_round_for_the_first_samples() -> None:
    """Times add up over the rounds; a round splats first, and gathers at its end."""
    rounds = [(10, {"splat": 1.0, "gather": 5.0, "reduce": 2.0, "examine": 1.0}), (14, {"splat": 4.0, "gather": 8.0})]
    end = {"splat": 4.5, "gather": 9.0, "reduce": 3.0, "examine": 2.5, "direct": 7.0, "composite": 6.0}
    rows = bench.Timing(1.0, 1.5, 15, end, rounds).rows
    assert rows == [(7.0, 10), (7.0, None), (3.0, 10), (2.5 + 4.0 + 1.0, 5), (0.5, 5), (6.0, None)]
    assert len(rows) == len(bench.ROWS)


def test_the_camera_turns_by_five_degrees_about_its_up_axis() -> None:
    camera = Camera((1.0, 2.0, 3.0), (2.0, 1.0, -4.0), (0.0, 1.0, 0.0), 40.0)
    moved = bench.turned(camera, 5.0)
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


def test_truth_has_sixteen_thousand_directions_and_more() -> None:
    assert (hemisphere_table("raster", exact.SIDE)[..., 3] > 0.0).sum() >= 1 << 14


def test_error_is_relative_to_the_mean() -> None:
    """A picture that is 10 % too bright everywhere is off by 0.1; without light there is nothing to be relative to."""
    pixels = np.array([[0, 0], [1, 2]])
    picture = np.full((2, 3, 3), 2.2)
    assert exact.Truth(pixels, np.full((2, 3), 2.0)).error(picture) == pytest.approx(0.1)
    assert exact.Truth(pixels, np.zeros((2, 3))).error(picture) is None
    assert exact.Truth(pixels[:0], np.zeros((0, 3))).error(picture) is None


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
    seen = SimpleNamespace(position=position, normal=normal, mask=mask)
    assert np.array_equal(exact.smooth(seen, 0.5), expected)
