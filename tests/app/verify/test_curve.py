"""`irrsplat verify --curve` and `--techniques`: which settings they go through, what they make of the errors, and the plot."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from irrsplat.app import cli
from irrsplat.app.common.plot import Line, loglog, palette, ticks
from irrsplat.app.verify import ablation, error_curve, measure
from irrsplat.app.verify.measure import Measured, in_flags
from irrsplat.reference import fine_gather, worker
from irrsplat.settings import PRESETS, SETTINGS, preset
from tests.app.verify.test_verify import plain

PLAIN = ["verify", "plain.scene", "--size", "6", "4", "--samples", "8", "--bounces", "1"]
QUICK = ["--size", "24", "24", "--truth", "gather", "--bounces", "1", "--shadow-size", "128"]
RED, BLUE = (200, 20, 20), (20, 20, 200)


def point(records: int, rmse: float | None, **values: Any) -> Measured:
    return Measured("default", values, records, rmse, 0.01, 0.02, 1.0)


@pytest.fixture
def law(fake: Any, place: Path, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A stand-in for the renderer whose records go with a^-2 and whose error with records^-power; `calls` holds its settings."""
    it = SimpleNamespace(calls=[], power=1.0)
    constant = fake.render

    def render(self: Any, camera: Any = None, progress: Any = None, figures: bool = False) -> Any:
        settings = preset(self.asked.preset, **self.asked.settings)
        it.calls.append((self.asked.preset, settings))
        records = 300.0 / settings.a**2 * (1.0 if self.asked.preset == "default" else 2.0)
        self.stats = {"records": round(records), "seconds": 0.5}
        frame = constant(self, camera, progress)
        frame.irradiance[:] = 0.8 * (1.0 + 30.0 * records**-it.power)
        return frame

    def trace(scene: Any, camera: Any, size: tuple[int, int], *_: Any) -> dict[str, np.ndarray]:
        return plain(*size, spread=0.0)

    monkeypatch.setenv("IRRSPLAT_CACHE", str(place / "cache"))
    monkeypatch.setattr(fake, "render", render)
    monkeypatch.setattr(worker, "trace", trace)
    return it


# ---- which settings ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PRESETS)
def test_every_point_of_a_curve_is_legal_and_ordered(name: str) -> None:
    """From few records to many; what is given holds for all."""
    settings = [preset(name, **values) for values in error_curve.points(name, {"seed": 7, "radius_max": 9.0})]
    assert len(settings) >= 5
    assert all(s.seed == 7 and s.radius_max == 9.0 for s in settings)
    a = [s.a for s in settings]
    assert a == sorted(a, reverse=True) and len(set(a)) == len(a)


def test_what_goes_with_a() -> None:
    """Twice the reach: twice the limits of the radius and of contradiction, half the gather's resolution; once: the preset."""
    base = preset("default")
    twice = preset("default", **error_curve.scaled("default", {}, 2.0))
    for name in ("a", *error_curve.WITH_A):
        assert getattr(twice, name) == 2.0 * getattr(base, name)
    assert twice.gather_size == base.gather_size / 2
    assert preset("default", **error_curve.scaled("default", {}, 1.0)) == base
    assert preset("default", **error_curve.scaled("default", {}, 1e-3)).gather_size == SETTINGS["gather_size"].high
    assert preset("default", **error_curve.scaled("default", {"radius_max": 0.0}, 2.0)).radius_max == 0.0
    assert base.a in error_curve.A, "the preset itself is a point of its curve"


@pytest.mark.parametrize(("words", "values"), ablation.TECHNIQUES)
def test_every_technique_changes_something(words: str, values: dict[str, Any]) -> None:
    assert preset("default", **values) != preset("default")


# ---- numbers -------------------------------------------------------------------------------------------------------------


def test_slope_and_interpolation_of_a_power_law() -> None:
    """rmse = 7·records^-0.6 has the slope -0.6, and lies on its own line between its points; off its ends nothing is known."""
    found = [point(n, 7.0 * n**-0.6) for n in (250, 4000, 1000)]
    assert error_curve.slope(found) == pytest.approx(-0.6)
    assert error_curve.at(found, 600) == pytest.approx(7.0 * 600**-0.6)
    assert error_curve.at(found, 4000) == pytest.approx(7.0 * 4000**-0.6)
    assert error_curve.at(found, 200) is None and error_curve.at(found, 4100) is None
    assert error_curve.slope([point(9, 0.1)]) is None and error_curve.slope([point(9, 0.1), point(9, 0.2)]) is None
    assert error_curve.slope([point(9, None), point(0, 0.2)]) is None and error_curve.at([], 5) is None


@pytest.mark.parametrize("power", [1.6, 2.0, 0.7])
def test_the_paper_s_a_for_as_many_records(power: float) -> None:
    tried: list[float] = []

    def render(name: str, values: dict[str, Any]) -> Measured:
        assert name == "paper" and set(values) == {"a", "warmup", "bounces"}
        tried.append(values["a"])
        return point(round(200.0 * values["a"] ** -power), 0.2)

    found = ablation.paper(render, 1200, {"bounces": 1, "a": 0.7, "gather_size": 8})
    assert abs(found.records / 1200 - 1.0) <= ablation.NEAR and len(tried) <= ablation.TRIES


def test_the_nearest_one_is_kept_where_no_a_gives_as_many() -> None:
    """A warm-up alone may make more records than are wanted."""
    found = ablation.paper(lambda name, values: point(900 + round(1.0 / values["a"]), 0.2), 400, {})
    assert found.records < 904


def test_ratios_are_those_at_equal_records() -> None:
    """On a curve of 1/records, a row of twice the records and the same error is off by twice as much as it need be."""
    line = [point(500, 0.2), point(1000, 0.1), point(2000, 0.05)]
    found = {"all": line[1], "less": point(2000, 0.1), "beyond": point(9000, 0.1), "dark": point(700, None)}
    cells = ablation.rows(list(found.items()), line)
    assert [row[-1] for row in cells] == ["at equal records", "1.00 x", "2.00 x", "", ""]
    assert cells[2][:5] == ("less", "2,000", "10.00 %", "+1.00 %", "2.00 %") and cells[4][2] == "no light"


def test_settings_as_flags() -> None:
    assert in_flags("paper", {"gather_size": 8, "a": 0.123456, "smooth": True}) == (
        "--preset paper --gather-size 8 --a 0.1235 --smooth on"
    )


# ---- the commands --------------------------------------------------------------------------------------------------------


def test_the_curve(law: SimpleNamespace, capsys: pytest.CaptureFixture[str]) -> None:
    """A power law of -1 is one in the table, and the plot shows both presets."""
    assert cli.main([*PLAIN, "--seed", "3", "--curve", "-o", "curve.png"]) == 0
    out, err = capsys.readouterr()
    assert err == "" and "preset default, one indirect bounce, against path-traced truth" in out
    slopes = [float(x) for x in re.findall(r"to the power of (\S+)", out)]
    assert slopes == pytest.approx([-1.0, -1.0], abs=0.03)
    rows = re.findall(r"^ +([\d.]+) +(\d+) +([\d,]+) +([\d.]+) %", out, re.M)
    assert [float(row[0]) for row in rows] == [*error_curve.A, *(values["a"] for values in error_curve.PAPER)]
    assert [name for name, _ in law.calls] == ["default"] * len(error_curve.A) + ["paper"] * len(error_curve.PAPER)
    assert all(settings.seed == 3 and settings.bounces == 1 for _, settings in law.calls)
    picture = np.asarray(Image.open("curve.png"))
    for colour in palette(2):
        assert (np.abs(picture.astype(int) - colour).max(-1) < 8).sum() > 200


def test_the_table_of_techniques(law: SimpleNamespace, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([*PLAIN, "--techniques"]) == 0
    lines = capsys.readouterr().out.splitlines()
    names = ["everything on", *(name for name, _ in ablation.TECHNIQUES), "preset paper, as many records"]
    assert len(lines) == 2 + len(names) and all(line.startswith(name) for line, name in zip(lines[2:], names, strict=True))
    assert [line.split()[-2] for line in lines[2:]] == ["1.00"] * len(names), "here the error depends on the records alone"
    whole, paper = (int(re.search(r" ([\d,]+) +[\d.]+ %", line)[1].replace(",", "")) for line in (lines[2], lines[-1]))  # type: ignore[index]
    assert whole == round(300.0 / preset("default").a ** 2)
    assert abs(paper / whole - 1.0) <= ablation.NEAR


def test_they_end_when_interrupted(law: SimpleNamespace, fake: Any, monkeypatch: pytest.MonkeyPatch, place: Path) -> None:
    render = fake.render

    def interrupted(self: Any, *args: Any, **rest: Any) -> Any:
        frame = render(self, *args, **rest)
        frame.stats["interrupted"] = True
        return frame

    monkeypatch.setattr(fake, "render", interrupted)
    for flags in (["--curve", "-o", "a.png"], ["--techniques"]):
        assert cli.main([*PLAIN, *flags]) == cli.INTERRUPTED
    assert len(law.calls) == 2 and not (place / "a.png").exists()


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Curves of three and two points, two techniques, and truths of fewer and coarser pixels."""
    monkeypatch.setattr(error_curve, "A", (1.1, 0.6, 0.4))
    monkeypatch.setattr(error_curve, "PAPER", error_curve.PAPER[:2])
    named = ("without gradients, and all that needs them", "one plane of 150°, not the hemisphere")
    monkeypatch.setattr(ablation, "TECHNIQUES", tuple(one for one in ablation.TECHNIQUES if one[0] in named))
    monkeypatch.setattr(ablation.measured, "__defaults__", (ablation.TECHNIQUES,))
    monkeypatch.setattr(measure, "GATHERED", 200)
    monkeypatch.setattr(fine_gather, "SIDE", 64)


@pytest.mark.long
def test_the_curve_of_a_real_scene(short: None, capsys: pytest.CaptureFixture[str]) -> None:
    """More records, less error: the last point of `cornell` is off by less than three quarters of what the first one is."""
    assert cli.main(["verify", "cornell", "--curve", *QUICK]) == 0
    out, _ = capsys.readouterr()
    found = [(int(n.replace(",", "")), float(e)) for n, e in re.findall(r"^ +[\d.]+ +\d+ +([\d,]+) +([\d.]+) %", out, re.M)]
    ours, paper = found[: len(error_curve.A)], found[len(error_curve.A) :]
    assert len(paper) == len(error_curve.PAPER)
    assert ours[-1][0] > 1.5 * ours[0][0] and ours[-1][1] < 0.75 * ours[0][1]


@pytest.mark.long
def test_the_techniques_on_a_real_scene(short: None, capsys: pytest.CaptureFixture[str]) -> None:
    """Gradients and the whole hemisphere are worth more than chance could hide."""
    assert cli.main(["verify", "cornell", "--techniques", *QUICK]) == 0
    lines = [re.split(r" {2,}", line) for line in capsys.readouterr().out.splitlines()[2:]]
    rows = {name: float(error.split()[0]) for name, _, error, *_ in lines}
    whole = rows["everything on"]
    assert len(rows) == 4 and all(error > 1.3 * whole for name, error in rows.items() if name != "everything on"), rows


# ---- the plot ------------------------------------------------------------------------------------------------------------


def test_ticks() -> None:
    assert [value for value, _ in ticks(0.5, 3.0)] == pytest.approx([0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 2.0, 3.0])
    assert [value for value, numbered in ticks(90.0, 1100.0) if numbered] == pytest.approx([100.0, 200.0, 500.0, 1000.0])
    assert [value for value, numbered in ticks(0.9, 1100.0) if numbered] == pytest.approx([1.0, 10.0, 100.0, 1000.0])


def spots(picture: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """(N, 2) x and y of all pixels of a colour."""
    return np.argwhere(np.abs(picture * 255.0 - colour).max(-1) < 3.0)[:, ::-1]


def test_a_power_law_is_a_straight_line() -> None:
    """And it falls to the right; the words in its colour stand in the upper right corner, above it."""
    x = np.array([100.0, 300.0, 5000.0])
    picture = loglog([Line("one", x, 40.0 * x**-0.5, RED)], "title", "across", "up")
    at = spots(picture, RED)
    at = at[at[:, 0] < 850]  # the words lie to the right of that
    slope, offset = np.polyfit(at[:, 0], at[:, 1], 1)
    assert slope > 0.2  # y is counted downward
    assert np.abs(slope * at[:, 0] + offset - at[:, 1]).max() < 8.0  # the dots' radius
    assert np.ptp(at[:, 0]) > 600


def test_plots_of_little() -> None:
    """Of nothing, of one point, of two lines."""
    one = np.array([100.0])
    assert loglog([], "", "", "").shape == loglog([Line("one", one, one, RED)], "t", "x", "y").shape
    two = loglog([Line("one", one, one, RED), Line("two", 3.0 * one, 2.0 * one, BLUE)], "t", "x", "y")
    left, right = (spots(two, colour) for colour in (RED, BLUE))
    left, right = left[left[:, 1] > 130], right[right[:, 1] > 130]  # below the words
    assert left.mean(0)[0] < right.mean(0)[0]


# ---- the page ------------------------------------------------------------------------------------------------------------


def test_the_page_has_every_technique_and_its_picture() -> None:
    page = Path(__file__).resolve().parents[3] / "docs/about/techniques.md"
    text = page.read_text(encoding="utf-8")
    for words in ("everything on", *(words for words, _ in ablation.TECHNIQUES), "preset paper, as many records"):
        assert text.count(f"| {words} |") == 2, f"{words}: run python docs/programs/techniques.py"
    assert all(text.count(f"| {a:.3g} |") for a in error_curve.A)
    assert (page.parents[1] / "images/measured/curve.png").stat().st_size <= 200_000
