"""Views while the camera moves: smaller pictures where a whole one takes longer than a tick, by the same records."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import moderngl

from irrsplat.core.timing.clock import now
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.time_budget import Budget
from irrsplat.image.view import Progress, View
from irrsplat.renderer.stages import Stages
from irrsplat.renderer.state import Round, State
from irrsplat.scene.model import Camera

_MOST = 4  # the largest divisor of width and height
_DRAWN = 0.8  # greatest share of a tick for drawing; the gather has the remaining time
_MARGIN = 0.7  # of that share: a larger picture is drawn only if its expected time is less


class MovingViews(Owner):
    """Draws views of a moving camera in width and height divided by a number, which follows the time that pictures take.

    stages: of the smaller pictures. rounds: Frames.round. Requests are measured in shares of the picture: views of any size place
    records alike.
    """

    def __init__(self, stages: Stages, rounds: Callable[..., tuple[State, Round]]) -> None:
        self.stages, self.rounds = self.own(stages), rounds
        self._divisor, self._size = 1, (0, 0)  # of the last view
        self._splat = self._picture = 0.0  # seconds of its splats and its picture

    def divisor(self, state: State) -> int:
        """Return the divisor of the next view's width and height. The paper's scan examines whole pictures alone."""
        return self._divisor if state.settings.placement != "scan" else 1

    def size(self, state: State) -> tuple[int, int]:
        """Return width and height of the next view."""
        width, height = (max(1, -(-side // self.divisor(state))) for side in state.size)
        return width, height

    def note(self, took: float, seconds: float) -> None:
        """Note that a whole view of another camera took so many seconds to draw, in a tick of `seconds`."""
        self._divisor = max(self._divisor, divisor_after(1, took, seconds))

    def __call__(self, state: State, camera: Camera, budget: Budget, gather: bool) -> tuple[View, Progress]:
        """Return the smaller view of a round, and how far it has come. The state of the whole view stays as it is."""
        start, divisor = now(), self._divisor
        small = replace(state, size=self.size(state), shown=None, splat_seconds=self._splat, picture_seconds=self._picture)
        self.stages.draw_gbuffer(small, camera)
        self.stages.ctx.finish()
        seen = now() - start
        small, done = self.rounds(small, camera, budget, gather, stages=self.stages)
        start = now()
        view = self.stages.draw_picture(small, done, state.settings.placement != "scan", moving=True)
        self.stages.ctx.finish()
        for texture in (view.image, view.alpha):
            texture.filter = moderngl.LINEAR, moderngl.LINEAR  # a larger target interpolates the picture
        self._splat, self._picture = small.splat_seconds, now() - start
        known, self._size = self._size == small.size, small.size
        if budget.seconds is not None and known:  # the first view of a size compiles programs
            self._divisor = divisor_after(divisor, seen + self._splat + self._picture, budget.seconds)
        return view, replace(done.progress, accumulating=view.accumulating)


def divisor_after(divisor: int, took: float, seconds: float) -> int:
    """Return the divisor of the next view, where the last one took so many seconds to draw, in a tick of `seconds`.

    The time is taken as proportional to the number of pixels. A part of it is not: a smaller picture takes longer than expected,
    and a larger one less. So the divisor may grow again in the next view, and never alternates.
    """
    share = max(_DRAWN * seconds, 1e-9)  # a tick without any time draws the smallest picture
    if took > share:
        return min(_MOST, math.ceil(divisor * math.sqrt(took / share)))
    return min(divisor, max(1, math.ceil(divisor * math.sqrt(took / (_MARGIN * share)))))
