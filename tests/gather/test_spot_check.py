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
