"""Irradiance at the close hits of records, by a second gather with rays from these hits (docs/METHOD.md, 11.5).

A value of the surface cache is a mean over its site's cluster. Close to a record, light changes within the extent of a cluster.
"""

from __future__ import annotations

import numpy as np

from irrsplat.core.buffers import HitLight, Sites
from irrsplat.core.color import LUMINANCE
from irrsplat.core.glsl import TWELVE_BITS
from irrsplat.gather.hemisphere import Gather, gather_records
from irrsplat.gather.record_frame import PLACES, rows_of_places
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.stratified import LEAST_SIDE
from irrsplat.gpu.resource import Owner
from irrsplat.records.record_cache import RecordCache

_RAYS = 0.25  # of a record's rays: rays from its hits, if all are close
LEAST = 20.0  # weighted number of close hits below which a record keeps the values of the surface cache


class CloseLight(Owner):
    """Passes that compute light at close hits. gather: LEAST_SIDE² rays from PLACES hits, lit by the surface cache."""

    def __init__(self, gather: Gather) -> None:
        ctx = gather.world.ctx
        self.gather, self.found = self.own(gather), self.own(RecordCache(ctx))
        self.reduce = self.own(ReducePass(ctx, gradients=False, places=PLACES))

    def __call__(
        self,
        light: HitLight,
        rows: np.ndarray,
        sites: Sites,
        rotations: np.ndarray,
        planes: np.ndarray,
        rays: np.ndarray,
        triangles: np.ndarray | None,
        seed: int,
    ) -> np.ndarray:
        """Return (N, 2) luminances in W/m²: mean E at the close hits of N records, and its part by close values of the surface
        cache; that is -1 for records with few close hits.

        rows: (5, N, 4) of Atlas.frames, for records at these `sites`. rotations: (N,) seeds of the frames. planes:
        (N, R, 4) texels of Atlas.planes. rays: (4, R) directions in a frame, and cosθ·dω. triangles: (N, R) of hits, if known.
        """
        pair = np.maximum(planes[..., 3], 0.0).astype(np.int32)
        reflected = (pair & int(TWELVE_BITS)).astype(np.float32) * (rays[3] / (np.pi * TWELVE_BITS))
        close = reflected.sum(1) * rays.shape[1]
        gathers = np.where(close > LEAST, np.ceil(close * _RAYS / LEAST_SIDE**2), 0.0).astype(np.intp)
        values = np.tile(np.array([0.0, -1.0], np.float32), (len(gathers), 1))
        some = np.flatnonzero(gathers)
        if len(some):
            row, texel, rank = drawn(reflected[some], gathers[some])
            record = some[row]
            along = np.einsum("kn,nkx->nx", rays[:3, texel], rows[:3, record, :3].swapaxes(0, 1))
            plane = planes[record, texel, :3]
            place = rows[4, record, :3] + along / np.einsum("nx,nx->n", plane, along)[:, None]
            facing = -plane / np.linalg.norm(plane, axis=1, keepdims=True)
            triangle = None if triangles is None else triangles[record, texel]
            turned = rotations[record] * rays.shape[1] + rank
            eyes = Sites(place, facing, facing, triangle, turned, sites.screen_heights[record])
            values[some] = self._means(light, eyes, gathers[some], seed)
        return values

    def _means(self, light: HitLight, eyes: Sites, gathers: np.ndarray, seed: int) -> np.ndarray:
        """Return (N, 2) as a call does, for records with so many `gathers` (N,), from `eyes`."""
        count = len(eyes) // PLACES
        if count > self.found.count:
            self.found.append(eyes[: count - self.found.count])
        numbers, where = np.arange(count), lambda some: eyes[rows_of_places(some, PLACES)]
        gather_records(self.gather, self.reduce, light, self.found, numbers, seed, where=where)
        found = self.found.records.read("irradiance", "noise")
        values = np.stack([found["irradiance"] @ LUMINANCE, found["noise"]], axis=1)[:count]
        return np.asarray(np.add.reduceat(values, np.cumsum(gathers) - gathers) / gathers[:, None])


def drawn(weights: np.ndarray, gathers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw hits by their `weights` (N, R), PLACES times the `gathers` (N,) of each record.

    Return the record, the texel and the rank in its record of each. Systematic sampling draws them in the order of texels. A
    gather's hits lie all over the hemisphere, and its places take the parts of the hemisphere in turn.
    """
    sums = np.cumsum(weights, dtype=float)
    ends = sums[weights.shape[1] - 1 :: weights.shape[1]]
    counts = PLACES * gathers
    record = np.repeat(np.arange(len(gathers)), counts)
    rank = np.arange(len(record)) - np.repeat(np.cumsum(counts) - counts, counts)
    gather, place = np.divmod(rank, PLACES)
    at = ((place + gather) % PLACES + (gather + 0.5) / gathers[record]) / PLACES
    begin = np.concatenate([[0.0], ends[:-1]])
    found = np.searchsorted(sums, begin[record] + at * (ends - begin)[record], side="right")
    return record, np.minimum(found - record * weights.shape[1], weights.shape[1] - 1), rank
