"""The bound on the cache: which records go when there are to be more of them than there may be."""

from __future__ import annotations

import numpy as np

from irrsplat.records.culling import reaching
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings

_LEFT = 0.75  # of the bound: how many stay, so that records seldom go


def kept(cache: RecordCache, wanted: int, camera: Camera, size: tuple[int, int], settings: Settings) -> np.ndarray | None:
    """The numbers of the records that are to stay so that `wanted` more fit within `max_records`; None: all may.

    Those go first that have been out of view for most views, the farthest of them first; never one that this view needs, even
    where too many stay.
    """
    most = settings.max_records
    if cache.count + wanted <= most:
        return None
    free = np.ones(cache.count, bool)
    free[reaching(cache, 0, camera, size, settings)] = False
    numbers = np.flatnonzero(free)
    goal = max(min(int(_LEFT * most), most - wanted), 0)
    distance = np.linalg.norm(cache.positions[numbers] - np.asarray(camera.eye, "f4"), axis=1)
    going = numbers[np.lexsort((-distance, -cache.views_unseen[numbers]))][: cache.count - goal]
    return np.delete(np.arange(cache.count), going) if len(going) else None
