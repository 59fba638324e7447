"""Interface of the gathers: they sample the radiance over the hemispheres of records, from which the values of records follow.

The paper's plane (plane.py) and rays (trace.py) implement the interface. `gather_records` is the only loop that computes
records.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator
from contextlib import nullcontext

import numpy as np

from irrsplat.core.buffers import Atlas, HitLight, Sites
from irrsplat.gather.record_frame import eye_positions, offset_of, tangent_frames
from irrsplat.gather.reduce import ReducePass
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import Target, float_texture, table_texture, uneven
from irrsplat.gpu.time_budget import Budget, Pace
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.lighting.sky import sky_maps, sky_uniforms
from irrsplat.records.record_cache import RecordCache


class Gather(Owner):
    """A gather bound to its `world`, whose changes it follows, and to the world's kinds of lights (see light_defines).

    kind: "plane", "trace" or "embree". table: (height, width, 4), direction in a record's frame and cosθ·dω of each texel of a
    record. capacity: greatest number of records in one call. places: number of eye positions of a record, which alternate
    (shaders/gather/places.glsl); `frames` of an atlas then has as many columns per record. atlas: an atlas without records; a
    call returns a copy with the records of a batch.
    """

    kind: str
    atlas: Atlas

    def __init__(self, world: World, table: np.ndarray, capacity: int, places: int = 1) -> None:
        self.world, self.table, self.capacity, self.places = world, table, capacity, places
        self._pace = Pace(world.ctx)

    @property
    def cell(self) -> tuple[int, int]:
        """Texels of a record's hemisphere, width and height."""
        return self.table.shape[1], self.table.shape[0]

    @property
    def share(self) -> np.ndarray:
        """(height, width) cosθ·dω of each texel."""
        return self.table[..., 3]

    @property
    def offset(self) -> float:
        """Greatest height of a record's eye above its surface, metres."""
        return offset_of(self.world.scene)

    @property
    def radii(self) -> tuple[float, float]:
        """The least and the greatest R_k, metres: the offset bounds distances below, and a miss counts as a scene's diagonal."""
        return self.offset, self.world.scene.diagonal

    def _empty_atlas(self, target: Target, columns: int, edges: np.ndarray) -> Atlas:
        """Return an atlas in `target` with so many cells per row, of four by four blocks each. edges: see Atlas."""
        ctx, side = self.world.ctx, math.isqrt(self.share.size) // 4
        return Atlas(
            radiance=target.textures[0],
            planes=target.textures[1],
            table=self.own(table_texture(ctx, self.table, varying=True)),
            edges=self.own(table_texture(ctx, edges, varying=True)),
            frames=self.own(float_texture(ctx, (uneven(self.capacity * self.places), 5))),
            count=0,
            columns=columns,
            cell=self.cell,
            block=(side, side),
        )

    def batches(self, requested: int, budget: Budget) -> Iterator[slice]:
        """Return slices of the `requested` number of records, one batch each, until all are done or the budget ends.

        The caller gathers each batch before it takes the next.
        """
        return self._pace.batches(requested, self.capacity, budget, self.share.size)

    def _frame_rows(self, sites: Sites, numbers: np.ndarray, seed: int, heights: np.ndarray) -> np.ndarray:
        """Return (5, N, 4) float32, the rows of Atlas.frames of the records of these `numbers` in the cache, at `sites`.

        heights: (N,) metres, of the eyes above the surface.
        """
        frame = tangent_frames(sites.normal, sites.frame_rotations(numbers), seed)
        rows = np.zeros((5, len(sites), 4), "f4")
        rows[:3, :, :3] = frame.swapaxes(0, 1)
        rows[2, :, 3] = -1.0 if sites.triangle is None else sites.triangle
        rows[3, :, :3], rows[3, :, 3] = np.einsum("nij,nj->ni", frame, sites.geometric.astype(float)), numbers
        rows[4, :, :3] = eye_positions(sites, self.world.geometry.corners, heights)
        return rows

    @abstractmethod
    def __call__(self, light: HitLight, sites: Sites, numbers: np.ndarray, seed: int) -> Atlas:
        """Return the radiance at `sites`, at most `capacity` times `places`, under this light; valid until the next call.

        numbers: (N,) the numbers of the records in the cache.
        """


def gather_records(
    gather: Gather,
    reduce: ReducePass,
    light: HitLight,
    cache: RecordCache,
    numbers: np.ndarray,
    seed: int,
    timers: Timers | None = None,
    where: Callable[[np.ndarray], Sites] | None = None,
) -> Atlas | None:
    """Gather the records of these `numbers` (N,) at their sites in the cache, and write the results into it.

    Batches are as large as the gather's capacity. timers: count the stages "gather" and "reduce". where: returns the eye sites of
    records of these numbers, one record's after another's; None: the cache's sites. Return the atlas of the last batch, None for
    no records.
    """
    atlas, sky = None, sky_uniforms(gather.world.scene, sky_maps(gather.world))
    where = where or cache.sites
    for first in range(0, len(numbers), gather.capacity):
        batch = numbers[first : first + gather.capacity]
        with timers("gather") if timers else nullcontext():
            atlas = gather(light, where(batch), np.repeat(batch, gather.places), seed)
        with timers("reduce") if timers else nullcontext():
            reduce(atlas, cache.records, sky, gather.radii)
    return atlas
