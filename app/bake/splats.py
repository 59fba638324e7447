"""Splatting without a screen: every record is drawn on tiles of baked points within its reach, and summed as in ViewSplats."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import moderngl
import numpy as np

from irrsplat.app.bake.places import Places
from irrsplat.core.buffers import GBuffer, SplatBuffer, Uniforms
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import table_texture
from irrsplat.gpu.texel_table import table_rows
from irrsplat.indirect.splat import splat_target
from irrsplat.records.record_cache import RecordCache
from irrsplat.records.weight import record_defines, record_uniforms
from irrsplat.settings import Settings

TILE = 8  # texels per side: a record covers whole tiles
_BLOCK = 8  # tiles per side of a block, the coarse level of the search
_AT_ONCE = 1 << 19  # pairs in a draw
_TRIED = 1 << 22  # pairs tested at once
_FAR = 1e15  # metres: bounds of an empty box; the square fits float32


class PlaceSplats(Owner):
    """Sums of all records of a cache at the places of one g-buffer.

    bounds: least and greatest a·R in metres, in place of a view's pixel bounds.
    """

    def __init__(
        self, ctx: moderngl.Context, gbuffer: GBuffer, where: Places, settings: Settings, bounds: tuple[float, float]
    ) -> None:
        self.ctx, self.gbuffer, self.settings, self.bounds, self.size = ctx, gbuffer, settings, bounds, where.size
        bent = int(settings.gradients and gbuffer.mapped_normal is not None)
        defines = {**record_defines(settings.gradients), "NORMAL_MAPS": bent, "REFINED": 0}
        self.program = self.own(Program(ctx, "indirect/splat", "bake/splat", defines))
        self.empty = self.own(Program(ctx, "indirect/splat_clear", "lib/fullscreen"))
        self.target = self.own(splat_target(ctx, self.size))
        self.tiles = _Boxes.of(where.position, where.seen, TILE)
        self.blocks = _Boxes.of(where.position, where.seen, TILE * _BLOCK)
        self._drawn: tuple[int, int, SplatBuffer] | None = None  # revision and number of the records, and their sums

    def update(self, cache: RecordCache) -> SplatBuffer:
        """Return the sums of all records of the cache; the same object while the sums are unchanged."""
        first = 0
        if self._drawn is not None and self._drawn[0] == cache.revision:
            _, first, kept = self._drawn
            if first >= cache.count:
                return kept
        self._drawn = None
        if first == 0:
            self.empty(self.target, state=DrawState(depth="1"), position=self.gbuffer.position, pixel_stride=1, unlit=False)
        for pairs in self._pairs(cache, first):
            self._draw(cache, pairs)
        sums, weight = self.target.textures
        made = SplatBuffer(sums, weight, cache.luminance_floor, 1)
        self._drawn = cache.revision, cache.count, made
        return made

    def read(self) -> np.ndarray:
        """Return Σ k·E and Σ k (H, W, 4) of the last draw."""
        return np.frombuffer(self.target.textures[0].read(), "f4").reshape(*self.size[::-1], 4)

    def _draw(self, cache: RecordCache, pairs: np.ndarray) -> None:
        """Draw records on tiles; `pairs` (N, 3): record number, x and y of the tile."""
        rows = np.concatenate([pairs[:, :1], pairs[:, 1:] * TILE, np.zeros((len(pairs), 1))], axis=1)
        table = table_texture(self.ctx, table_rows(rows[:, None].astype("f4")))
        mapped = self.gbuffer.mapped_normal if self.settings.gradients else None
        bent: Uniforms = {} if mapped is None else {"lit_normal": mapped}
        self.program(
            self.target,
            vertices=4,
            mode=moderngl.TRIANGLE_STRIP,
            instances=len(pairs),
            state=DrawState(blend="add"),
            pairs=table,
            texels=self.size,
            tile=float(TILE),
            **cache.records.uniforms,
            **record_uniforms(self.settings),
            eye=(0.0, 0.0, 0.0),
            radius_bounds=self.bounds,
            position=self.gbuffer.position,
            normal=self.gbuffer.normal,
            **bent,
            pixel_stride=1,
        )
        table.release()

    def _pairs(self, cache: RecordCache, first: int) -> Iterator[np.ndarray]:
        """Yield (N, 3) pairs of records from number `first` on and tiles (x, y) within reach, at most _AT_ONCE each."""
        centre = cache.positions[first:].astype(np.float32)
        own = self.settings.a * self.settings.widest * cache.values[first:, 3]
        radius = 1.001 * np.clip(own, *self.bounds)
        chunk = max(1, _TRIED // max(len(self.blocks.low), 1))
        for start, stop in pairwise([*range(0, len(centre), chunk), len(centre)]):
            which, block = np.nonzero(self.blocks.near(centre[start:stop, None], radius[start:stop, None]))
            which += start
            inner = np.arange(_BLOCK)
            x, y = (v.ravel() for v in np.meshgrid(inner, inner))
            step = max(1, _TRIED // len(x))
            for i in range(0, len(which), step):
                some, of = which[i : i + step], block[i : i + step]
                tx = _BLOCK * (of % self.blocks.columns)[:, None] + x
                ty = _BLOCK * (of // self.blocks.columns)[:, None] + y
                numbers = np.broadcast_to(some[:, None], tx.shape)
                there = (tx < self.tiles.columns) & (ty < self.tiles.rows)
                tx, ty, numbers = tx[there], ty[there], numbers[there]
                near = self.tiles.near(centre[numbers], radius[numbers], ty * self.tiles.columns + tx)
                found = np.stack([first + numbers[near], tx[near], ty[near]], axis=1)
                for j in range(0, len(found), _AT_ONCE):
                    yield found[j : j + _AT_ONCE]


@dataclass(frozen=True, eq=False)
class _Boxes:
    """Bounding boxes (N, 3), low and high, of the points in each square of a picture, row by row; empty boxes are inverted."""

    low: np.ndarray
    high: np.ndarray
    columns: int
    rows: int

    @staticmethod
    def of(position: np.ndarray, seen: np.ndarray, side: int) -> _Boxes:
        """Return the boxes of squares with `side` texels per side."""
        height, width = seen.shape
        rows, columns = -(-height // side), -(-width // side)
        pad = ((0, rows * side - height), (0, columns * side - width))
        mask = np.pad(seen, pad)[..., None]
        points = np.pad(position, (*pad, (0, 0)))

        def folded(empty: float) -> np.ndarray:
            return np.where(mask, points, np.float32(empty)).reshape(rows, side, columns, side, 3)

        return _Boxes(
            folded(_FAR).min((1, 3)).reshape(-1, 3), folded(-_FAR).max((1, 3)).reshape(-1, 3), columns, rows
        )  # fmt: skip

    def near(self, centre: np.ndarray, radius: np.ndarray, boxes: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return a mask: True if the sphere around `centre` (…, 3) touches the box."""
        low, high = self.low[boxes], self.high[boxes]
        away = np.maximum(np.maximum(low - centre, centre - high), np.float32(0.0))
        return np.asarray((away.astype(np.float32) ** 2).sum(-1) <= radius**2)
