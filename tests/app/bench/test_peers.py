"""`irrsplat bench --peers`: scenes in Radiance's words, what the table says of who gets where, and small races where others are
installed."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import irrsplat
from irrsplat.app import cli
from irrsplat.app.bench import cases, gather_truth
from irrsplat.app.bench.peers import judging, mitsuba, race, radiance, radiance_scene, table
from irrsplat.app.bench.peers.judging import Measurement, Series
from irrsplat.app.common.plot import Line, loglog, palette
from irrsplat.app.verify import error_curve
from irrsplat.core.errors import IrrsplatError
from irrsplat.reference import fine_gather, worker
from irrsplat.scene.model import Light, Scene
from tests.support.luminaires import lambert, photometry

here = pytest.mark.skipif(radiance.installed() is None, reason="the extra `peers` is not installed")


def measurements(system: str, *found: tuple[float, float]) -> tuple[Measurement, ...]:
    """Measurements of these seconds and errors, each with a further view in a tenth of the time."""
    return tuple(Measurement(system, "q", seconds, rmse, seconds / 10.0, rmse) for seconds, rmse in found)


# ---- Radiance's words ----------------------------------------------------------------------------------------------------


def words(scene: Scene) -> list[list[str]]:
    return [line.split() for line in radiance_scene.text(scene).splitlines() if line]


def test_a_scene_in_radiances_words() -> None:
    """Lambertian paint, a mesh by file, and a point light as an invisible sphere: I = L·π·r²."""
    scene = irrsplat.load("cornell")
    lines = words(scene)
    meshes = [mesh for mesh in scene.meshes if len(mesh.faces)]
    for number, mesh in enumerate(meshes):
        paint, shape = lines[2 * number : 2 * number + 2]
        assert paint[:6] == ["void", "plastic", f"paint{number}", "0", "0", "5"]
        assert [float(x) for x in paint[6:]] == pytest.approx([*mesh.material.albedo, 0.0, 0.0])
        assert shape == [f"paint{number}", "mesh", f"mesh{number}", "1", f"mesh{number}.rtm", "0", "0"]
    bulb, sphere = lines[2 * len(meshes) :]
    assert bulb[:7] == ["void", "illum", "lamp0", "1", "void", "0", "3"]
    intensity = np.array([float(x) for x in bulb[7:]]) * np.pi * radiance_scene.LAMP**2
    assert intensity == pytest.approx(scene.lights[0].color)
    assert [float(x) for x in sphere[6:]] == pytest.approx([*scene.lights[0].position, radiance_scene.LAMP])


def test_other_lights_in_radiances_words() -> None:
    """A directional one is a small disc of E/Ω; the sky shines all around; a cone and an attenuation are patterns."""
    sun = Light((0.0, 2.0, 0.0), (1.0, 2.0, 3.0), directional=True)
    spot = Light((0.0, 3.0, 0.0), (4.0, 4.0, 4.0), physical=True, spot_target=(0.0, 0.0, 0.0), spot_cutoff=30.0, spot_inner=20.0)
    lamp = Light((0.0, 1.0, 0.0), (1.0, 1.0, 1.0), attenuation=(1.0, 0.0, 0.5))
    scene = replace(irrsplat.load("cornell"), meshes=(), lights=(sun, spot, lamp), sky=(0.1, 0.2, 0.3))
    light, source, cone, _, _, falloff, _, _, sky, around = words(scene)
    solid_angle = np.pi * np.radians(radiance_scene.SUN / 2.0) ** 2
    assert np.array([float(x) for x in light[6:]]) * solid_angle == pytest.approx(np.pi * np.array(sun.color), rel=1e-4)
    assert source[1] == "source" and [float(x) for x in source[6:]] == [0.0, 2.0, 0.0, radiance_scene.SUN]
    assert cone[1] == "brightfunc" and [float(x) for x in cone[8:]] == pytest.approx([0.0, -1.0, 0.0, 30.0, 10.0])
    assert falloff[1] == "brightfunc" and [float(x) for x in falloff[8:]] == [1.0, 0.0, 0.5]
    assert sky[:3] == ["void", "glow", "sky"] and around[-1] == "360"


def test_what_radiance_has_no_words_for() -> None:
    with pytest.raises(IrrsplatError, match="shines and reflects"):
        radiance_scene.text(irrsplat.load("furnace"))
    luminaire = Light((0, 1, 0), (1, 1, 1), physical=True, photometry=photometry([0, 90], [0], lambert))
    with pytest.raises(IrrsplatError, match="luminaires"):
        radiance_scene.text(replace(irrsplat.load("cornell"), lights=(luminaire,)))


def test_mitsuba_s_own_integrator_takes_no_luminaires() -> None:
    trace_points = pytest.importorskip("irrsplat.reference.trace_points", exc_type=ImportError)
    luminaire = Light((0, 1, 0), (1, 1, 1), physical=True, photometry=photometry([0, 90], [0], lambert))
    with pytest.raises(IrrsplatError, match="luminaires"):
        trace_points._lamp(luminaire)


# ---- who gets where ------------------------------------------------------------------------------------------------------


def test_the_first_point_that_gets_there_counts() -> None:
    series = Series(measurements("a", (1.0, 0.2), (3.0, 0.04), (9.0, 0.01)), "")
    assert race.reached(series) == (3.0, True)
    assert race.reached(series, further=True) == (0.3, True)
    assert race.reached(Series(measurements("a", (1.0, 0.2)), "")) is None
    assert race.reached(Series(measurements("a", (1.0, 0.2)), "", keeps_nothing=True)) == (pytest.approx(16.0), False), (
        "a quarter: 16 times"
    )


def test_the_verdict_is_a_ratio_to_ours() -> None:
    found = [
        Series(measurements("irrsplat", (2.0, 0.04)), "as it is"),
        Series(measurements("slow", (1.0, 0.2), (30.0, 0.05)), "after 1 s"),
        Series(measurements("never", (1.0, 0.3)), ""),
        Series(measurements("noise", (1.0, 0.1)), "", keeps_nothing=True),
        Series((), "absent: not installed"),
    ]
    first, second = race.verdict(found)
    assert "irrsplat 2.000 s; slow 30.00 s, 15.0 times as long; never does not get there (30.0% at best)" in first
    assert "noise by 1/√samples some 4.00 s, 2.0 times as long" in first and "absent" not in first
    assert "irrsplat 0.200 s; slow 3.00 s, 15.0 times as long" in second
    told = list(race.report("cornell", found))
    assert "absent: not installed" in told and "slow: after 1 s" in told
    assert race.plot("cornell", found).shape[2] == 3


def test_every_system_has_a_line_in_the_plot() -> None:
    """However many there are: each one's colour is there."""
    colours = palette(9)
    found = [Series(measurements(f"system {i}", (1.0 + i, 0.2), (10.0 + i, 0.1)), "", c) for i, c in enumerate(colours)]
    picture = np.round(race.plot("many", found) * 255.0).astype(int)
    for colour in colours:
        assert (np.abs(picture - colour).max(-1) < 4).sum() > 100, colour
    assert len(set(colours)) == len(colours) and palette(2) == colours[:2]


@pytest.mark.parametrize("peer", table.PEERS, ids=lambda peer: peer.name)
def test_the_table_names_functions_that_are_there(peer: table.Peer) -> None:
    """`measure` finds it without the peer's own package; nothing is measured before the first series is taken."""
    assert iter(peer.measure(irrsplat.load("cornell"), (4, 4), 1, (), lambda words: None))


@pytest.mark.parametrize(("y", "corner"), [((9.0, 1.0), "upper right"), ((1.0, 9.0), "lower right")])
def test_the_legend_keeps_out_of_the_way(y: tuple[float, float], corner: str) -> None:
    """A falling line leaves the upper right free, a rising one ends there and begins in the lower left."""
    red = (200, 20, 20)
    picture = loglog([Line("a", np.array([1.0, 9.0]), np.array(y), red)], "t", "x", "y")
    coloured = np.abs(picture * 255.0 - red).max(-1) < 20.0
    height, width = coloured.shape
    rows = slice(0, height // 4) if corner == "upper right" else slice(3 * height // 4, None)
    assert coloured[rows, 9 * width // 10 :].any()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--preset", "paper"], "--preset"),
        (["-o", "plot.jpg"], ".png"),
        (["cornell", "curved", "-o", "plot.png"], "one scene"),
    ],
)
def test_what_cannot_be_is_said_at_once(
    more: list[str], said: str, refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table.Peer, "installed", True)
    assert said in refused(["bench", "--peers", *more])


def test_without_the_extra_it_says_what_to_install(refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    missing = lambda name, *rest: None if name in ("pyradiance", "mitsuba") else find(name, *rest)  # noqa: E731
    monkeypatch.setattr(importlib.util, "find_spec", missing)
    assert "pip install 'irrsplat[peers]'" in refused(["bench", "--peers"], 1)
    assert "--peers" in refused(["bench", "-o", "a.png"])


# ---- small races ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Ours at two settings, everybody else briefly, and truths of the test's own."""
    monkeypatch.setenv("IRRSPLAT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(cases, "REPETITIONS", 1)
    monkeypatch.setattr(fine_gather, "SIDE", 64)
    monkeypatch.setattr(gather_truth, "COUNT", 150)
    monkeypatch.setattr(error_curve, "A", (0.6, 0.4))
    monkeypatch.setattr(radiance, "QUALITIES", ((0.2, 512, 128),))


@pytest.mark.long
def test_a_race_in_which_the_others_fall(
    small: None, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Their failures are rows with their names; ours is measured, written and plotted all the same."""

    def fall(*_: Any) -> None:
        raise IrrsplatError("the path tracer failed")

    monkeypatch.setattr(worker, "call", fall)
    monkeypatch.setattr(table.Peer, "installed", True)
    monkeypatch.setattr(radiance, "installed", lambda: tmp_path)
    plot, numbers = tmp_path / "plot.png", tmp_path / "peers.json"
    command = ["bench", "--peers", "cornell", "--size", "20", "20", "-o", str(plot), "--json", str(numbers)]
    assert cli.main(command) == 0
    out = capsys.readouterr().out
    for line in ("Radiance: obj2mesh: ", "Mitsuba: the path tracer failed", "Mitsuba, lamps joined: the path tracer failed"):
        assert any(said.startswith(line) for said in out.splitlines()), out
    found = json.loads(numbers.read_text())["peers"]
    ours, others = [row for row in found if "failed" not in row], [row for row in found if "failed" in row]
    assert len(ours) == 2 and len(others) == 3
    assert all(row["system"] == "irrsplat" and row["seconds"] > 0.0 and 0.0 < row["rmse"] < 0.2 for row in ours)
    assert all(row["further"] < row["seconds"] for row in ours), "records are kept"
    assert Image.open(plot).size[0] > 500 and plot.stat().st_size < 200_000


@here
def test_radiance_agrees_with_the_gather(tmp_path: Path, small: None) -> None:
    """One bounce in a box whose lamp hangs free, direct light taken off: the same irradiance, within what its rays leave to
    chance. Its ambient file makes a second look cheap, and says the same."""
    scene = irrsplat.load("curved")
    with irrsplat.Renderer(scene, size=(24, 24), bounces=1) as renderer:
        view = judging.judged_view(renderer, scene.camera())
    it = radiance.Rtrace(scene, tmp_path, 1)
    direct, _ = it.irradiance(view.position, view.normal, 0)
    first, _ = it.irradiance(view.position, view.normal, 1, (0.1, 1024, 256))
    E = (first - direct)[view.judged]
    assert view.error(first - direct) < 0.06
    assert E.mean() == pytest.approx(view.truth.irradiance.mean(), rel=0.03)
    rough, _ = it.irradiance(view.position, view.normal, 1, (0.1, 1024, 256))
    assert np.abs(rough - first).mean() < 0.03 * E.mean()
    it.forget()
    rough, _ = it.irradiance(view.position, view.normal, 1, (0.5, 16, 0))
    assert view.error(rough - direct) > view.error(first - direct), "the error falls with the quality"


@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="the extra `peers` is not installed")
@pytest.mark.parametrize(("method", "enough"), [("path", 0.15), ("joined", 0.05)])
def test_mitsuba_agrees_with_the_gather(small: None, method: str, enough: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both get to where they are wanted, by more and more samples: so neither is biased by as much."""
    monkeypatch.setattr(judging, "SECONDS", 1000.0)
    monkeypatch.setattr(judging, "ENOUGH", enough)
    scene = irrsplat.load("curved")
    with irrsplat.Renderer(scene, size=(24, 24), bounces=1) as renderer:
        view = judging.judged_view(renderer, scene.camera())
    measure = {"path": mitsuba.measure_path, "joined": mitsuba.measure_joined}[method]
    (found,) = measure(scene, (24, 24), 1, (view, view), lambda words: None)
    off = [one.rmse for one in found.measurements]
    assert found.keeps_nothing and min(off) <= enough < max(off) / 4.0
    assert len(off) > 3 and all(one.further == one.seconds for one in found.measurements)
