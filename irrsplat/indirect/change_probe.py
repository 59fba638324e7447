"""Which records a moved mesh concerns: a rough gather from each is compared with what the same directions brought before."""

from __future__ import annotations

import numpy as np

from irrsplat.core.buffers import HitLight, Sites
from irrsplat.gather.look import Gather, gather_records
from irrsplat.gather.reduce import ReducePass
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.records.record_cache import RecordCache

SIDE = 8  # side² directions, a small part of a gather's
LIGHT_SAMPLES = 16  # to emitters at most, beside these
MAX_RECORDS = 4096  # probed at once
_MAX_DRIFT = 0.02  # change of E or R, summed over the moves since a record was gathered, beyond which it is gathered again


class ChangeProbe(Owner):
    """Probes records with `gather`, made for SIDE, which it owns from then on."""

    def __init__(self, gather: Gather) -> None:
        self.gather = gather
        self.reduce = ReducePass(gather.world.ctx, gradients=False)
        self.records = RecordCache(gather.world.ctx)

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.gather, self.reduce, self.records)

    def __call__(self, light: HitLight, sites: Sites, seed: int) -> np.ndarray:
        """(N, 4) float32: rough E of records at `sites`, W/m², and R, metres."""
        self.records.truncate(0)
        numbers = self.records.append(sites) + np.arange(len(sites))
        gather_records(self.gather, self.reduce, light, self.records, numbers, seed)
        found = self.records.read()
        return np.column_stack([found["irradiance"], found["radius"]])


def change(before: np.ndarray, after: np.ndarray, luminance_floor: float) -> np.ndarray:
    """(N,) how much E and R (N, 4) have changed: the greater of both changes, each relative to the greater of its two values.

    luminance_floor: W/m², below which E counts as if it were that. Infinite where `before` has no R: nothing is known there.
    """
    E = np.maximum(np.maximum(before, after)[:, :3].max(1), max(luminance_floor, 1e-20))
    off = np.abs(after - before)
    share: np.ndarray = np.maximum(off[:, :3].max(1) / E, off[:, 3] / np.maximum(before, after)[:, 3])
    return np.where(before[:, 3] > 0.0, share, np.inf)


def changed_records(cache: RecordCache, found: np.ndarray) -> np.ndarray:
    """The numbers of the records that have changed too much, now that probes have `found` (N, 4); the cache keeps these."""
    cache.drift[:] = np.minimum(cache.drift + change(cache.probes, found, cache.luminance_floor), 1.0)
    cache.probes[:] = found
    return np.flatnonzero(cache.drift > _MAX_DRIFT)
