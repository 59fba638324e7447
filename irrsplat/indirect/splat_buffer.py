"""The splat buffer of a view with all of the cache in it: first of every other pixel, and of all once that asks for nothing."""

from __future__ import annotations

from functools import partial
from typing import Any

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Records, SplatBuffer
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.timers import Timers
from irrsplat.indirect.splat import SplatPass
from irrsplat.indirect.upsample import UpsamplePass
from irrsplat.records.culling import reaching
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings

_LEAST = 400  # pixels along the height: below it a tile of the examination has too few of every other one


class Splatting(Owner):
    """Keeps the splat buffer of a view of `size` (width, height); what it holds already is not splatted again.

    every: 2 where it is of every other pixel, in both directions, else 1. state: what it was made of, to be compared.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], settings: Settings, timers: Timers) -> None:
        self.ctx, self.size, self.timers = ctx, size, timers
        self.splat_pass = SplatPass(ctx, size, settings.gradients)
        self.upsample_pass: UpsamplePass | None = None  # made when it is first wanted: renders end with all pixels
        self.every = self._next = 1
        self.forget()

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.splat_pass, self.upsample_pass)

    def forget(self) -> None:
        """Make all of it again next time."""
        self.state: tuple[Any, ...] = ()
        self._count = 0
        self._upsampled: tuple[Any, SplatBuffer | None] = (), None

    def start(self, settings: Settings) -> None:
        """Another view begins: with every other pixel where the settings say so."""
        self._next = 2 if settings.coarse and settings.most_bounces > 0 and self.size[1] >= _LEAST else 1

    def refine(self) -> bool:
        """Go on to every pixel next time; False where it is there already."""
        self._next = 1
        return self.every > 1

    def __call__(self, cache: RecordCache, gbuffer: GBuffer, camera: Camera, settings: Settings, *made_of: Any) -> SplatBuffer:
        """The sums as they stand with every record of the cache, of `every` pixel; made_of: what the g-buffer was made of.

        They are additive, so that only new records are drawn.
        """
        self.every = self._next
        count = cache.count if settings.most_bounces > 0 else 0
        key = (*made_of, settings.of("splat"), settings.most_bounces > 0, cache.edits, self.every)
        anew = self.state[:-1] != key
        if anew or self._count < count:
            with self.timers("splat"):
                if anew:
                    self.splat_pass.clear(gbuffer, self.every)
                    self._count = 0
                if self._count < count:
                    sight = partial(self.splat_pass.farthest, gbuffer, camera)
                    numbers = reaching(cache, self._count, camera, self.size, settings, sight)
                    if anew:
                        cache.saw(numbers)
                    self.splat_pass(cache.records, numbers, gbuffer, camera, settings, self.every)
        self._count = count
        self.state = *key, count
        return self.splat_pass.sums(cache.dark, self.every)

    def whole(self, cache: RecordCache, gbuffer: GBuffer, camera: Camera) -> SplatBuffer:
        """The same for all pixels: its own, or those of every other one upsampled."""
        splats = self.splat_pass.sums(cache.dark, self.every)
        if self.every == 1:
            return splats
        made_of, upsampled = self._upsampled
        if upsampled is None or made_of != self.state:
            with self.timers("upsample"):
                self.upsample_pass = self.upsample_pass or UpsamplePass(self.ctx, self.size)
                upsampled = self.upsample_pass(splats, gbuffer, camera)
            self._upsampled = self.state, upsampled
        return upsampled

    def read(self, records: Records, gbuffer: GBuffer, camera: Camera, settings: Settings) -> np.ndarray:
        """The sums (Σ k·E, Σ k) of these records alone, of all pixels: (H, W, 4), top row first."""
        self.splat_pass.clear(gbuffer)
        if records.count:
            self.splat_pass(records, np.arange(records.count), gbuffer, camera, settings)
        if self.every == 1:
            self.forget()
        return self.splat_pass.target.read(0)
