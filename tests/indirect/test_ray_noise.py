"""Records in uniform light use a quarter of their rays, with unchanged light."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat.indirect.gathering import record_gatherer
from irrsplat.renderer import Renderer


def test_even_light_takes_fewer_rays(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a tolerance of 4 % some records take 16² of 32² rays; the mean irradiance changes by at most 1 %."""
    scene, counts, means = irrsplat.load("curved"), [], []
    settings: Any = {"bounces": 1, "gather": "trace", "gather_size": 32, "shadow_size": 256}
    for near_exact in (0, 128):
        monkeypatch.setattr(record_gatherer, "_NEAR_EXACT", near_exact)
        with Renderer(scene, (60, 45), **settings) as renderer:
            means.append(renderer.render().irradiance.mean())
            counts.append(np.count_nonzero(renderer.cache.column("gather_size") == 16))
    assert counts[0] == 0 and counts[1] > 20
    assert means[1] == pytest.approx(means[0], rel=0.01)
