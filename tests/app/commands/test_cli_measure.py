"""`irrsplat measure`: tables, files, statistics, and what it refuses."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from irrsplat.app import cli

# a lamp of 1790 cd, 2 m above the middle of a black floor of 4 × 4 m, with a black block on it
SCENE = """units photometric
cam 0 3 5 0 0 0 0 1 0
light lamp.light
brdf diffuse 0 0 0 1
obj floor.obj
push
trans 1 0 1
obj block.obj
pop
"""
FLOOR = "v -2 0 2\nv 2 0 2\nv 2 0 -2\nv -2 0 -2\nf 1 2 3 4\n"
BLOCK = "\n".join(f"v {x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 1))
BLOCK += "\nf 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
FAST = ["--bounces", "1", "--gather-size", "8", "--light-samples", "0", "--shadow-size", "256"]
MEASURE = ["measure", "lit.scene", *FAST]


@pytest.fixture
def lit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with the scene in it."""
    for name, text in (("lit.scene", SCENE), ("floor.obj", FLOOR), ("block.obj", BLOCK)):
        (tmp_path / name).write_text(text)
    (tmp_path / "lamp.light").write_text("position 0 2 0 1\nintensity 1790 1790 1790\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def expected(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Lux on the floor: I·h/d³."""
    found: np.ndarray = 1790.0 * 2.0 / (x**2 + z**2 + 4.0) ** 1.5
    return found


def test_a_grid_in_a_csv_and_its_statistics(lit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([*MEASURE, "--height", "0", "--grid", "1", "--lux", "-o", "a.csv", "--stats", "a.json"]) == 0
    rows = list(csv.DictReader((lit / "a.csv").open()))
    assert list(rows[0]) == ["x", "y", "z", "direct", "indirect", "total", "status"]
    inside = [row for row in rows if row["status"] == "inside"]
    assert [(row["x"], row["z"], row["total"]) for row in inside] == [("1.5", "1.5", "")], "the block"
    counted = [row for row in rows if row["status"] == "ok"]
    assert len(rows) == 16 and len(counted) == 15
    x, z, total = (np.array([float(row[name]) for row in counted]) for name in ("x", "z", "total"))
    truth = expected(x, z)
    assert total == pytest.approx(truth, rel=1e-3), "what is given in candela is measured in lux"
    stats = json.loads((lit / "a.json").read_text())
    assert (stats["unit"], stats["points"], stats["inside"], stats["behind"], stats["grid"]) == ("lux", 15, 1, 0, [4, 4])
    values = [stats[name] for name in ("mean", "minimum", "maximum", "uniformity")]
    assert values == pytest.approx([truth.mean(), truth.min(), truth.max(), truth.min() / truth.mean()], rel=1e-3)
    out = capsys.readouterr().out
    assert f"mean        {truth.mean():.4g} lux" in out and "left out    1 within solids" in out
    assert f"U0 = {truth.min() / truth.mean():.3f}" in out


def test_watts_of_three_channels_in_an_npz(lit: Path) -> None:
    plane = ["--plane", "-2", "0", "2", "4", "0", "0", "0", "0", "-4"]
    assert cli.main([*MEASURE, *plane, "--grid", "2", "--margin", "0.5", "-o", "a.npz"]) == 0
    with np.load(lit / "a.npz") as data:
        assert data["total"].shape == (4, 3) and data["grid"].tolist() == [2, 2]
        x, _, z = data["position"].T
        assert sorted(set(x.tolist())) == [-0.75, 0.75]
        shade = (x > 0.0) & (z > 0.0)
        assert data["direct"][~shade] == pytest.approx(np.tile(expected(x, z)[~shade, None] / 179.0, 3), rel=1e-3)
        assert np.array_equal(data["total"], data["direct"] + data["indirect"])
        assert json.loads(str(data["stats"]))["unit"] == "W/m2"


def test_points_on_the_terminal_and_csv_in_a_pipe(lit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = ["--point", "0", "0", "0", "0", "1", "0", "--point", "0", "1", "0", "0", "-3", "0"]
    assert cli.main([*MEASURE, *points, "--unit", "lux"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["x", "y", "z", "direct", "indirect", "total", "status"]
    assert lines[1].split() == ["0", "0", "0", "447.5", "0", "447.5", "ok"]
    assert lines[2].split() == ["0", "1", "0", "0", "0", "0", "ok"], "it faces down, to a black floor"
    assert cli.main([*MEASURE, *points, "-o", "-"]) == 0
    out, err = capsys.readouterr()
    assert (
        out.splitlines()[0] == "x,y,z,direct_r,direct_g,direct_b,indirect_r,indirect_g,indirect_b,total_r,total_g,total_b,status"
    )
    assert out.splitlines()[1].startswith("0,0,0,2.5,2.5,2.5,0,") and len(out.splitlines()) == 3
    assert "mean" in err and "mean" not in out


def test_a_line_goes_from_end_to_end(lit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Under the lamp the light falls off as I·h/d³; its points are even, with both ends, and their metres go before them."""
    line = ["--line", "-1.5", "0", "-0.5", "1.5", "0", "-0.5", "--grid", "0.4", "--lux"]
    assert cli.main([*MEASURE, *line, "-o", "line.csv"]) == 0
    rows = list(csv.DictReader((lit / "line.csv").open()))
    assert list(rows[0])[:4] == ["along", "x", "y", "z"] and {row["status"] for row in rows} == {"ok"}
    along, x, z, total = (np.array([float(row[name]) for row in rows]) for name in ("along", "x", "z", "total"))
    assert along == pytest.approx(np.linspace(0.0, 3.0, 9)) and x == pytest.approx(along - 1.5) and (z == -0.5).all()
    assert total == pytest.approx(expected(x, z), rel=1e-3)
    assert "points      9 along 3 m, 9 of them count" in capsys.readouterr().out

    # beside the lamp, facing it, at the distances 1 to 3: I/d², the normal towards it
    assert cli.main([*MEASURE, "--line", "1", "2", "0", "3", "2", "0", "--facing", "-2", "0", "0", "--lux", "-o", "a.npz"]) == 0
    with np.load(lit / "a.npz") as data:
        step = 0.2 * 5.0 ** np.log10(2.0)
        assert len(data["along"]) == np.ceil(2.0 / step) + 1
        assert data["total"] == pytest.approx(1790.0 / (1.0 + data["along"]) ** 2, rel=1e-3)


PLANE = ["--plane", "0", "0", "0", "1", "0", "0", "0", "0", "-1"]


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        ([], "nothing to measure; give --plane, --height, --line or --point"),
        (["--plane", "0", "0", "0"], "expected 9 arguments"),
        ([*PLANE[:-1], "x"], "'x'"),
        ([*PLANE[:-3], "1", "0", "0"], "span no area"),
        ([*PLANE, "--height", "1"], "--plane and --height say two different places"),
        ([*PLANE, "--grid", "0"], "spacing is 0"),
        ([*PLANE, "--grid", "1e-6"], "at most 1,000,000"),
        ([*PLANE, "--margin", "0.5"], "leaves nothing"),
        (["--point", "0", "0", "0", "0", "1", "0", "--grid", "1"], "--grid does not go with --point"),
        (["--line", "0", "0", "0", "1", "0", "0", "--margin", "1"], "--margin does not go with --line"),
        (["--line", "0", "0", "0", "0", "0", "0"], "one point"),
        (["--line", "0", "0", "0", "1", "0", "0", "--facing", "0", "0", "0"], "--facing is 0 0 0"),
        (["--point", "0", "0", "0", "0", "0", "0"], "a normal is 0 0 0"),
        ([*PLANE, "-o", "a.exr"], "expected .csv or .npz"),
        ([*PLANE, "-o", "missing/a.csv"], "does not exist"),
        ([*PLANE, "-o", "a.csv", "--stats", "a.csv"], "are one file"),
        ([*PLANE, "--unit", "candela"], "'candela'"),
        ([*PLANE, "--gather-size", "1"], "4..256"),
        ([*PLANE, "--a", "0.3"], "--a"),
    ],
)
def test_what_is_refused(argv: list[str], words: str, lit: Path, refused: Callable[..., str]) -> None:
    assert words in refused([*MEASURE, *argv])
