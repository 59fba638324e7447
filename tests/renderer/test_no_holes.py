"""No hole at rest: whatever changes, in ticks as they come, every pixel that sees anything has a record once nothing is gathered.

IRRSPLAT_CHANGES: how many random changes are tried (12).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.gpu.target import pixels
from irrsplat.gpu.time_budget import Pace
from irrsplat.image.view import Progress, View
from irrsplat.indirect import splat_buffer
from irrsplat.indirect.scheduler import RecordScheduler, RoundResult
from irrsplat.indirect.view_state import ViewState
from irrsplat.scene.model import Camera
from tests.renderer.test_move import shift
from tests.renderer.test_renderer import FAST, FRONT, room
from tests.support.worlds import lamp

CHANGES = int(os.environ.get("IRRSPLAT_CHANGES", "12"))
MOST = 1500  # records, above which they are forgotten, so that the changes stay quick
SIZES = (96, 64), (80, 72), (128, 48)
SETTINGS: tuple[tuple[str, tuple[Any, ...]], ...] = (
    ("a", (0.4, 0.6, 0.9)),
    ("adapt", (0.0, 0.2, 0.4)),
    ("bounces", (0, 1, 2)),
    ("coarse", (False, True)),
    ("gather_size", (8, 12)),
    ("gather", ("raster", "trace")),
    ("gradients", (False, True)),
    ("kernel", ("cut", "smooth")),
    ("in_front", (False, True)),
    ("neighbours", (False, True)),
    ("radius", ("harmonic", "hessian")),
    ("radius_max", (7.0, 25.0)),
    ("radius_min", (0.5, 3.0)),
    ("second_order", (False, True)),
    ("shadow_size", (32, 64)),
    ("spread", (0.0, 0.3)),
    ("walls", (False, True)),
)


def holes(view: View) -> int:
    """How many pixels see a surface, and have no record."""
    seen = pixels(view.gbuffer.position)[..., 3] > 0.0
    return int(np.count_nonzero(seen & (pixels(view.splats.weight)[..., 0] <= 0.0)))


def rest(renderer: Renderer, camera: Camera | None, seconds: float | None, most: int = 4000) -> tuple[View, list[Progress]]:
    """Ticks until nothing is gathered any more."""
    told: list[Progress] = []
    while not (told and told[-1].still):
        assert len(told) < most, f"no rest: {told[-1]}"
        view, progress = renderer.frame(camera, seconds)
        told.append(progress)
    return view, told


def test_rounds_while_records_are_stale_are_no_reason_to_give_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """A lamp moves, and its records are gathered again a few at a time, in more ticks than there are rounds without gain before a
    view is given up: pixels that they leave to nobody are served nevertheless."""
    with Renderer(room(), (96, 64), **FAST) as renderer:
        renderer.render()
        renderer.relight([lamp((-0.8, -0.6, 0.7), 5.0)])
        monkeypatch.setattr(
            Pace, "batches", lambda self, wanted, capacity, budget, rays=0: iter([min(wanted, 4)] if wanted else [])
        )
        view, told = rest(renderer, None, 1e-4)
        assert sum(p.renewed > 0 for p in told) > 50
        before = renderer.cache.count
        assert holes(view) == 0 and told[-1].coverage == 1.0 and told[-1].done
        renderer.forget(records=False)  # which looks at the view again
        assert rest(renderer, None, 1e-4)[1][-1].records == before


def test_a_view_is_not_given_up_while_its_holes_become_fewer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rounds that serve pixels without a record count as gain, even if as many others ask because their records disagree."""
    left = iter(range(30, 0, -1))

    def ask(self: object, state: ViewState, *_: object) -> tuple[ViewState, RoundResult]:
        return replace(state, missing=0.01, holes=next(left, 1)), RoundResult(1, True)

    with Renderer(room(), (96, 64), **FAST) as renderer:
        renderer.frame()
        monkeypatch.setattr(RecordScheduler, "_ask", ask)
        told = [renderer.frame()[1] for _ in range(60)]
        assert next(left, None) is None and 30 < sum(p.new for p in told) < 50 and told[-1].still and not told[-1].done


class Fuzz:
    """A renderer, and a change of it drawn at random."""

    def __init__(self, renderer: Renderer, draw: np.random.Generator) -> None:
        self.renderer, self.draw = renderer, draw
        self.camera = FRONT

    def __call__(self) -> str:
        """Make a change; what it was."""
        acts: tuple[Callable[[], object], ...]
        acts = self.light, self.light, self.light, self.move, self.move, self.settings, self.look, self.resize
        if self.renderer.cache.count > MOST:
            self.renderer.forget()
        act = acts[self.draw.integers(len(acts))]
        return f"{act.__name__} {act()}"

    def light(self) -> object:
        """Another place, power and colour of one lamp, or two of them."""
        made = []
        for _ in range(self.draw.choice([1, 1, 2])):
            power = 3.0 * 10.0 ** self.draw.uniform(-1.5, 0.5)
            one = lamp(tuple(self.draw.uniform(-0.8, 0.8, 3)), power)
            tint = self.draw.uniform(0.0, 1.0, 3) ** self.draw.choice([0.0, 1.0])
            made.append(replace(one, color=tuple(float(c) for c in power * tint)))
        self.renderer.relight(made)
        return [(x.position, x.color) for x in made]

    def move(self) -> object:
        where = self.draw.uniform((-0.4, 0.0, -0.2), (0.6, 0.8, 0.5))
        self.renderer.move(1, shift(*where))
        return where

    def settings(self) -> object:
        name, values = SETTINGS[self.draw.integers(len(SETTINGS))]
        value = values[self.draw.integers(len(values))]
        self.renderer.change(replace(self.renderer.settings, **{name: value}))
        return name, value

    def look(self) -> object:
        eye = np.array((0.0, 0.0, 0.6)) + self.draw.uniform(-0.3, 0.3, 3)
        target = np.array((0.0, 0.0, -0.5)) + self.draw.uniform(-0.9, 0.9, 3)
        self.camera = replace(FRONT, eye=tuple(map(float, eye)), target=tuple(map(float, target)))
        return self.camera

    def resize(self) -> object:
        size = SIZES[self.draw.integers(len(SIZES))]
        self.renderer.resize(size)
        return size


def test_no_hole_at_rest_after_any_change(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(splat_buffer, "_LEAST_HEIGHT", 60)  # of such small views every other pixel is splatted first, too
    draw, done = np.random.default_rng(7), []
    with Renderer(room(), SIZES[0], **FAST) as renderer:
        fuzz = Fuzz(renderer, draw)
        rest(renderer, FRONT, 0.02)
        for number in range(CHANGES):
            for _ in range(draw.choice([1, 1, 1, 2])):  # a second one before the view rests
                done.append(f"{number}: {fuzz()}")
                renderer.frame(fuzz.camera, 0.002)
            view, told = rest(renderer, fuzz.camera, draw.choice([0.01, 0.05]))
            if renderer.settings.most_bounces:
                assert holes(view) == 0, (told[-1], renderer.settings, done[-3:])
