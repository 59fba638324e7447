"""Splatting: every record adds its weighted irradiance to the pixels within its reach (Jones 2010, sections 2.2 and 3.5).

The splat buffer of a view has the sums over all records of the cache. Only records that it lacks are drawn. Sums at every other
pixel are upsampled to all pixels along surfaces: joint bilateral (Kopf et al. 2007).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Records, SplatBuffer, Uniforms
from irrsplat.core.memo import Memo
from irrsplat.core.timing.input_waits import stop_for_input
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.records.culling import reaching
from irrsplat.records.record_cache import RecordCache
from irrsplat.records.weight import record_defines, view_radius_uniforms
from irrsplat.scene.model import Camera
from irrsplat.scene.spatial.solids import in_the_dark
from irrsplat.settings import Settings

_BATCH = 1.2e8  # records times pixels: some 30 ms of a software renderer, which also spends a millisecond on each batch
_LEAST_HEIGHT = 400  # pixels: with fewer, a tile of the examination has too few of every other one


def batches(numbers: np.ndarray, size: tuple[int, int]) -> Iterator[np.ndarray]:
    """Yield the records' numbers in batches, in their order: work can end between two batches, without effect on the sums.

    size: width and height of the splat buffer, pixels.
    """
    count = max(int(_BATCH / (size[0] * size[1])), 1)
    return (numbers[first : first + count] for first in range(0, len(numbers), count))


def splat_target(ctx: moderngl.Context, size: tuple[int, int]) -> Target:
    """Return the target that sums records: SplatBuffer's textures, and the surfaces' depths that records are compared with."""
    return Target(ctx, size, (4, 2), depth=True)


class SplatPass(Owner):
    """Pass that adds records to a splat buffer of `size` (width, height).

    A second, smaller buffer has every other pixel in both directions, for pixel_stride = 2.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.ctx, self.size = ctx, size
        self.numbers = self.own(ctx.buffer(reserve=4))  # of the records that are drawn
        self.programs = {  # without gradients, E is valid only at the record's normal
            (gradients, bent, refined): self.own(
                Program(
                    ctx,
                    "indirect/splat",
                    defines={**record_defines(gradients), "NORMAL_MAPS": int(bent), "REFINED": int(refined)},
                )
            )
            for gradients, bent, refined in product((False, True), repeat=3)
            if gradients or not bent
        }
        self.empty = self.own(Program(ctx, "indirect/splat_clear", "lib/fullscreen"))
        self.targets = self.own(Workshop())

    def target(self, pixel_stride: int) -> Target:
        """Return the buffer of every `pixel_stride`-th pixel in both directions."""
        size = -(-self.size[0] // pixel_stride), -(-self.size[1] // pixel_stride)
        return self.targets.get(f"stride {pixel_stride}", (), lambda: splat_target(self.ctx, size))

    def clear(self, gbuffer: GBuffer, pixel_stride: int = 1, target: Target | None = None, unlit: bool = False) -> None:
        """Start again from no records; the weight is NOTHING_SEEN at pixels without a surface, or at all pixels if `unlit`."""
        self.empty(
            target or self.target(pixel_stride),
            state=DrawState(depth="1"),
            position=gbuffer.position,
            pixel_stride=pixel_stride,
            unlit=unlit,
        )

    def __call__(
        self,
        records: Records,
        numbers: np.ndarray,
        gbuffer: GBuffer,
        camera: Camera,
        settings: Settings,
        pixel_stride: int = 1,
        target: Target | None = None,
        reach: moderngl.Texture | None = None,
    ) -> None:
        """Add the records of these numbers (N,), in their order, to `target` (default: this pass's own buffer).

        reach: see SplatBuffer.
        """
        width, height = self.size
        if not len(numbers):
            return
        some: Uniforms = {} if reach is None else {"reach": reach}
        bent = settings.gradients and gbuffer.mapped_normal is not None
        if bent:
            some["lit_normal"] = gbuffer.mapped_normal
        data = numbers.astype("i4").tobytes()
        self.numbers.orphan(max(len(data), self.numbers.size))  # an earlier draw may still read the old numbers
        self.numbers.write(data)
        self.programs[settings.gradients, bent, reach is not None](
            target or self.target(pixel_stride),
            vertices=4,
            mode=moderngl.TRIANGLE_STRIP,
            instances=len(numbers),
            numbers=self.numbers,
            state=DrawState(depth="<", depth_write=False, blend="add", depth_clamp=True),
            **records.uniforms,
            clip_from_world=camera.clip_from_view(width / height, 1e-3, 1e3) @ camera.view_from_world,
            **view_radius_uniforms(camera, self.size, settings),
            pixel=camera.pixel(self.size) * pixel_stride,
            forward=-camera.axes[2],
            **gbuffer.surface_uniforms,
            **some,
            pixel_stride=pixel_stride,
        )


def first_stride(settings: Settings, size: tuple[int, int]) -> int:
    """Return the pixel stride of the first rounds of a view of `size`: 2 for every other pixel, 1 for all pixels.

    The paper's scan needs every pixel.
    """
    requested = settings.placement != "scan" and settings.most_bounces > 0
    return 2 if requested and size[1] >= _LEAST_HEIGHT else 1


class _Drawn(NamedTuple):
    """The content of the splat buffer: the sums of the first records, so many, drawn for these inputs."""

    inputs: tuple[object, ...]
    records: int
    sums: SplatBuffer


class ViewSplats(Owner):
    """The splat buffer of views of `size` (width, height).

    The sums are additive: if g-buffer, settings and old records do not change, only new records are drawn. Equal inputs give
    the same SplatBuffer object, so that later stages can compare it by identity.
    """

    def __init__(self, world: World, size: tuple[int, int], timers: Timers) -> None:
        self.world, self.ctx, self.size, self.timers = world, world.ctx, size, timers
        self.splat_pass = self.own(SplatPass(world.ctx, size))
        self.upsample_pass: UpsamplePass | None = None  # made at first use: renders end with every pixel splatted
        self._drawn: _Drawn | None = None
        self._memo = Memo()  # True if the camera lies in a closed mesh without a light, and the upsampled sums

    @property
    def sums(self) -> SplatBuffer | None:
        """The sums of the last update; None before the first update."""
        return None if self._drawn is None else self._drawn.sums

    def _in_the_dark(self, camera: Camera) -> bool:
        """Return True if the camera lies within a closed mesh without a light: each black record would cover a single pixel."""
        scene, unlit = self.world.scene, self.world.unlit_interiors
        return self._memo.get("dark", (scene.meshes, unlit, camera.eye), lambda: in_the_dark(scene, unlit, camera.eye))

    def forget(self) -> None:
        """Splat all records again at the next update."""
        self._drawn = None

    def update(
        self,
        cache: RecordCache,
        gbuffer: GBuffer,
        camera: Camera,
        settings: Settings,
        pixel_stride: int,
        reach: moderngl.Texture | None = None,
        noted: bool = True,
    ) -> SplatBuffer:
        """Return the sums of all records at every `pixel_stride`-th pixel in both directions (1 or 2).

        reach: see SplatBuffer. noted: True if the cache marks the drawn records as seen. Raises InputWaits between two batches of
        records while input waits; the next call draws the remaining batches.
        """
        count = cache.count if settings.most_bounces > 0 else 0
        unlit = self._in_the_dark(camera)
        inputs = gbuffer, settings.of("splat"), settings.most_bounces > 0, cache.revision, pixel_stride, reach, unlit
        drawn = self._drawn if self._drawn is not None and self._drawn.inputs == inputs else None
        if drawn is not None and drawn.records >= count:
            return drawn.sums
        first = 0 if drawn is None else drawn.records
        self._drawn = None  # an incomplete batch does not count as drawn
        values, weight = self.splat_pass.target(pixel_stride).textures
        sums = SplatBuffer(values, weight, cache.luminance_floor, pixel_stride, reach)
        with self.timers("splat"):
            if first == 0:
                self.splat_pass.clear(gbuffer, pixel_stride, unlit=unlit)
            if first < count:
                numbers = reaching(cache, first, camera, self.size, settings)
                if first == 0 and noted:
                    cache.mark_seen(numbers)
                for chosen in batches(numbers, sums.weight.size):
                    self.splat_pass(cache.records, chosen, gbuffer, camera, settings, pixel_stride, reach=reach)
                    self._drawn = _Drawn(inputs, int(chosen[-1]) + 1, sums)
                    stop_for_input(self.ctx)
        self._drawn = _Drawn(inputs, count, sums)
        return sums

    def at_every_pixel(self, splats: SplatBuffer, gbuffer: GBuffer, camera: Camera) -> SplatBuffer:
        """Return the sums at every pixel: `splats` itself, or its strided sums upsampled along surfaces."""
        if splats.pixel_stride == 1:
            return splats

        def upsample() -> SplatBuffer:
            with self.timers("upsample"):
                self.upsample_pass = self.upsample_pass or self.own(UpsamplePass(self.ctx, self.size))
                return self.upsample_pass(splats, gbuffer, camera)

        return self._memo.get("upsampled", splats, upsample)

    def read(self, records: Records, gbuffer: GBuffer, camera: Camera, settings: Settings) -> np.ndarray:
        """Return (H, W, 4) the sums (Σ k·E, Σ k) of these records alone at every pixel, top row first."""
        self.forget()
        self.splat_pass.clear(gbuffer, unlit=self._in_the_dark(camera))
        if records.count:
            self.splat_pass(records, np.arange(records.count), gbuffer, camera, settings)
        return self.splat_pass.target(1).read(0)


class UpsamplePass(Owner):
    """Upsampling of sums from every other pixel of a view of `size` (width, height) to all pixels.

    Most pixels lie between four coarse pixels of one surface, and take their linear interpolation. The depth buffer marks all
    other pixels for a second draw, which searches sixteen coarse pixels for those on the pixel's surface.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.ctx, self.size = ctx, size
        self.squares = self.own(Program(ctx, "indirect/upsample_squares", "lib/fullscreen"))
        self.between = self.own(Program(ctx, "indirect/upsample", "lib/fullscreen"))
        self.search = self.own(Program(ctx, "indirect/upsample_search", "lib/fullscreen"))
        self.target = self.own(Target(ctx, ((size[0] + 1) // 2, (size[1] + 1) // 2), (4, 4)))
        self.target.textures[0].filter = moderngl.LINEAR, moderngl.LINEAR
        self.out = self.own(Target(ctx, size, (4, 2), depth=True))

    def __call__(self, splats: SplatBuffer, gbuffer: GBuffer, camera: Camera) -> SplatBuffer:
        """Return interpolated sums for every pixel: E, a weight of 1, and Σw. The textures belong to this pass.

        Raises InputWaits between two draws.
        """
        seen = gbuffer.surface_uniforms
        self.squares(self.target, **seen, sums=splats.sums, weight=splats.weight)
        stop_for_input(self.ctx)
        irradiance, planes = self.target.textures
        self.between(
            self.out,
            state=DrawState(depth="1"),
            position=gbuffer.position,
            irradiance=irradiance,
            planes=planes,
            pixel=camera.pixel(self.size),
        )
        stop_for_input(self.ctx)
        self.search(self.out, state=DrawState(depth="<", depth_write=False), **seen, sums=splats.sums, weight=splats.weight)
        sums, weight = self.out.textures
        return SplatBuffer(sums, weight, splats.luminance_floor)
