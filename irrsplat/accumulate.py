"""Samples beside the pixels' centres: while a view rests, their mean becomes an antialiased picture. The cache is only read."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import moderngl
import numpy as np

from irrsplat.budget import Budget
from irrsplat.buffers import Records, ShadowMaps
from irrsplat.gpu.geometry import Geometry
from irrsplat.gpu.holder import Holder
from irrsplat.gpu.target import Target
from irrsplat.gpu.timers import Timers
from irrsplat.passes.accumulate import AccumulatePass
from irrsplat.passes.composite import CompositePass
from irrsplat.passes.direct import DirectPass
from irrsplat.passes.gbuffer import GBufferPass, GBufferTarget
from irrsplat.passes.splat import SplatPass
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings
from irrsplat.view import View

_BASES = 2, 3, 5  # of the Halton sequence: x, y and the turn


def sample(number: int) -> tuple[float, float, float]:
    """Where the sample of this number (0: the first) lies beside the pixel's centre, in pixels to the right and up, -½..½, and
    by how much its shadow samples are turned, radians. The first is the centre itself, as any frame has it.

    However many there are, they fill the pixel evenly (Halton 1960, moved by half a pixel).
    """
    x, y, turn = (_mirrored(number, base) for base in _BASES)
    return (x + 0.5) % 1.0 - 0.5, (y + 0.5) % 1.0 - 0.5, 0.5 * math.pi * turn  # four samples: a quarter turn is none


def _mirrored(number: int, base: int) -> float:
    """The digits of `number` in `base`, mirrored at the point: the radical inverse, 0..1."""
    value, place = 0.0, 1.0 / base
    while number:
        number, digit = divmod(number, base)
        value, place = value + digit * place, place / base
    return value


@dataclass(frozen=True)
class Beside(Camera):
    """A camera whose picture is moved by `shift`, of its width to the right and of its height up."""

    shift: tuple[float, float] = (0.0, 0.0)

    def clip_from_view(self, aspect: float, near: float, far: float) -> np.ndarray:
        """(4, 4) float64, as Camera's, off its centre."""
        matrix = super().clip_from_view(aspect, near, far)
        matrix[:2, 2] -= 2.0 * np.asarray(self.shift)
        return matrix


def beside(camera: Camera, offset: tuple[float, float], size: tuple[int, int]) -> Beside:
    """`camera`, seeing at every pixel's centre what it saw at `offset` from there, in pixels to the right and up."""
    shift = -offset[0] / size[0], -offset[1] / size[1]
    return Beside(camera.eye, camera.target, camera.up, camera.fov, camera.name, shift)


@dataclass(frozen=True)
class Passes:
    """The passes of a frame; they draw samples into targets of the Accumulator's."""

    gbuffer: GBufferPass
    splat: SplatPass
    direct: DirectPass
    composite: CompositePass


@dataclass(frozen=True)
class Seen:
    """What a frame is drawn of."""

    scene: Scene
    geometry: Geometry
    shadows: ShadowMaps
    records: Records
    settings: Settings


class Accumulator(Holder):
    """Adds samples to one view of `size` (width, height) after the other. Its targets are made when they are first wanted."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], timers: Timers) -> None:
        self.ctx, self.size, self.timers = ctx, size, timers
        self.mean: AccumulatePass | None = None
        self.gbuffer: GBufferTarget | None = None
        self.splat: Target | None = None
        self.direct: Target | None = None
        self.smooth: Target | None = None
        self._of: View | None = None  # the view that is being sampled, as the frame gave it
        self._view: View | None = None  # the same with its samples

    def __call__(self, view: View, samples: int, budget: Budget, passes: Passes, seen: Seen) -> View:
        """`view` with `samples` a pixel, or with as many more than last time as the budget has time for, at least one.

        A view that is another one than last time starts anew. Ctrl-C, where there is no budget, ends it early.
        """
        if samples <= 1:
            return view
        if self._view is None or self._of is not view or self._view.samples > samples:
            self._of, self._view = view, self._begun(view, seen)
        if self._view.samples < samples:  # another object, since what its textures hold is something else then
            with self.timers("samples"):
                self._view = replace(self._view, samples=self._more(self._view.samples, view, samples, budget, passes, seen))
        return self._view

    def _more(self, first: int, view: View, samples: int, budget: Budget, passes: Passes, seen: Seen) -> int:
        """Add samples from number `first` on; how many there are now."""
        done, last = first, 0.0
        try:
            while done < samples and (done == first or last < budget.left):
                start = time.perf_counter()
                self._add(done, view, passes, seen)
                done += 1
                if budget.limited:
                    self.ctx.finish()
                    last = time.perf_counter() - start
        except KeyboardInterrupt:
            if budget.limited:
                raise
        return done

    def _begun(self, view: View, seen: Seen) -> View:
        """The view with its own sample in the means."""
        self.mean = self.mean or AccumulatePass(self.ctx, self.size)
        self.gbuffer = self.gbuffer or GBufferTarget(self.ctx, self.size)
        self.splat = self.splat or Target(self.ctx, self.size, (4, 2))
        self.direct = self.direct or Target(self.ctx, self.size, (4,))
        sky, mix = seen.scene.sky, seen.settings.mix
        image, direct, indirect, emission = self.mean(1, view.gbuffer, view.direct, view.sums, view.sums, sky, mix)
        return replace(view, image=image, direct=direct, indirect=indirect, emission=emission)

    def _add(self, number: int, view: View, passes: Passes, seen: Seen) -> None:
        assert self.mean is not None and self.gbuffer is not None and self.splat is not None
        x, y, turn = sample(number)
        camera, settings = beside(view.camera, (x, y), self.size), seen.settings
        gbuffer = passes.gbuffer(seen.scene, seen.geometry, camera, self.gbuffer)
        passes.splat.clear(gbuffer, self.splat)
        if settings.most_bounces > 0 and seen.records.count:
            passes.splat(seen.records, 0, gbuffer, camera, settings, self.splat)
        sums = self.splat.textures[0]
        if settings.smooth:
            self.smooth = self.smooth or Target(self.ctx, self.size, (4,))
            sums = passes.composite.smoothed(sums, gbuffer, camera, self.smooth)
        direct = passes.direct(gbuffer, seen.shadows, turn, self.direct)
        self.mean(number + 1, gbuffer, direct, sums, view.sums, seen.scene.sky, settings.mix)
