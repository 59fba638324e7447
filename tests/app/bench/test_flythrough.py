"""Flights: out and back gathers nothing the second time, a loop costs no accuracy, and the benchmark's flight tells the truth."""

from __future__ import annotations

import numpy as np
import pytest

import irrsplat
from irrsplat.app.bench import fly_through
from irrsplat.scene.camera_path import load_path
from irrsplat.scene.model import Camera
from tests.renderer.test_live import ticks
from tests.renderer.test_renderer import FAST, SIZE, room
from tests.support.renders import rendered
from tests.support.truth import SIZE as FULL
from tests.support.truth import compare, load_reference

OUT = [Camera((0.05 * i, 0.02 * i, 0.95), (0.2 * i - 0.5, -0.1 * i, -1.0), fov=60.0) for i in range(6)]


@pytest.mark.parametrize("seconds", [None, 1e-4])
def test_out_and_back_gathers_next_to_nothing_the_second_time(seconds: float | None) -> None:
    """On the way out each view is served whole; on the way back a few pixels ask, since records on the way have told older ones
    that these reached too far (of four seeds at most three; a view from nothing takes 280); in one tick as in whole rounds."""
    with irrsplat.Renderer(room(), SIZE, **FAST) as renderer:
        counts = [ticks(renderer, seconds, camera)[-1].records for camera in OUT]
        assert counts == sorted(counts) and counts[-1] > 1.2 * counts[0], "there was something new on the way"
        for camera in OUT[::-1]:
            _, progress = renderer.frame(camera, seconds)
            assert progress.new <= 6 and progress.coverage > 0.996
        assert renderer.cache.count < 1.015 * counts[-1]


@pytest.mark.long
def test_a_loop_costs_no_accuracy() -> None:
    """After a flight about the scene the error at the first camera is at most 1.1 times a fresh render's."""
    scene, reference = irrsplat.load("cornell"), load_reference("cornell")
    first = scene.camera()
    path = load_path(fly_through.File(scene.path).parent / "flight.path", first.fov)
    cameras = [path.camera(t) for t in np.linspace(0, path.frames - 1, 6)]
    fresh = compare(rendered("cornell", bounces=1), reference)["rmse"]
    with irrsplat.Renderer(scene, (FULL, FULL), bounces=1) as renderer:
        for camera in cameras:
            renderer.converge(camera)
        assert compare(renderer.render(first), reference)["rmse"] <= 1.1 * fresh


def test_the_route_is_the_scene_s_own_or_made_for_it() -> None:
    own, made = fly_through.route(irrsplat.load("cornell")), fly_through.route(irrsplat.load("door"))
    assert own.frames == 90 and made.frames == fly_through.FRAMES
    camera = irrsplat.load("door").camera()
    assert made.camera(0) == made.camera(made.frames - 1)
    assert np.allclose(made.camera(0).eye, camera.eye) and np.allclose(made.camera(0).axes, camera.axes, atol=1e-6)


def test_the_flight_fills_the_cache_and_finds_it_full() -> None:
    """Every frame is timed; what the first flight leaves out is gathered before the second, which adds next to nothing."""
    filling, warm = fly_through.fly(irrsplat.load("cornell"), (48, 36), frames=12)
    assert (filling.case, warm.case) == ("filling", "warm")
    assert filling.new > 0 and warm.new <= 0.01 * warm.records and warm.records >= filling.records == filling.new
    for flown in (filling, warm):
        assert flown.ms.shape == (12,) and 0.0 < flown.median <= flown.worst and flown.first > 0.0
        assert {"gbuffer", "splat", "display", "interface"} <= set(flown.stages)
        assert sum(flown.stages.values()) <= 1.05 * flown.ms.mean(), "the stages are parts of the frame"
