"""Merged caches match one cache in path-traced error; pruning removes records covered by others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat import Renderer
from irrsplat.records import cache_file
from irrsplat.records.cache_file import CacheState
from irrsplat.records.merge import merge, prune
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings, preset
from tests.renderer.test_renderer import FAST, room
from tests.support.truth import SIZE, load_reference

MADE: dict[str, Any] = {"bounces": 1, "gather_size": 24}
SIDE = (80, 80)
AWAY = ((2.78, 2.73, -8.0), (4.5, 1.6, -1.9), (0.9, 3.4, -1.1), (1.7, 2.4, -3.6))  # from the flight of bundled cornell


@dataclass(frozen=True)
class Flights:
    """Caches of a flight through cornell: filled at once, and its two halves."""

    whole: CacheState
    halves: tuple[CacheState, CacheState]


def filled(cameras: Sequence[Camera]) -> CacheState:
    with Renderer(irrsplat.load("cornell"), SIDE, **MADE) as renderer:
        for camera in cameras:
            renderer.converge(camera)
        return renderer.scheduler.state()


@pytest.fixture(scope="module")
def flights() -> Flights:
    own = irrsplat.load("cornell").camera()
    cameras = [replace(own, eye=eye, target=(2.78, 2.0, 3.0) if i else own.target) for i, eye in enumerate(AWAY)]
    return Flights(filled(cameras), (filled(cameras[:2]), filled(cameras[2:])))


def error(state: CacheState, path: Path) -> float:
    """Return the relative RMSE of the reference's view with these records alone, against the path tracer.

    A hundredth of the pixels, those of the greatest errors, does not count: one pixel at an edge decides a third of the sum.
    """
    scene, truth = irrsplat.load("cornell"), load_reference("cornell")
    cache_file.write(path, cache_file.key(scene, preset(**MADE)), state)
    with Renderer(scene, (SIZE, SIZE), **MADE) as renderer:
        renderer.load_cache(path)
        E = renderer.render(gather=False, buffers=["irradiance"]).irradiance[tuple(truth.pixels.T)]
    E_ref = truth.irradiance
    squares = np.sort(((E - E_ref) ** 2).mean(-1))
    return float(np.sqrt(squares[: int(0.99 * len(squares))].mean()) / E_ref.mean())


def test_halves_of_a_flight_merged_are_the_flight_at_once(flights: Flights, tmp_path: Path) -> None:
    """Merged halves are within 0.2 % of the whole's error, as two seeds are, with at most 1.15 times its records.

    The halves have a fifth more records, so that merging has an effect.
    """
    count = len(flights.whole.records["id"])
    merged = merge(flights.halves, Settings().with_values(flights.halves[0].settings))
    both = sum(len(half.records["id"]) for half in flights.halves)
    assert both > 1.2 * count and len(merged.records["id"]) <= 1.15 * count
    once, apart = (error(state, tmp_path / "a.cache") for state in (flights.whole, merged))
    assert abs(apart - once) <= 0.002


def test_a_cache_merged_with_itself_is_itself(flights: Flights) -> None:
    half = flights.halves[0]
    done = merge([half, half, half], preset(**MADE))
    assert len(done.records["id"]) == len(half.records["id"])
    for name in ("position", "irradiance", "gradient", "normal", "triangle", "frame_rotation"):
        assert np.array_equal(done.records[name], half.records[name])
    ids = done.records["id"]
    assert (np.diff(ids) > 0).all() and done.records["clocks"][2] > ids[-1]


def test_pruning_leaves_what_is_of_use(flights: Flights, tmp_path: Path) -> None:
    """Compare half of the records at random with pruning to half: pruning leaves fewer under-covered pixels."""
    whole, settings = flights.whole, preset(**MADE)
    count = len(whole.records["id"])
    done = prune(whole, settings, count // 2)
    assert len(done.records["id"]) == count // 2
    chance = np.sort(np.random.default_rng(2).choice(count, count // 2, replace=False))
    scene, path = irrsplat.load("cornell"), tmp_path / "a.cache"
    missing = []
    for state in (done, cache_file.selected(whole, chance)):
        cache_file.write(path, cache_file.key(scene, settings), state)
        with Renderer(scene, SIDE, **MADE) as renderer:
            renderer.load_cache(path)
            missing.append(1.0 - renderer.coverage())
    assert missing[0] < 0.7 * missing[1]
    left = [len(prune(whole, settings, most).records["id"]) for most in (None, count)]
    assert left[0] > count - count // 2 and left[1] == count


def test_what_goes_depends_on_the_weights_by_the_settings() -> None:
    """With another `a`, or with the paper's weights, other records are removed; their number is equal in each case."""
    with Renderer(room(), (40, 30), **FAST) as renderer:
        renderer.render()
        state, settings = renderer.scheduler.state(), renderer.settings
    count = len(state.records["id"])
    kept = []
    for change in ({}, {"a": 0.9}, {"weights": "paper"}):
        done = prune(state, replace(settings, **change), count // 2)
        assert len(done.records["id"]) == count // 2
        kept.append(tuple(done.records["id"]))
    assert len(set(kept)) == 3
