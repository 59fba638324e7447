"""`irrsplat measure`, its tables, files and statistics, and `irrsplat render --falsecolor`."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from irrsplat.app import cli
from irrsplat.image.false_colours import GROUND, coloured, with_legend
from irrsplat.meter.light_scale import LightScale, false_colours

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
    (lit / "lit.scene").write_text(SCENE.replace("cam 0 3 5 0 0 0 0 1 0\n", ""))
    assert cli.main([*MEASURE, *points, "-o", "-"]) == 0
    out, err = capsys.readouterr()
    head = [f"{kind}_{channel}" for kind in ("direct", "indirect", "total") for channel in "rgb"]
    assert out.splitlines()[0].split(",") == ["x", "y", "z", *head, "status"]
    assert out.splitlines()[1].startswith("0,0,0,2.5,2.5,2.5,0,") and len(out.splitlines()) == 3
    assert "mean" in err and "mean" not in out and "camera" not in err


def test_a_line_includes_both_ends(lit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Points are evenly spaced and include both ends; the illuminance is I·h/d³, and the first column is the distance in m."""
    # the block and the light have x from -2 to 2 m: points at 3 and 4 m are dark, and a notice counts them
    assert cli.main([*MEASURE, "--line", "1", "0", "0", "4", "0", "0", "--grid", "1", "--facing", "0", "-1", "0"]) == 0
    assert "notice: 2 of 4 points get no light, and lie outside of the scene: x -2 to 2, " in capsys.readouterr().err
    line = ["--line", "-1.5", "0", "-0.5", "1.5", "0", "-0.5", "--grid", "0.4", "--lux"]
    assert cli.main([*MEASURE, *line, "-o", "line.csv"]) == 0
    rows = list(csv.DictReader((lit / "line.csv").open()))
    assert list(rows[0])[:4] == ["along", "x", "y", "z"] and {row["status"] for row in rows} == {"ok"}
    along, x, z, total = (np.array([float(row[name]) for row in rows]) for name in ("along", "x", "z", "total"))
    assert along == pytest.approx(np.linspace(0.0, 3.0, 9)) and x == pytest.approx(along - 1.5) and (z == -0.5).all()
    assert total == pytest.approx(expected(x, z), rel=1e-3)
    assert "points      9 along 3 m, 9 of them count" in capsys.readouterr().out


# a point light of 10 W/sr, 2 m above a floor; the camera looks straight down
COLOURED = "cam 0 3 0 0 0 0 0 0 -1\nproj 60 1 0.1 100\nlight lamp.light\nbrdf diffuse {0} {0} {0} 1\nobj floor.obj\n"
WIDE = "v -4 0 4\nv 4 0 4\nv 4 0 -4\nv -4 0 -4\nf 1 2 3 4\n"
RENDER = ["render", "lit.scene", "--size", "48", "32", "--bounces", "1", "--gather-size", "8", "--light-samples", "0"]


@pytest.fixture
def point_light(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> float:
    """Change to a working folder with the scene; return the floor's albedo."""
    for name, text in (("lit.scene", COLOURED.format(0.5)), ("floor.obj", WIDE)):
        (tmp_path / name).write_text(text)
    (tmp_path / "lamp.light").write_text("position 0 2 0 1\nintensity 10 10 10\n")
    monkeypatch.chdir(tmp_path)
    return 0.5


def scale_position(picture: np.ndarray) -> np.ndarray:
    """Return positions 0..1 on the scale for colours (…, 3)."""
    palette = false_colours(1001)
    found: np.ndarray = np.abs(picture[..., None, :] - palette).sum(-1).argmin(-1) / 1000.0
    return found


def read(path: str) -> np.ndarray:
    return np.asarray(Image.open(path), float) / 255.0


@pytest.mark.parametrize("unit", ["lux", "W/m2"])
def test_false_colours_show_the_illuminance_of_the_closed_form(point_light: float, unit: str) -> None:
    """False colours show E = I·h/d³, times 179 in lux, independent of the floor's albedo, next to a legend."""
    factor = 179.0 if unit == "lux" else 1.0
    argv = ["--falsecolor", "--unit", unit, "--scale", str(5.0 * factor), "--lines", "off"]
    assert cli.main([*RENDER, *argv, "-o", "a.png", "-o", "a.npz"]) == 0
    picture = read("a.png")
    assert picture.shape[0] == 32 and picture.shape[1] > 64, "the picture includes a legend"
    with np.load("a.npz") as data:
        p = data["position"]
        assert data["image"].max() == pytest.approx(point_light / np.pi * 2.5, rel=0.02), "the .npz holds radiance ρ·E/π"
    reference = 10.0 * 2.0 / np.linalg.norm(p - np.array([0.0, 2.0, 0.0]), axis=-1) ** 3
    assert np.abs(scale_position(picture[:, :48]) - reference / 5.0).max() < 0.02

    log = ["--falsecolor", "light", "--unit", unit, "--scale", str(5.0 * factor), "--log", "1", "--lines", "off"]
    assert cli.main([*RENDER, *log, "-o", "b.png"]) == 0
    assert np.abs(scale_position(read("b.png")[:, :48]) - np.clip(1.0 + np.log10(reference / 5.0), 0.0, 1.0)).max() < 0.02


def test_isolines_lie_at_steps_of_the_light() -> None:
    """Light rises to the right: one column is dark at each of seven visible steps, and pixels without surface are GROUND."""
    light = np.tile(np.linspace(0.0, 999.0, 200), (20, 1))
    depth = np.ones(light.shape)
    depth[:, 150:] = np.inf
    plain, lined = (coloured(light, depth, LightScale(highest=1000.0, lines=on)) for on in (False, True))
    dark = (lined < plain - 1e-6).any(-1)
    columns = np.flatnonzero(dark.all(0))
    steps = np.floor(light[0] / 100.0)
    assert dark.any(0).sum() == len(columns) == 7 and (steps[columns] + 1 == steps[columns + 1]).all()
    assert (lined[:, 150:] == GROUND).all()
    whole = with_legend(lined, LightScale(highest=1000.0), "light", "W/m²")
    assert np.abs(whole[:, :200] - lined).max() < 1.0 / 255.0 and whole.shape[0] == 20
