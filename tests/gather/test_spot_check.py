"""Spot check of dark places between records: renders, tiles and frame budgets converge to equal light."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat.indirect.gathering.record_gatherer import RecordGatherer
from irrsplat.scene.model import Camera
from tests.support import worlds

SIZE = (44, 33)
CAMERA = Camera((0.0, 0.5, 1.0), (0.0, 0.0, 0.0), fov=24.0)
# Records reach far, and a gather is large enough for a spot check, which adds two of them
SETTINGS: Any = {"bounces": 1, "gather": "trace", "gather_size": 64, "a": 1.0, "adapt": 0.0}


def test_dark_places_are_found_in_renders_tiles_and_ticks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between two black boards as high as their distance, the table has a quarter of the open sky's light.

    E midway between two endless boards of height h and distance d is π·L/√(1 + (2h/d)²).
    """
    black = worlds.material(0.0)
    boards = [worlds.box((x, 0.0, -0.1), (x + 0.004, 0.05, 0.1), black) for x in (0.0, 0.03)]
    scene = worlds.scene(worlds.floor(1.0), *boards, sky=1.0, camera=CAMERA)
    whole = irrsplat.render(scene, SIZE, **SETTINGS)
    with irrsplat.Renderer(scene, SIZE, tile_size=24, **SETTINGS) as renderer:
        assert np.array_equal(renderer.render().irradiance, whole.irradiance)
    with irrsplat.Renderer(scene, SIZE, **SETTINGS) as renderer:
        while not renderer.frame(CAMERA, seconds=0.02)[1].done:
            pass
        ticks = renderer.render().irradiance
    gather, sizes, last = RecordGatherer.gather, list[int](), 0

    def interrupted(*args: Any, **probes: Any) -> int:
        sizes.extend([] if probes else [len(args[1])])
        if len(sizes) == last and not probes:
            raise KeyboardInterrupt
        return gather(*args, **probes)

    monkeypatch.setattr(RecordGatherer, "gather", interrupted)
    irrsplat.render(scene, SIZE, **SETTINGS)
    last = 2 * len(sizes)  # the gather at the places that the check has found is the last one
    with irrsplat.Renderer(scene, SIZE, **SETTINGS) as renderer:
        assert renderer.render().stats["interrupted"] and renderer.render().stats["records"] == whole.stats["records"]
    p = whole.position
    between = (p[..., 1] == 0.0) & (np.abs(p[..., 2]) < 0.07) & (p[..., 0] > 0.006) & (p[..., 0] < 0.028)
    assert between.sum() > 5
    for irradiance in (whole.irradiance, ticks):
        assert np.median(irradiance[between]) < 0.3 * np.pi  # the formula: 0.25


def test_noise_adds_no_records() -> None:
    """A probe hits a source of 2e-4 of the hemisphere by chance: its luminance is a multiple of the record's, or 0."""
    source = worlds.quad((-0.02, 1.0, -0.02), (0.04, 0, 0), (0, 0, 0.04), worlds.material(0.0, 100.0))
    scene = worlds.scene(worlds.floor(1.0), source, camera=CAMERA)
    noisy: Any = {"bounces": 1, "gather": "trace", "light_samples": 0, "adapt": 0.0}
    checked, unchecked = (irrsplat.render(scene, SIZE, **noisy, spread=spread).stats["records"] for spread in (0.05, 0.0))
    assert checked < 1.5 * unchecked  # each false difference adds one: without a limit of noise, four times as many


def test_the_foot_of_a_ledge_is_dark() -> None:
    """At distance d from a black ledge of height h, E is π·L·(1 + d/√(d² + h²))/2, and changes within three pixels.

    Records away from the ledge agree. Interpolated between them alone, the first two pixels have an error of 10 %.
    """
    height = 0.01
    ledge = worlds.box((-0.1, 0.0, -5.0), (0.0, height, 5.0), worlds.material(0.0))
    camera = Camera((0.1, 1.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.0, -1.0), 37.0)
    scene = worlds.scene(worlds.floor(5.0), ledge, sky=1.0, camera=camera)
    frame = irrsplat.render(scene, (240, 180), bounces=1, gather="trace")
    x = frame.position[..., 0].astype(float)
    foot = (frame.position[..., 1] == 0.0) & (x > 0.0) & (x < 0.008)
    error = frame.irradiance[..., 0] / (np.pi * (1.0 + x / np.hypot(x, height)) / 2.0) - 1.0
    assert np.sqrt((error[foot] ** 2).mean()) < 0.07


def test_short_thin_shadows_are_found_whole() -> None:
    """Rods of 6 pixels by 1 cast hard shadows. Records around them agree, and the first probes test every fourth pixel alone.

    In the umbra E is 0. Without probes around the first errors, a tenth of the umbra shows the light around it.
    """
    x, z = (of.ravel() for of in np.meshgrid(np.arange(-0.08, 0.09, 0.04), np.arange(-0.08, 0.09, 0.04)))
    z = z + 0.5 * x**2  # at various places within pixels
    black, source = worlds.material(0.0), worlds.quad((-0.005, 1, -0.005), (0.01, 0, 0), (0, 0, 0.01), worlds.material(0.0, 1e3))
    rods = [worlds.box((a - 0.006, 0.03, b - 0.001), (a + 0.006, 0.032, b + 0.001), black) for a, b in zip(x, z, strict=True)]
    camera = Camera((0.06, 0.8, 0.5), (0.0, 0.0, 0.0), fov=25.0)
    frame = irrsplat.render(worlds.scene(worlds.floor(1.0), *rods, source, camera=camera), (200, 240), bounces=1, gather="trace")
    p, enlarged = frame.position, 1.0 / 0.97  # a shadow is larger than its rod by this factor
    dx, dz = (np.abs(p[..., k, None] - enlarged * at) for k, at in ((0, x), (2, z)))
    umbra = (p[..., 1] == 0.0) & ((dx < 0.0058) & (dz < 0.0007)).any(-1)
    assert umbra.sum() > 50 and frame.irradiance[umbra].mean() < 0.05 * frame.irradiance[p[..., 1] == 0.0].mean()
