"""`irrsplat bench --peers`: export to Radiance, the ratios of the table, and short comparisons with installed programs."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.app.bench import cases, gather_truth
from irrsplat.app.bench.peers import cycles, judging, ours, race, radiance
from irrsplat.app.bench.peers.judging import Measurement, Series
from irrsplat.reference import fine_gather, timed_levels
from irrsplat.scene.model import Scene

needs_radiance = pytest.mark.skipif(radiance.installed() is None, reason="the extra `peers` is not installed")


def measurements(system: str, *found: tuple[float, float]) -> tuple[Measurement, ...]:
    """Return measurements with these seconds and errors; a further view takes a tenth of each time."""
    return tuple(Measurement(system, "q", seconds, rmse, seconds / 10.0, rmse) for seconds, rmse in found)


# ---- export to Radiance --------------------------------------------------------------------------------------------------


def words(scene: Scene) -> list[list[str]]:
    return [line.split() for line in radiance.text(scene).splitlines() if line]


def test_export_of_a_scene_to_radiance() -> None:
    """Materials are Lambertian, meshes are files, and a point light is an invisible sphere of intensity I = L·π·r²."""
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
    intensity = np.array([float(x) for x in bulb[7:]]) * np.pi * radiance.BULB**2
    assert intensity == pytest.approx(scene.lights[0].color)
    assert [float(x) for x in sphere[6:]] == pytest.approx([*scene.lights[0].position, radiance.BULB])


# ---- ratios of times -----------------------------------------------------------------------------------------------------


def test_the_verdict_is_a_ratio_to_the_time_of_irrsplat() -> None:
    """`slow` takes 30 s for the error that irrsplat reaches in 2 s: 15 times. Noise falls with 1/√samples: (0.1/0.05)² · 1 s."""
    found = [
        Series(measurements("irrsplat", (2.0, 0.04)), "as it is"),
        Series(measurements("slow", (1.0, 0.2), (30.0, 0.05)), "after 1 s"),
        Series(measurements("never", (1.0, 0.3)), ""),
        Series(measurements("noise", (1.0, 0.1)), "", keeps_nothing=True),
        Series((), "absent: not installed"),
    ]
    first, fine, further = race.verdict(found)
    assert "irrsplat 2.000 s; slow 30.00 s, 15.0 times as long; never does not get there (30.0% at best)" in first
    assert "noise by 1/√samples some 4.00 s, 2.0 times as long" in first and "absent" not in first
    assert "irrsplat 0.200 s; slow 3.00 s, 15.0 times as long" in further
    assert "irrsplat does not get there (4.0% at best)" in fine
    told = list(race.report("cornell", found))
    assert "absent: not installed" in told and "slow: after 1 s" in told


def test_a_plot_has_a_line_for_each_system() -> None:
    pytest.importorskip("matplotlib")
    drawn = race.plot("cornell", [Series(measurements("a", (1.0, 0.2), (30.0, 0.05)), "", (200, 0, 0))])
    assert drawn.shape[2] == 3 and (np.abs(drawn - [200 / 255, 0, 0]).max(-1) < 0.05).any()


# ---- short comparisons ---------------------------------------------------------------------------------------------------


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Limit irrsplat to two settings and Radiance to one, with small references in a folder of the test."""
    monkeypatch.setenv("IRRSPLAT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(cases, "REPETITIONS", 1)
    monkeypatch.setattr(fine_gather, "SIDE", 64)
    monkeypatch.setattr(gather_truth, "COUNT", 150)
    monkeypatch.setattr(ours, "A", (0.6, 0.4))
    monkeypatch.setattr(radiance, "QUALITIES", ((0.2, 512, 128),))


@pytest.mark.skipif(find_spec("pyoidn") is None, reason="the extra `peers` is not installed")
@pytest.mark.long
def test_open_image_denoise_removes_the_noise_of_a_plane() -> None:
    """Pixels have independent noise of 30 %: a filter over hundreds of pixels leaves less than a fourth of the noise."""
    mask = np.ones((64, 96), bool)
    mask[:9] = False
    E = np.random.default_rng(0).normal(2.0, 0.6, (mask.sum(), 3))
    for quality in ("fast", "high"):
        found = timed_levels.denoised(mask, np.broadcast_to([0.0, 0.0, 1.0], E.shape), quality, E)
        assert found.shape == E.shape and np.sqrt(np.mean((found - 2.0) ** 2)) < 0.15


@needs_radiance
@pytest.mark.long
def test_radiance_agrees_with_the_gather(tmp_path: Path, small: None) -> None:
    """One-bounce indirect irradiance is equal within the noise of Radiance's rays; its ambient file repeats the result."""
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
    (tmp_path / "ambient").unlink()
    rough, _ = it.irradiance(view.position, view.normal, 1, (0.5, 16, 0))
    assert view.error(rough - direct) > view.error(first - direct), "the error falls with the quality"


@pytest.mark.skipif(find_spec("bpy") is None or find_spec("mitsuba") is None, reason="Blender or Mitsuba is not installed")
@pytest.mark.long
def test_cycles_agrees_with_path_tracing(small: None) -> None:
    """Two spots light a room. With more samples and a filter, Cycles comes closer to the reference of the path tracer."""
    scene = irrsplat.load("door")
    with irrsplat.Renderer(scene, size=(48, 48)) as renderer:
        view = judging.judged_view(renderer, scene.camera())
    _, fast, high = cycles.measure(scene, (48, 48), "all", [view, view], lambda words: None)
    assert fast.measurements[0].rmse > fast.measurements[-1].rmse < 0.2
    assert high.measurements[-1].rmse < 0.2
