"""The exposure by itself: decided by the first lit picture, calm while a view fills, and right once all light is there."""

from __future__ import annotations

import math
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast

import pytest

import irrsplat
from irrsplat.app.viewer.session import Session
from irrsplat.app.viewer.show.auto_exposure import AutoExposure
from irrsplat.gpu import context
from irrsplat.scene.model import Scene


class Meter:
    """Stands in for the pass that meters: each picture is its own reading."""

    def measure(self, image: float) -> None:
        self.image = image

    def metered(self) -> float:
        return self.image


class Bench:
    """An AutoExposure, and pictures by the stops that they need."""

    def __init__(self) -> None:
        self.exposure = AutoExposure()
        self.renderer: Any = SimpleNamespace(settings=SimpleNamespace(exposure="auto"), composite_pass=Meter())
        self._views: dict[float, Any] = {}

    def tick(self, needed: float, filling: bool = False, dt: float = 0.05) -> float:
        view = self._views.setdefault(needed, SimpleNamespace(image=needed))
        self.exposure.tick(self.renderer, cast(Any, view), dt, filling)
        return self.exposure.stops


def test_the_first_lit_picture_decides_at_once() -> None:
    """Black ones before it do not: 0 stops is what they say."""
    bench = Bench()
    assert math.isnan(bench.exposure.stops)
    assert bench.tick(0.0) == 0.0 and bench.exposure.settled
    assert bench.tick(-3.0, filling=True) == -3.0 and bench.exposure.settled


def test_while_a_view_fills_a_stop_off_is_let_be_and_then_made_good_once() -> None:
    bench = Bench()
    bench.tick(2.0, filling=True)
    for needed in (1.9, 1.5, 2.4, 1.2):
        assert [bench.tick(needed, filling=True) for _ in range(5)] == [2.0] * 5
    told = [bench.tick(1.2) for _ in range(60)]
    assert told == sorted(told, reverse=True) and told[-1] == pytest.approx(1.2, abs=0.011) and bench.exposure.settled


def test_while_a_view_fills_more_than_a_stop_is_followed_as_far_as_that() -> None:
    bench = Bench()
    bench.tick(0.5, filling=True)
    told = [bench.tick(4.0, filling=True) for _ in range(100)]
    assert told[-1] == pytest.approx(3.0, abs=0.02) and max(b - a for a, b in pairwise(told)) < 0.31


def test_nothing_leaps_and_nothing_goes_beyond_twenty_stops() -> None:
    """Six stops a second at most, whatever the picture needs; and a black view changes nothing."""
    bench = Bench()
    bench.tick(-10.0)
    told = [bench.tick(60.0) for _ in range(200)]
    steps = [b - a for a, b in pairwise(told)]
    assert max(steps) <= 6.0 * 0.05 + 1e-9 and told[-1] == pytest.approx(20.0, abs=0.011)
    assert all(bench.tick(0.0) == told[-1] for _ in range(5))


def test_a_setting_is_taken_at_once() -> None:
    bench = Bench()
    bench.tick(3.0)
    bench.renderer.settings.exposure = -2.0
    assert bench.tick(5.0) == -2.0 and bench.exposure.settled


@pytest.mark.parametrize("stops", [0.0, -13.0], ids=["cornell", "dark"])
def test_a_filling_scene_keeps_its_exposure_until_all_light_is_there(stops: float) -> None:
    """The Cornell box, and the same by a lamp 2¹³ times as dark: while it fills, the exposure moves by less than 0.05 stops a
    tick; in the end it is what the picture needs; and the dark one is 13 stops brighter."""
    scene = irrsplat.load("cornell")
    lights = tuple(_dimmed(light, 2.0**stops) for light in scene.lights)
    dimmed = Scene(scene.meshes, lights, scene.cameras, name="dark") if stops else scene
    with context.shared():
        session = Session(
            context.shared(), dimmed, (48, 48), values={"gather_size": 8, "viewer_samples": 0, "viewer_quality": 0.0}
        )
        told, filling = [], []
        for _ in range(600):
            session.tick(0.03, 0.03)
            told.append(session.exposure)
            filling.append(not session.progress[0].done)
            if session.at_rest:
                break
        assert session.at_rest
        steps = [abs(b - a) for a, b, now in zip(told, told[1:], filling[1:], strict=False) if now]
        assert max(steps) < 0.05
        needed = session.renderers[0].composite_pass.exposure(session.views[0].image)
        assert told[-1] == pytest.approx(needed, abs=0.011)
        assert told[-1] == pytest.approx(-0.4 - stops, abs=0.3)
        session.release()


def _dimmed(light: Any, factor: float) -> Any:
    from dataclasses import replace

    red, green, blue = light.color
    return replace(light, color=(red * factor, green * factor, blue * factor))
