"""`irrsplat render --falsecolor`: what its colours stand for, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from irrsplat.app import cli
from irrsplat.app.commands.render import FALSE_COLOURED
from irrsplat.app.common.false_colours import WORDS
from irrsplat.image.output.false_colours import GROUND, coloured, with_legend
from irrsplat.meter.light_scale import LightScale, false_colours

# a lamp of 10 W/sr, 2 m above a floor that is seen from straight above
SCENE = "cam 0 3 0 0 0 0 0 0 -1\nproj 60 1 0.1 100\nlight lamp.light\nbrdf diffuse {0} {0} {0} 1\nobj floor.obj\n"
FLOOR = "v -4 0 4\nv 4 0 4\nv 4 0 -4\nv -4 0 -4\nf 1 2 3 4\n"
RENDER = ["render", "lit.scene", "--size", "90", "60", "--preset", "preview", "--bounces", "1", "--light-samples", "0"]


@pytest.fixture(params=[0.0, 0.5])
def lit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> float:
    """A working folder with the scene in it; the floor's albedo."""
    for name, text in (("lit.scene", SCENE.format(request.param)), ("floor.obj", FLOOR)):
        (tmp_path / name).write_text(text)
    (tmp_path / "lamp.light").write_text("position 0 2 0 1\nintensity 10 10 10\n")
    monkeypatch.chdir(tmp_path)
    return float(request.param)


def place_of(picture: np.ndarray) -> np.ndarray:
    """Where colours (…, 3), 0..1, stand on the scale."""
    palette = false_colours(1001)
    found: np.ndarray = np.abs(picture[..., None, :] - palette).sum(-1).argmin(-1) / 1000.0
    return found


def read(path: str) -> np.ndarray:
    return np.asarray(Image.open(path), float) / 255.0


@pytest.mark.parametrize("unit", ["lux", "W/m2"])
def test_the_light_on_a_floor_is_that_of_the_closed_form(lit: float, unit: str) -> None:
    """I·h/d³, times 179 in lux, whatever the floor reflects; every pixel in the colour of its place, beside it a legend."""
    factor = 179.0 if unit == "lux" else 1.0
    argv = ["--falsecolor", "--unit", unit, "--scale", str(5.0 * factor), "--lines", "off"]
    assert cli.main([*RENDER, *argv, "-o", "a.png", "-o", "a.npz"]) == 0
    picture = read("a.png")
    assert picture.shape[0] == 60 and picture.shape[1] > 120, "a legend stands beside it"
    with np.load("a.npz") as data:
        p = data["position"]
        assert data["image"].max() == pytest.approx(lit / np.pi * 2.5, rel=0.02), "of the floor below the lamp; other files stay"
    truth = 10.0 * 2.0 / np.linalg.norm(p - np.array([0.0, 2.0, 0.0]), axis=-1) ** 3
    assert np.abs(place_of(picture[:, :90]) - truth / 5.0).max() < 0.02

    log = ["--falsecolor", "light", "--unit", unit, "--scale", str(5.0 * factor), "--log", "1", "--lines", "off"]
    assert cli.main([*RENDER, *log, "-o", "b.png"]) == 0
    assert np.abs(place_of(read("b.png")[:, :90]) - np.clip(1.0 + np.log10(truth / 5.0), 0.0, 1.0)).max() < 0.02


def test_luminance_has_the_unit_of_radiance(lit: float, capsys: pytest.CaptureFixture[str]) -> None:
    """ρ/π·E in cd/m²; dark where the floor is black."""
    assert cli.main([*RENDER, "--falsecolor", "image", "--scale", "100", "--lines", "off", "-o", "a.png"]) == 0
    below = place_of(read("a.png")[28:32, 43:47])
    assert below.mean() == pytest.approx(179.0 * lit / np.pi * 2.5 / 100.0, abs=0.02)


def test_isolines_are_where_light_passes_a_step() -> None:
    """Of light that rises to the right, one column each between ten steps; where nothing is seen, the ground."""
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


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["--scale", "100"], "--scale is for --falsecolor"),
        (["--falsecolor", "--scale", "0"], "--scale is 0"),
        (["--falsecolor", "depth"], "'depth'"),
        (["--falsecolor", "--log", "0"], "from 1 to"),
        (["--falsecolor", "-o", "a.exr"], "no output is one"),
    ],
)
def test_what_is_wrong_is_told_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], argv: list[str], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    output = [] if "-o" in argv else ["-o", "a.png"]
    assert cli.main(["render", "cornell", *output, *argv]) == 2
    said = capsys.readouterr().err
    assert words in said and said.count("\n") == 1 and not list(tmp_path.iterdir())


def test_every_buffer_that_the_grammar_has_has_words() -> None:
    assert tuple(WORDS) == FALSE_COLOURED
