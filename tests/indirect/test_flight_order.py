"""What a moving view gathers first."""

from __future__ import annotations

import numpy as np
import pytest

import irrsplat
from irrsplat.indirect import scheduler
from irrsplat.indirect.flight_order import FlightOrder
from irrsplat.scene.model import Camera
from tests.renderer.test_renderer import FAST, SIZE, room

LINE = np.stack([np.linspace(-0.9, 0.9, 19), np.zeros(19), np.full(19, -2.0)], 1)  # across a view along -z, left to right


def looking(right: float) -> Camera:
    return Camera((0.0, 0.0, 0.0), (right, 0.0, -1.0), fov=60.0)


def test_what_is_soon_out_of_sight_comes_last() -> None:
    order = FlightOrder()
    assert order(LINE, looking(0.0), (100, 100)).tolist() == list(range(19)), "no flight yet"
    assert order(LINE, looking(0.0), (100, 100)).tolist() == list(range(19)), "at rest"
    turning = order(LINE, looking(0.1), (100, 100)).tolist()  # to the right, with what is on the left about to leave
    late = turning[turning.index(18) + 1 :]
    assert 3 < len(late) < 12 and late == list(range(len(late))), "the leftmost, in the order in which they came"
    ahead = Camera((0.0, 0.0, -0.2), (0.1, 0.0, -1.2), fov=60.0)
    assert order(LINE, ahead, (100, 100))[0] != 0, "flying ahead, what is at the rim leaves"


def test_a_frame_that_asks_for_nothing_is_part_of_the_flight() -> None:
    order, beside = FlightOrder(), FlightOrder()
    for camera in (looking(0.0), looking(0.05)):
        beside(LINE, camera, (100, 100))
    order(LINE, looking(0.0), (100, 100))
    assert order(LINE[:0], looking(0.05), (100, 100)).shape == (0,)
    assert order(LINE, looking(0.1), (100, 100)).tolist() == beside(LINE, looking(0.1), (100, 100)).tolist()


def test_where_nothing_asks_nothing_is_prepared(monkeypatch) -> None:
    """A view that holds all its records, seen again: its examination alone says so."""
    with irrsplat.Renderer(room(), SIZE, **FAST) as renderer:
        renderer.converge()
        gatherer = renderer.scheduler.gatherer
        monkeypatch.setattr(gatherer, "resume", lambda *_: pytest.fail("nothing is to be gathered"))
        monkeypatch.setattr(gatherer, "gather", lambda *_: pytest.fail("nothing is to be gathered"))
        renderer.forget(records=False)
        _, progress = renderer.frame()
        assert progress.new == 0 and progress.coverage == 1.0


def test_a_flight_gathers_in_this_order(monkeypatch) -> None:
    """Ticks with a budget ask for the order by their camera; a whole round has no need of it."""
    asked: list[Camera] = []

    class Watched(FlightOrder):
        def __call__(self, position: np.ndarray, camera: Camera, size: tuple[int, int]) -> np.ndarray:
            asked.append(camera)
            return super().__call__(position, camera, size)

    monkeypatch.setattr(scheduler, "FlightOrder", Watched)
    with irrsplat.Renderer(room(), SIZE, **FAST) as renderer:
        renderer.frame()
        assert not asked
        renderer.forget()
        renderer.frame(seconds=0.05)
        assert asked == [renderer.scene.camera()]
