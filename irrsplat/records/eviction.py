"""Eviction: records to drop when the cache would exceed `max_records`."""

from __future__ import annotations

import numpy as np

from irrsplat.records.culling import reaching
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings

_LEFT = 0.75  # share of max_records that stays, so that evictions are rare


def kept(cache: RecordCache, requested: int, camera: Camera, size: tuple[int, int], settings: Settings) -> np.ndarray | None:
    """Return the numbers of the records to keep, so that so many more fit within `max_records`; None: keep all.

    Records unseen for the most views go first, the farthest of them foremost. Records that this view needs always stay, even
    beyond the limit.
    """
    most = settings.max_records
    if cache.count + requested <= most:
        return None
    unneeded = np.ones(cache.count, bool)
    unneeded[reaching(cache, 0, camera, size, settings)] = False
    numbers = np.flatnonzero(unneeded)
    goal = max(min(int(_LEFT * most), most - requested), 0)
    distance = np.linalg.norm(cache.positions[numbers] - np.asarray(camera.eye, "f4"), axis=1)
    going = numbers[np.lexsort((-distance, cache.column("last_view")[numbers]))][: cache.count - goal]
    return np.delete(np.arange(cache.count), going) if len(going) else None
