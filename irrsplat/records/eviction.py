"""Which records the cache drops when there would be more of them than `max_records`."""

from __future__ import annotations

import numpy as np

from irrsplat.records.culling import reaching
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings

_LEFT = 0.75  # of max_records stay, so that records have to be dropped only seldom


def kept(cache: RecordCache, wanted: int, camera: Camera, size: tuple[int, int], settings: Settings) -> np.ndarray | None:
    """The numbers of the records that stay so that `wanted` more fit within `max_records`; None: all of them stay.

    Those that have been out of view for most views go first, and the farthest of them; never one that this view needs, even if
    too many stay then.
    """
    most = settings.max_records
    if cache.count + wanted <= most:
        return None
    unneeded = np.ones(cache.count, bool)
    unneeded[reaching(cache, 0, camera, size, settings)] = False
    numbers = np.flatnonzero(unneeded)
    goal = max(min(int(_LEFT * most), most - wanted), 0)
    distance = np.linalg.norm(cache.positions[numbers] - np.asarray(camera.eye, "f4"), axis=1)
    going = numbers[np.lexsort((-distance, -cache.views_unseen[numbers]))][: cache.count - goal]
    return np.delete(np.arange(cache.count), going) if len(going) else None
