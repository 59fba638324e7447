"""`irrsplat bench`: its JSON, references and flights, --growth and --compare."""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat.app import cli
from irrsplat.app.bench import cases, compare, gather_truth, scaling, stage_profile
from irrsplat.indirect import paper_scan
from irrsplat.reference import fine_gather
from irrsplat.scene.camera_path import load_path
from irrsplat.scene.model import Camera
from irrsplat.scene.ray_caster import RayCaster
from tests.support.renders import rendered
from tests.support.truth import SIZE as FULL
from tests.support.truth import compare as compare_pixels
from tests.support.truth import load_reference
from tests.support.worlds import floor, material, sphere
from tests.support.worlds import scene as scene_of

CASES = ("empty", "warm", "moved", "light")
KEYS = {"scene", "preset", "size", "case", "seconds", "records", "rmse", "stages_ms", "clock"}  # the contract's
KEYS |= {"bounces", "seconds_all", "picture_seconds"}


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Run each case once at a small size, with references in a folder of the test."""
    monkeypatch.setattr(cases, "REPETITIONS", 1)
    monkeypatch.setattr(fine_gather, "SIDE", 32)
    monkeypatch.setattr(gather_truth, "COUNT", 150)
    monkeypatch.setenv("IRRSPLAT_CACHE", str(tmp_path / "cache"))


def checked_rows(written: dict[str, Any]) -> dict[tuple[str, str, str], dict[str, Any]]:
    """Assert the keys and ranges of a benchmark's JSON; return its rows by scene, preset and case."""
    assert set(written) == {"machine", "runs"}
    assert written["machine"]["renderer"] and isinstance(written["machine"]["cpus"], int)
    for run in written["runs"]:
        assert set(run) == KEYS
        assert run["clock"] in ("gpu", "wall") and isinstance(run["records"], int) and run["records"] > 0
        assert run["seconds_all"] == [run["seconds"]]
        assert {"splat", "composite", "direct"} <= set(run["stages_ms"]) or run["case"] == "light"
    return {(run["scene"], run["preset"], run["case"]): run for run in written["runs"]}


def test_each_case_starts_from_its_named_state(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The stages and the number of records of each row show the state from which its case starts."""
    command = ["bench", "cornell-paper", "--preset", "default", "--size", "12", "10"]
    assert cli.main([*command, "--json", str(tmp_path / "b.json")]) == 0
    of = checked_rows(json.loads((tmp_path / "b.json").read_text()))
    assert [*of] == [("cornell-paper", "default", case) for case in CASES]
    empty, warm, moved, light = of.values()
    assert {"shadow", "gather"} <= set(empty["stages_ms"]), "the case starts empty, without the results of the warm-up run"
    assert warm["records"] == empty["records"] and "shadow" not in warm["stages_ms"]
    assert warm["rmse"] == pytest.approx(empty["rmse"], rel=0.05), "both cases have the same view"
    assert {"gbuffer", "direct"} <= set(warm["stages_ms"]), "a warm frame redraws each buffer of the view"
    assert moved["records"] >= empty["records"]
    assert {"shadow", "gather"} <= set(light["stages_ms"]), "a moved light invalidates shadows and records"
    assert light["records"] >= empty["records"], "a moved light refreshes records in place"
    assert all(run["size"] == [12, 10] and run["bounces"] == 1 for run in of.values())
    out = capsys.readouterr().out
    assert all(any(line.split()[:3] == ["cornell-paper", "default", case] for line in out.splitlines()) for case in CASES)


@pytest.mark.few_sites
def test_a_profile_counts_nested_time_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each reading of the clock adds 1 s: outer lasts 3 s including 1 s of inner. The profile restores wrapped functions."""
    command = ["bench", "cornell", "--profile", "--bounces", "2", "--size", "24", "18", "--json", str(tmp_path / "b.json")]
    assert cli.main(command) == 0 and not hasattr(RayCaster.first_hits, "__wrapped__")
    (one,) = json.loads((tmp_path / "b.json").read_text())["profiles"]
    assert {"shading of hits", "reduction", "splats", "surface cache"} < set(one["stages"]) and one["rays"] > 64 * 64
    monkeypatch.setattr(time, "process_time", map(float, itertools.count()).__next__)
    profile = stage_profile.Profile(lambda: None)
    with profile.stage("outer"), profile.stage("inner"):
        pass
    assert {name: share.seconds for name, share in profile.shares.items()} == {"Python (rest)": 1.0, "outer": 2.0, "inner": 1.0}


@pytest.mark.long
def test_scenes_and_presets_have_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["bench", "cornell-paper", "furnace", "--preset", "paper", "--preset", "default", "--size", "20", "18"]
    assert cli.main([*command, "--json", str(tmp_path / "b.json")]) == 0
    written = json.loads((tmp_path / "b.json").read_text())
    of = checked_rows(written)
    expected = []
    for scene, some in (("cornell-paper", CASES), ("furnace", CASES[:3])):  # the furnace has no light to move
        expected += [(scene, preset, case) for preset in ("paper", "default") for case in some]
    assert [*of] == expected
    assert of["furnace", "default", "empty"]["rmse"] < 0.01, "E is π everywhere"
    assert of["furnace", "paper", "empty"]["rmse"] == pytest.approx(1.0 - 0.945, abs=0.01), "a 150° plane covers 0.945 of E"

    out = capsys.readouterr().out
    assert "times faster than paper" in out and written["machine"]["renderer"] in out


def test_a_reference_is_gathered_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each view and each set of lights has a file. The next run reads this file and replaces a damaged one."""
    scene = irrsplat.load("cornell-paper")
    cache = tmp_path / "cache"
    with irrsplat.Renderer(scene, size=(16, 12), bounces=1) as renderer:
        camera = scene.camera()
        first = gather_truth.truth(renderer, camera)
        (file,) = cache.glob("*.npz")
        kept = file.read_bytes()
        again = gather_truth.truth(renderer, camera)
        assert first is not None and again is not None and 10 < len(first.pixels) <= 16 * 12
        assert np.array_equal(first.pixels, again.pixels) and np.array_equal(first.irradiance, again.irradiance)
        gather_truth.truth(renderer, cases.turned(camera, 5.0))
        renderer.relight(cases.shifted(scene))
        relit = gather_truth.truth(renderer, camera)
        assert relit is not None and not np.allclose(relit.irradiance, first.irradiance, rtol=1e-3)
        assert len([*cache.glob("*.npz")]) == 3 and capsys.readouterr().err == ""
        renderer.relight(scene.lights)
        file.write_bytes(kept[:-9])
        repaired = gather_truth.truth(renderer, camera)
        assert repaired is not None and np.array_equal(repaired.irradiance, first.irradiance)
        assert "damaged" in capsys.readouterr().err and len(file.read_bytes()) == len(kept)


def test_the_reference_of_a_small_bulb_has_little_noise() -> None:
    """A bulb of 6 cm at 2 m gives E = I·cosθ/d² with I = π·r²·L, although few hemisphere samples hit the bulb."""
    radius, centre = 0.03, np.array((0.3, 2.0, 0.1))
    bulb = sphere(centre, radius, material(0.0, 1e3), 12, 24)
    world = scene_of(floor(3.0, paint=material(0.0)), bulb, camera=Camera((0, 1.5, 0), (0, 0, 0), (0, 0, -1)))
    with irrsplat.Renderer(world, size=(16, 16), bounces=1) as renderer:
        view, _ = renderer.frame(gather=False)
        with renderer.ctx:
            seen = paper_scan.read_back(view.gbuffer)
            found = fine_gather.gather(renderer.world, seen, 64, 100, 1e6)
    away = centre - seen.position[tuple(found.pixels.T)]
    expected = np.pi * radius**2 * 1e3 * away[:, 1] / np.linalg.norm(away, axis=1) ** 3
    assert len(expected) == 100 and np.abs(found.irradiance[:, 0] / expected - 1.0).max() < 0.05


@pytest.mark.long
def test_a_flight_keeps_the_accuracy_of_its_first_view() -> None:
    """Records of other views add little error: at the first camera, at most 1.1 times the error of a fresh render."""
    scene, reference = irrsplat.load("cornell"), load_reference("cornell")
    first = scene.camera()
    path = load_path(Path(scene.path).parent / "flight.path", first.fov)
    cameras = [path.camera(t) for t in np.linspace(0, path.frames - 1, 6)]
    fresh = compare_pixels(rendered("cornell", bounces=1), reference)["rmse"]
    with irrsplat.Renderer(scene, (FULL, FULL), bounces=1) as renderer:
        for camera in cameras:
            renderer.converge(camera)
        assert compare_pixels(renderer.render(first), reference)["rmse"] <= 1.1 * fresh


@pytest.mark.few_sites
def test_a_row_of_growth_has_the_requested_triangles(monkeypatch: pytest.MonkeyPatch) -> None:
    """The time per record is the time of gathering and reduction divided by the number of records."""
    monkeypatch.setattr(scaling, "REPETITIONS", 1)
    row = scaling.measured(1000, 12)
    assert row.triangles == pytest.approx(1000, rel=0.1) and row.size == (12, 12)
    assert row.records > 0 and {"gather", "reduce"} <= set(row.stages)
    assert row.record == pytest.approx((row.stages["gather"] + row.stages["reduce"]) / row.records)


def row(case: str = "empty", seconds: float = 1.0, **more: Any) -> Any:
    """Return a row of the benchmark's JSON."""
    return {"scene": "a", "preset": "default", "size": [8, 8], "case": case, "seconds": seconds, "rmse": None} | more


def test_a_comparison_has_the_ratio_of_times(tmp_path: Path) -> None:
    """2 s then and 0.5 s now have the ratio 4. Rows with different bounces are not compared; unmatched rows are listed."""

    def read(*rows: Any) -> list[cases.Run]:
        (tmp_path / "bench.json").write_text(json.dumps({"runs": rows}))
        return compare.read(str(tmp_path / "bench.json"))

    then = read(row(seconds=2.0, rmse=0.02), row("warm"), row("moved"))
    now = read(row(seconds=0.5, rmse=0.01), row("warm", bounces=2), row("moved", bounces=1))
    head, *lines = compare.table(then, now)
    assert head.split()[:4] == ["scene", "preset", "size", "bounces"]
    assert lines[0].split() == ["a", "default", "8x8", "1", "empty", "2.000", "0.500", "4.00", "2.0%", "1.0%", "faster"]
    assert lines[1].split()[4:] == ["moved", "1.000", "1.000", "1.00", "-", "-"]
    assert lines[2:] == ["only then: a default 8x8 1 warm", "only now: a default 8x8 2 warm"]
    assert list(compare.table([], now[:1])) == ["only now: a default 8x8 1 empty"]


@pytest.mark.parametrize(
    "text",
    ["", "{", '{"runs": [1]}', json.dumps({"runs": [row(seconds=0.0)]}), json.dumps({"runs": [row(rmse="small")]}), "\udcff"],
)
def test_an_invalid_file_is_refused_in_one_line(tmp_path: Path, refused: Callable[..., str], text: str) -> None:
    path = tmp_path / "then.json"
    path.write_text(text, encoding="utf-8", errors="surrogateescape")
    assert str(path) in refused(["bench", "--compare", str(path)])
    assert "cannot read" in refused(["bench", "--compare", "none.json"])
