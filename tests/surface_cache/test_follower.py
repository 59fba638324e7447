"""The surface cache while lamps and meshes move: its values against those that are made anew."""

from __future__ import annotations

import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.core.clock import RayClock, use_clock
from irrsplat.scene.model import Scene
from irrsplat.surface_cache.cache import SurfaceCache
from tests.renderer.test_renderer import FAST, FRONT, SIZE, room
from tests.support.worlds import box, lamp, material, quad, scene

TICK = 0.05  # seconds, of 10⁶ rays each


def surface_of(renderer: Renderer) -> SurfaceCache:
    """The renderer's surface cache, which has values."""
    found = renderer.scheduler.gatherer.surface
    assert found is not None and found.result is not None
    return found


def lit(emission: float, height: float) -> Scene:
    """A closed room of 2 m with a lamp so far up in it; a wall may shine."""
    walls = box((-1, -1, -1), (1, 1, 1), material(0.6), outward=False)
    left = quad((-0.99, -1, -1), (0, 0, 2), (0, 2, 0), material(0.5, emission))
    things = box((-0.4, -1, -0.6), (0.2, -0.3, 0.0), material(0.7))
    return scene(walls, left, things, lights=(lamp((0.1, height, 0.1)),), camera=FRONT)


@pytest.mark.parametrize("emission", [0.0, 1.0])
def test_light_at_sites_follows_a_carried_lamp(emission: float) -> None:
    """From under the ceiling, where it lights a bright spot, to the middle: what rays found of that spot goes with the lamp, and
    what they found of a wall that shines stays."""
    heights = [*np.linspace(0.9, 0.0, 8), 1e-3, 2e-3, 3e-3]
    with use_clock(RayClock(1e6)), Renderer(lit(emission, 0.97), SIZE, **{**FAST, "bounces": "all"}) as renderer:
        renderer.render()
        for height in heights:
            renderer.relight([lamp((0.1, float(height), 0.1))])
            renderer.frame(seconds=TICK)
        surface = surface_of(renderer)
        assert surface.following and surface.layout is not None and surface.result is not None
        followed, area = surface.result.irradiance, surface.layout.area
        renderer.render()
        assert surface.complete and surface.result.irradiance.shape == followed.shape
        true = surface.result.irradiance
    mean = area @ true[:, 0] / area.sum()
    difference = (followed - true)[:, 0] / mean
    off, bias = np.sqrt(area @ difference**2 / area.sum()), area @ difference / area.sum()
    assert off < 0.08 and abs(bias) < 0.065


def test_sites_around_which_most_has_moved_are_gathered_first() -> None:
    """After a box has gone a step, ticks gather sites near it, until none is left."""
    with use_clock(RayClock(1e6)), Renderer(room(), SIZE, **{**FAST, "bounces": "all"}) as renderer:
        renderer.render()
        renderer.move(1, np.array([[1.0, 0, 0, 0.1], [0, 1.0, 0, 0], [0, 0, 1.0, 0.05]]))
        records = surface_of(renderer).records
        assert records is not None
        due = records.due.copy()
        renderer.frame(seconds=TICK)
        gathered = (records.due == 0.0) & (due > 0.0)
        assert gathered.any() and due[gathered].min() >= np.sort(due)[-gathered.sum()] > 0.0
