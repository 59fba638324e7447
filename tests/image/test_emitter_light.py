"""Emitters sampled at the pixels: Lambert's formula at every pixel, and records that hold the rest of the light."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat import InputError
from irrsplat.image.frame import Frame
from irrsplat.scene.model import Camera
from tests.support.worlds import box, floor, lamp, material, polygon_vector, quad, scene

RADIANCE = (1.0, 2.0, 3.0)  # W/(m² sr), different in each channel
DOWN = Camera((0.0, 4.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 20.0)


@pytest.mark.parametrize("gather", ["trace", "plane"])
def test_a_panel_lights_a_black_floor_as_by_lamberts_formula(gather: str) -> None:
    """A parallelogram leans over the ground, beside the view. Records of a black room hold no light, not even by chance."""
    panel = quad((0.95, 0.4, -0.4), (0.0, 0.05, 0.8), (-0.1, 0.6, 0.05), material(0.0, RADIANCE))
    world = scene(floor(6.0, 0.0, material(0.0)), panel)
    settings: Any = {"bounces": 1, "gather": gather, "gather_size": 16, "pixel_light_samples": 16}
    frame = irrsplat.render(world, (48, 48), DOWN, **settings)
    assert len(frame.records_irradiance) and not frame.records_irradiance.any() and not frame.direct.any()
    vector = polygon_vector(panel.positions.astype(float), frame.position.astype(float))
    truth = np.maximum((vector * frame.normal).sum(-1), 0.0)[..., None] * RADIANCE
    assert np.sqrt(np.mean((frame.irradiance - truth) ** 2)) / truth.mean() < 0.045
    assert frame.irradiance.mean() == pytest.approx(truth.mean(), rel=2e-3)


def test_a_change_renews_the_records_and_files_do_not_mix(tmp_path: Path) -> None:
    """A room with a panel, a table below it and a lamp: as much light with and without samples at the pixels.

    Cache files depend on whether pixels are sampled, not on the number of samples.
    """
    walls = box((-2, 0, -2), (2, 3, 2), material((0.6, 0.5, 0.4)), outward=False)
    shining = quad((-0.4, 2.9, -0.4), (0.8, 0.0, 0.0), (0.0, 0.0, 0.8), material(0.0, 20.0))
    table = box((-0.6, 0.7, -0.4), (0.6, 0.75, 0.4), material(0.5))
    room = scene(walls, shining, table, lights=(lamp((1.5, 1.0, 1.0), 2.0),))
    view = Camera((0.0, 1.6, 1.9), (0.0, 0.7, 0.0), (0.0, 1.0, 0.0), 70.0)
    file = tmp_path / "cache"
    settings: Any = {"bounces": 1, "gather": "trace", "gather_size": 8, "a": 0.9, "shadow_size": 64, "samples": 2}
    with irrsplat.Renderer(room, (32, 32), **settings) as renderer:

        def render(samples: int) -> Frame:
            renderer.change(replace(renderer.settings, pixel_light_samples=samples))
            return renderer.render(view)

        before = render(0)
        count, mean = len(before.records_irradiance), before.records_irradiance.mean()
        renderer.save_cache(file)
        apart = render(8)
        assert apart.records_irradiance[:count].mean() < 0.7 * mean
        assert apart.irradiance.mean() == pytest.approx(before.irradiance.mean(), rel=0.02)
        assert apart.indirect.mean() == pytest.approx(before.indirect.mean(), rel=0.03)
        assert np.array_equal(apart.direct, before.direct)
        with pytest.raises(InputError, match="--pixel-light-samples 0, not --pixel-light-samples 1"):
            renderer.load_cache(file)
        renderer.save_cache(file)
        renderer.change(replace(renderer.settings, pixel_light_samples=16))
        renderer.load_cache(file)
        again = render(0).records_irradiance[:count]
        assert np.allclose(again, before.records_irradiance, rtol=0.02, atol=1e-3 * mean)
