"""What a moving view gathers first."""

from __future__ import annotations

import numpy as np

from irrsplat.indirect.flight_order import FlightOrder
from irrsplat.scene.model import Camera

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
