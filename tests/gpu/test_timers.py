"""Times of stages, by the clock and by OpenGL's own timers."""

from __future__ import annotations

import time

import moderngl
import pytest

from irrsplat.gpu.target import Target
from irrsplat.gpu.timers import Timers


@pytest.mark.parametrize("software", [True, False])
def test_a_stage_within_another_counts_alone(ctx: moderngl.Context, software: bool) -> None:
    """OpenGL runs one timer at a time: a second one begun within it is an error, and the frame it belonged to would be lost."""
    timers, target = Timers(ctx, software, enabled=True), Target(ctx, (512, 512), (4,))
    for _ in range(2):
        with timers("outer"):
            target.clear()
            with timers("inner"), timers("outer"):
                target.clear()
            with timers("inner"):
                target.clear()
                assert next(iter(timers.milliseconds())) == "outer", "what has ended is told in the middle, too"
        with timers("after"):
            target.clear()
    assert ctx.error == "GL_NO_ERROR"
    told = timers.milliseconds()
    assert list(told) == ["outer", "inner", "after"] and all(ms >= 0.0 for ms in told.values())
    timers.clear()
    assert timers.milliseconds() == {}
    target.release()


def test_what_a_stage_within_takes_is_not_in_the_outer_one(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr(time, "perf_counter", lambda: now)
    timers = Timers(ctx, software=True, enabled=True)
    with timers("outer"):
        now += 1.0
        with timers("inner"):
            now += 5.0
        now += 2.0
    now += 10.0  # belongs to none
    assert timers.milliseconds() == {"outer": 3000.0, "inner": 5000.0}


def test_a_stage_that_fails_ends(ctx: moderngl.Context) -> None:
    timers = Timers(ctx, software=False, enabled=True)
    with pytest.raises(KeyError), timers("outer"), timers("inner"):
        raise KeyError
    with timers("after"):
        pass
    assert ctx.error == "GL_NO_ERROR" and set(timers.milliseconds()) == {"outer", "inner", "after"}
