"""Light of holes, the pixels that no record covers: probes of few rays, filtered over the picture (docs/METHOD.md, 8.2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Sites, SplatBuffer, Uniforms
from irrsplat.core.memo import Memo
from irrsplat.core.vectors import octahedral_decode
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera

CELLS = 20_000  # cells of a picture, about: a probe in each takes a fraction of a second
_MOST = 1 << 15  # greatest number of probes: a flight's earlier ones go
_STEPS = 1, 2, 4  # distances of the filter's samples in its steps, cells; without a surface cache, further steps light all others
_HOLES = DrawState(depth="<", depth_write=False)  # draws at marked pixels alone
_SPARSE = 16  # width of the square of cells that probes fill evenly, from sparse to dense


class HoleProbes(Owner):
    """Probes at pixels without a record, in world space: further views use them, too. A change of light discards them."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.cache = self.own(RecordCache(ctx))
        self.light: tuple[object, ...] = ()

    def follow(self, *light: object) -> bool:
        """Discard all probes if one of these objects differs from the last call's, and the oldest half if there are too many.

        Return True if probes are discarded or light differs.
        """
        other = len(light) != len(self.light) or any(a is not b for a, b in zip(light, self.light, strict=True))
        if other:
            self.cache.truncate(0)
            self.light = light
        crowded = self.cache.count > _MOST
        if crowded:
            self.cache.keep_only(np.arange(self.cache.count // 2, self.cache.count))
        return other or crowded


class HoleLight(NamedTuple):
    """The light of holes. probes: None for the light of records and surface cache alone. surface: the uniforms of the surface
    cache; empty without values. coarse: True while coarse light lights the records.

    Coarse light makes blotches between records: pixels with records take half of their light from the filter.
    """

    probes: HoleProbes | None
    surface: Uniforms
    coarse: bool = False


class HoleFilling(Owner):
    """Passes that fill the holes of pictures of `size` (width, height). A cell is a square of pixels with one probe."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.ctx, self.size = ctx, size
        self.side = 2 * max(1, math.ceil(0.5 * math.sqrt(size[0] * size[1] / CELLS)))  # even, for sums at every other pixel
        self.grid = -(-size[0] // self.side), -(-size[1] // self.side)
        self.draw_cells = [self.own(Program(ctx, "indirect/holes/cells", "lib/fullscreen", {"SURFACE": on})) for on in (0, 1)]
        self.add_probes = self.own(Program(ctx, "indirect/holes/probes"))
        names = (f"indirect/holes/{name}" for name in ("filter", "mark", "fill", "surface"))
        programs = (self.own(Program(ctx, name, "lib/fullscreen")) for name in names)
        self.filter, self.mark, self.fill, self.take_surface = programs
        self._targets = self.own(Workshop())
        self._memo = Memo()

    def _target(self, name: str, components: tuple[int, ...], textures: Sequence[moderngl.Texture] | None = None) -> Target:
        """Return a target with a texel per cell."""
        return self._targets.get(name, textures, lambda: Target(self.ctx, self.grid, components, textures=textures))

    @property
    def _cells(self) -> Target:
        """The surfaces of the cells, and their samples in the last two textures."""
        return self._target("cells", (4, 4, 4, 4, 2))

    def _draw_samples(self, gbuffer: GBuffer, splats: SplatBuffer, camera: Camera, light: HoleLight) -> None:
        """Draw the cells with the samples of records, and add the probes that they lack."""
        probes, surface, coarse = light

        def draw() -> list[int]:
            self.draw_cells[bool(surface)](
                self._cells,
                **gbuffer.surface_uniforms,
                **gbuffer.material_uniforms,
                sums=splats.sums,
                coarse=coarse,
                side=self.side,
                pixel_stride=splats.pixel_stride,
                **surface,
            )
            return [0]

        # without probes, the cells are drawn for one picture alone
        drawn = self._memo.get(
            "cells", object() if probes is None else (gbuffer, splats, probes.cache.revision, probes.light, coarse), draw
        )
        (width, height), (position, normal, rest, *_) = self.size, self._cells.textures
        if probes is not None and probes.cache.count > drawn[0]:
            self.add_probes(
                self._target("samples", (), self._cells.textures[3:]),
                vertices=probes.cache.count - drawn[0],
                mode=moderngl.POINTS,
                state=DrawState(blend="add"),
                **self.add_probes.declared(probes.cache.records.uniforms),
                first=drawn[0],
                clip_from_world=camera.clip_from_view(width / height, 1e-3, 1e3) @ camera.view_from_world,
                cells=(width / self.side, height / self.side),
                grid=self.grid,
                width=camera.pixel(self.size) * self.side,
                position=position,
                normal=normal,
                rest=rest,
            )
            drawn[0] = probes.cache.count

    def sites(self, gbuffer: GBuffer, splats: SplatBuffer, camera: Camera, light: HoleLight) -> Sites:
        """Return the sites of cells that have a hole and no probe, from sparse to dense."""
        self._draw_samples(gbuffer, splats, camera, light)
        position, normal, rest, samples = (self._cells.read(i)[::-1] for i in range(4))
        rows, columns = np.nonzero((rest[..., 2] > 0.0) & (samples[..., 3] < 1.0))
        at = np.argsort(_order()[rows % _SPARSE, columns % _SPARSE], kind="stable")
        chosen = rows[at], columns[at]
        geometric = octahedral_decode(normal[chosen][:, 3], rest[chosen][:, 0])
        there, triangle = position[chosen][:, :3], rest[chosen][:, 1].astype(np.intp)
        return Sites(there, normal[chosen][:, :3], geometric, triangle, screen=camera.measure_at(there, self.size))

    def __call__(self, gbuffer: GBuffer, splats: SplatBuffer, camera: Camera, light: HoleLight) -> SplatBuffer:
        """Return the sums, with irradiance at pixels without a record. The texture belongs to this pass."""
        self._draw_samples(gbuffer, splats, camera, light)
        surface, (position, normal, rest, *samples) = light.surface, self._cells.textures
        steps = _STEPS if surface else 1 << np.arange(max(self.grid).bit_length())
        for number, step in enumerate(steps):
            target = self._target(f"step {number % 2}", (4, 2))
            self.filter(
                target,
                position=position,
                normal=normal,
                rest=rest,
                light=samples[0],
                near=samples[1],
                step_size=int(step),
                far=int(step) > _STEPS[-1],
                width=camera.pixel(self.size) * self.side,
            )
            samples = target.textures
        target = self._marked(gbuffer, splats, light.coarse)
        self.fill(
            target,
            state=DrawState(depth="<"),  # filled pixels are no holes any more
            **gbuffer.surface_uniforms,
            sums=splats.sums,
            cell_position=position,
            cell_normal=normal,
            light=samples[0],
            side=self.side,
            surface=bool(surface),
            pixel_stride=splats.pixel_stride,
        )
        return self.by_surface(gbuffer, splats, surface, target) if surface else replace(splats, sums=target.textures[0])

    def by_surface(self, gbuffer: GBuffer, splats: SplatBuffer, surface: Uniforms, target: Target | None = None) -> SplatBuffer:
        """Return the sums, with the irradiance of the surface cache at pixels without a record: equal in every tile of a picture.

        target: with sums, and the remaining holes marked; None: the holes of `splats`. The texture belongs to this pass.
        """
        target = target or self._marked(gbuffer, splats)
        seen = {**gbuffer.surface_uniforms, **gbuffer.material_uniforms}
        self.take_surface(target, state=_HOLES, **seen, pixel_stride=splats.pixel_stride, **surface)
        return replace(splats, sums=target.textures[0])

    def _marked(self, gbuffer: GBuffer, splats: SplatBuffer, coarse: bool = False) -> Target:
        """Return the target of filled sums, with the records' sums. Its depth buffer marks holes; if `coarse`, all surfaces."""
        size, stride = splats.sums.size, splats.pixel_stride
        target = self._targets.get(f"filled {stride}", size, lambda: Target(self.ctx, size, (4,), depth=True))
        self.mark(
            target,
            state=DrawState(depth="1"),
            position=gbuffer.position,
            sums=splats.sums,
            coarse=coarse,
            pixel_stride=stride,
        )
        return target


def _order() -> np.ndarray:
    """Return (_SPARSE, _SPARSE) ranks of cells in a square, of which any first ones are evenly spread (Bayer 1973)."""
    ranks = np.zeros((1, 1), np.intp)
    while len(ranks) < _SPARSE:
        ranks = np.block([[4 * ranks, 4 * ranks + 2], [4 * ranks + 3, 4 * ranks + 1]])
    return ranks
