"""Antialiasing: the picture of a still view becomes the mean of several samples per pixel. The cache is only read."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import moderngl

from irrsplat.core.buffers import GBuffer, Uniforms
from irrsplat.core.timing.clock import now
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Region, Target
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.image.composite import NoFilters
from irrsplat.image.gbuffer import GBufferTarget
from irrsplat.image.view import View
from irrsplat.indirect.splat import splat_target
from irrsplat.lighting.direct import direct_target
from irrsplat.lighting.sky import sky_defines
from irrsplat.scene.model import Camera

_BASES = 2, 3, 5  # of the Halton sequence: x, y and the rotation
_DRAWN = object()  # marks the end of a sample
OnProgress = Callable[[float], None]  # called with the share of finished samples, 0..1
DrawSample = Callable[[int, "SampleBuffers"], Iterator[None]]  # draws a sample by its number; pauses between its stages


class Antialiaser(Owner):
    """Adds samples to one view after another. Its buffers have the view's size and are made at first use."""

    def __init__(self, ctx: moderngl.Context, timers: Timers) -> None:
        self.ctx, self.timers = ctx, timers
        self._buffers = self.own(Workshop())
        self._source: View | None = None  # the view being sampled, before antialiasing
        self._sampled: View | None = None  # the sampled view
        self._sample: Iterator[None] | None = None  # a sample interrupted by the budget

    def __call__(
        self,
        view: View,
        samples: int,
        budget: Budget,
        mix: tuple[float, float],
        draw: DrawSample,
        on_progress: OnProgress | None = None,
    ) -> View:
        """Return `view` with `samples` per pixel, or with as many additional samples as the budget allows.

        A limited budget is checked after each stage of a sample. At least one stage is drawn, unless input waits, and the next
        call continues there. A new view starts again; while a view is refined, the previous result keeps its textures. Ctrl-C
        ends an unlimited call early. mix: see MeanPass. draw: blends a sample into the means. on_progress: called after each
        sample.
        """
        if samples <= 1:
            return view
        size = view.image.size
        buffers = self._buffers.get("buffers", size, lambda: SampleBuffers(self.ctx, size))
        if self._sampled is None or self._source is not view or self._sampled.samples > samples:
            if view.splats.reach is not None:
                buffers.mean, buffers.other = buffers.other or buffers.own(MeanPass(self.ctx, size)), buffers.mean
            behind = view.backdrop.uniforms(view.camera, size)
            means = buffers.mean(1, view.gbuffer, view.direct, view.splats.sums, view.splats.sums, behind, mix)
            image, direct, indirect, emission, alpha = means
            self._source = view
            self._sampled = replace(view, image=image, direct=direct, indirect=indirect, emission=emission, alpha=alpha)
            self._sample = None
        if self._sampled.samples == samples:
            return self._sampled
        done, last_seconds = self._sampled.samples, -math.inf
        with self.timers("samples"):
            try:
                while done < samples and last_seconds < budget.left:
                    start = now()
                    self._sample = self._sample or draw(done, buffers)
                    if next(self._sample, _DRAWN) is _DRAWN:
                        self._sample, done = None, done + 1
                        if on_progress is not None:
                            self.ctx.finish()
                            on_progress(done / samples)
                    if budget.limited:
                        self.ctx.finish()
                        last_seconds = now() - start
            except BaseException as error:  # a generator that was interrupted is over
                self._sample = None
                if budget.limited or not isinstance(error, KeyboardInterrupt):
                    raise
            finally:
                if done > self._sampled.samples:
                    self._sampled = replace(self._sampled, samples=done)  # a new object, since the textures have new contents
        return self._sampled


class SampleBuffers(Owner):
    """Buffers of one sample of a view of `size` (width, height), and the means."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.size = size
        self.mean = self.own(MeanPass(ctx, size))
        self.other: MeanPass | None = None  # means of the previous view
        self.gbuffer = self.own(GBufferTarget(ctx, size))
        self.splat = self.own(splat_target(ctx, size))
        self.direct = self.own(direct_target(ctx, size))


class MeanPass(Owner):
    """The means of image, direct, indirect, emission and alpha over the samples of a view of `size` (width, height)."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.programs = [self.own(Program(ctx, "image/accumulate", "lib/fullscreen", {"SKY_MAP": map_})) for map_ in (0, 1)]
        self.no_filters = self.own(NoFilters(ctx))
        self.target = self.own(Target(ctx, size, (4, 4, 4, 4, 1)))

    def __call__(
        self,
        number: int,
        gbuffer: GBuffer,
        direct: moderngl.Texture,
        sums: moderngl.Texture,
        centre: moderngl.Texture,
        behind: Uniforms,
        mix: tuple[float, float],
        band: Region | None = None,
    ) -> list[moderngl.Texture]:
        """Return the means including sample `number` (1 starts new means), RGBA32F textures of this pass.

        sums: (Σ k·E, Σ k) of the sample; centre: the sums at the pixels' centres, used where the sample's are empty. behind:
        uniforms of shaders/image/backdrop.glsl for the sample. mix: weights of direct and indirect light in the image. band: the
        region (x, y, width, height) to draw; None: everything.
        """
        self.programs[sky_defines(behind)["SKY_MAP"]](
            self.target,
            state=DrawState(blend="over") if number > 1 else DrawState(),  # old·(1 - share) + new·share
            scissor=band,
            position=gbuffer.position,
            **gbuffer.material_uniforms,
            direct=direct,
            sums=sums,
            centre=centre,
            **self.no_filters.uniforms(gbuffer),
            blend=mix,
            **behind,
            share=1.0 / number,
        )
        return self.target.textures


def sample_offset(number: int) -> tuple[float, float, float]:
    """Return the offset of sample `number` (from 0) in its pixel, x right and y up, in pixels (-½..½), and its shadow rotation in
    radians.

    Sample 0 is the centre, unrotated. Any number of samples fills the pixel evenly (Halton 1960, shifted by half a pixel).
    """
    x, y, rotation = (_radical_inverse(number, base) for base in _BASES)
    # a pixel's four shadow samples form a square, so a quarter turn changes nothing
    return (x + 0.5) % 1.0 - 0.5, (y + 0.5) % 1.0 - 0.5, 0.5 * math.pi * rotation


def _radical_inverse(number: int, base: int) -> float:
    """Return the radical inverse of `number` in `base`, 0..1."""
    value, place = 0.0, 1.0 / base
    while number:
        number, digit = divmod(number, base)
        value, place = value + digit * place, place / base
    return value


def jittered(camera: Camera, offset: tuple[float, float], size: tuple[int, int]) -> Camera:
    """Return `camera` shifted so that pixel centres sample `offset`, in pixels right and up. size: (width, height) drawn."""
    whole = camera.whole(size)
    return replace(camera, shift=(-offset[0] / whole[0], -offset[1] / whole[1]))
