"""`irrsplat measure`, its tables, files and statistics."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from irrsplat.app import cli

# a point light of 1790 cd, 2 m above the middle of a black floor of 4 × 4 m with a black block
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
    """Change to a working folder with the scene; return the folder."""
    for name, text in (("lit.scene", SCENE), ("floor.obj", FLOOR), ("block.obj", BLOCK)):
        (tmp_path / name).write_text(text)
    (tmp_path / "lamp.light").write_text("position 0 2 0 1\nintensity 1790 1790 1790\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def expected(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return the illuminance I·h/d³ in lux on the floor."""
    found: np.ndarray = 1790.0 * 2.0 / (x**2 + z**2 + 4.0) ** 1.5
    return found


def test_a_grid_in_a_csv_and_its_statistics(lit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([*MEASURE, "--height", "0", "--grid", "1", "--lux", "-o", "a.csv", "--stats", "a.json"]) == 0
    rows = list(csv.DictReader((lit / "a.csv").open()))
    assert list(rows[0]) == ["x", "y", "z", "direct", "indirect", "total", "status"]
    inside = [row for row in rows if row["status"] == "inside"]
    assert [(row["x"], row["z"], row["total"]) for row in inside] == [("1.5", "1.5", "")], "one point lies in the block"
    counted = [row for row in rows if row["status"] == "ok"]
    assert len(rows) == 16 and len(counted) == 15
    x, z, total = (np.array([float(row[name]) for row in counted]) for name in ("x", "z", "total"))
    lux = expected(x, z)
    assert total == pytest.approx(lux, rel=1e-3), "a light in candela gives lux"
    stats = json.loads((lit / "a.json").read_text())
    assert (stats["unit"], stats["points"], stats["inside"], stats["behind"], stats["grid"]) == ("lux", 15, 1, 0, [4, 4])
    values = [stats[name] for name in ("mean", "minimum", "maximum", "uniformity")]
    assert values == pytest.approx([lux.mean(), lux.min(), lux.max(), lux.min() / lux.mean()], rel=1e-3)
    out = capsys.readouterr().out
    assert f"mean        {lux.mean():.4g} lux" in out and "left out    1 within solids" in out
    assert f"U0 = {lux.min() / lux.mean():.3f}" in out


def test_points_as_a_table_and_as_csv(lit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = ["--point", "0", "0", "0", "0", "1", "0", "--point", "0", "1", "0", "0", "-3", "0"]
    assert cli.main([*MEASURE, *points, "--unit", "lux"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["x", "y", "z", "direct", "indirect", "total", "status"]
    assert lines[1].split() == ["0", "0", "0", "447.5", "0", "447.5", "ok"]
    assert lines[2].split() == ["0", "1", "0", "0", "0", "0", "ok"], "the point faces down to a black floor"
    assert cli.main([*MEASURE, *points, "-o", "-"]) == 0
    out, err = capsys.readouterr()
    head = [f"{kind}_{channel}" for kind in ("direct", "indirect", "total") for channel in "rgb"]
    assert out.splitlines()[0].split(",") == ["x", "y", "z", *head, "status"]
    assert out.splitlines()[1].startswith("0,0,0,2.5,2.5,2.5,0,") and len(out.splitlines()) == 3
    assert "mean" in err and "mean" not in out


def test_a_line_includes_both_ends(lit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Points are evenly spaced and include both ends; the illuminance is I·h/d³, and the first column is the distance in m."""
    line = ["--line", "-1.5", "0", "-0.5", "1.5", "0", "-0.5", "--grid", "0.4", "--lux"]
    assert cli.main([*MEASURE, *line, "-o", "line.csv"]) == 0
    rows = list(csv.DictReader((lit / "line.csv").open()))
    assert list(rows[0])[:4] == ["along", "x", "y", "z"] and {row["status"] for row in rows} == {"ok"}
    along, x, z, total = (np.array([float(row[name]) for row in rows]) for name in ("along", "x", "z", "total"))
    assert along == pytest.approx(np.linspace(0.0, 3.0, 9)) and x == pytest.approx(along - 1.5) and (z == -0.5).all()
    assert total == pytest.approx(expected(x, z), rel=1e-3)
    assert "points      9 along 3 m, 9 of them count" in capsys.readouterr().out
