"""Samples beside the pixels' centres: while a view rests, their mean becomes an antialiased picture. The cache is only read."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, ShadowMaps
from irrsplat.gpu.geometry import Geometry
from irrsplat.gpu.program import Program, State
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.image.composite import CompositePass
from irrsplat.image.gbuffer import GBufferPass, GBufferTarget
from irrsplat.image.view import View
from irrsplat.indirect.splat import SplatPass
from irrsplat.lighting.direct import DirectPass
from irrsplat.records.culling import reaching
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import Settings


class AccumulatePass(Owner):
    """Keeps the means of image, direct, indirect and emission of a view of `size` (width, height)."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.program = Program(ctx, "image/accumulate", "lib/fullscreen")
        self.target = Target(ctx, size, (4, 4, 4, 4))

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.program, self.target)

    def __call__(
        self,
        number: int,
        gbuffer: GBuffer,
        direct: moderngl.Texture,
        sums: moderngl.Texture,
        centre: moderngl.Texture,
        sky: tuple[float, float, float],
        mix: tuple[float, float],
    ) -> list[moderngl.Texture]:
        """The means with the `number`-th sample in them (the first, 1, begins anew), RGBA32F textures of this pass's own.

        sums: (Σ k·E, Σ k) of the sample; centre: the same of the pixels' centres, for where those of the sample are empty.
        mix: weights of direct and of indirect light in the image.
        """
        self.program(
            self.target,
            state=State(blend="over") if number > 1 else State(),  # what is there by 1 - share, the new by its share
            position=gbuffer.position,
            albedo=gbuffer.albedo,
            emission=gbuffer.emission,
            direct=direct,
            sums=sums,
            centre=centre,
            blend=mix,
            sky=sky,
            share=1.0 / number,
        )
        return self.target.textures


Told = Callable[[float], None]  # what is called with the share of the samples that are done, 0..1

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
    cache: RecordCache
    settings: Settings


class Accumulator(Owner):
    """Adds samples to one view after the other. Its targets are as large as the view, and made when they are first wanted."""

    def __init__(self, ctx: moderngl.Context, timers: Timers) -> None:
        self.ctx, self.timers = ctx, timers
        self.targets: Targets | None = None
        self._of: View | None = None  # the view that is being sampled, as the frame gave it
        self._view: View | None = None  # the same with its samples

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.targets,)

    def __call__(
        self,
        view: View,
        samples: int,
        budget: Budget,
        passes: Passes,
        seen: Seen,
        told: Told | None = None,
    ) -> View:
        """`view` with `samples` a pixel, or with as many more than last time as the budget has time for, at least one.

        A view that is another one than last time starts anew. Ctrl-C, where there is no budget, ends it early. told: called with
        the share done, 0..1, after each.
        """
        if samples <= 1:
            return view
        targets = self._fitting(view.image.size)
        if self._view is None or self._of is not view or self._view.samples > samples:
            means = targets.mean(1, view.gbuffer, view.direct, view.sums, view.sums, seen.scene.sky, seen.settings.mix)
            image, direct, indirect, emission = means
            self._of, self._view = view, replace(view, image=image, direct=direct, indirect=indirect, emission=emission)
        if self._view.samples == samples:
            return self._view
        first = done = self._view.samples
        last = 0.0
        with self.timers("samples"):
            try:
                while done < samples and (done == first or last < budget.left):
                    start = time.perf_counter()
                    _add(done, view, passes, seen, targets)
                    done += 1
                    if told is not None:
                        self.ctx.finish()
                        told(done / samples)
                    if budget.limited:
                        self.ctx.finish()
                        last = time.perf_counter() - start
            except KeyboardInterrupt:
                if budget.limited:
                    raise
        self._view = replace(self._view, samples=done)  # another object: what its textures hold is something else now
        return self._view

    def _fitting(self, size: tuple[int, int]) -> Targets:
        if self.targets is None or self.targets.size != size:
            if self.targets is not None:
                self.targets.release()
            self.targets, self._view = Targets(self.ctx, size), None
        return self.targets


class Targets(Owner):
    """What samples of a view of `size` (width, height) are drawn into, and their means."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.size = size
        self.mean = AccumulatePass(ctx, size)
        self.gbuffer = GBufferTarget(ctx, size)
        self.splat = Target(ctx, size, (4, 2))
        self.direct = Target(ctx, size, (4,))
        self.smooth: Target | None = None  # made when it is first wanted

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.mean, self.gbuffer, self.splat, self.direct, self.smooth)


def _add(number: int, view: View, passes: Passes, seen: Seen, targets: Targets) -> None:
    """Draw the sample of this number, and blend it into the means."""
    x, y, turn = sample(number)
    camera, settings = beside(view.camera, (x, y), targets.size), seen.settings
    gbuffer = passes.gbuffer(seen.scene, seen.geometry, camera, targets.gbuffer)
    passes.splat.clear(gbuffer, target=targets.splat)
    if settings.most_bounces > 0 and seen.cache.count:
        numbers = reaching(seen.cache, 0, camera, targets.size, settings, partial(passes.splat.farthest, gbuffer, camera))
        passes.splat(seen.cache.records, numbers, gbuffer, camera, settings, target=targets.splat)
    sums = targets.splat.textures[0]
    if settings.smooth:
        targets.smooth = targets.smooth or Target(targets.gbuffer.ctx, targets.size, (4,))
        sums = passes.composite.smoothed(sums, gbuffer, camera, targets.smooth)
    direct = passes.direct(gbuffer, seen.shadows, turn, targets.direct)
    targets.mean(number + 1, gbuffer, direct, sums, view.sums, seen.scene.sky, settings.mix)
