"""Records follow lamps that are dimmed or recoloured: what they hold is linear in these, channel by channel."""

from __future__ import annotations

import numpy as np

from irrsplat.records.record_cache import RecordCache, luminance_floor

LINEAR = ("irradiance", "vectors", "gradient")  # the columns that go with the light; R is geometry


def dim(cache: RecordCache, factor: np.ndarray) -> None:
    """Let all records hold what they would if all light were `factor` times as strong, (3,) of red, green and blue; and their
    probes, what these would have found. No record becomes stale by it.

    The second derivatives stay: they are of luminance, relative to it, so that they change only where the factors differ, and
    then only how far records reach.
    """
    f = np.asarray(factor, np.float32)
    numbers = np.arange(cache.count)
    found = cache.gathered(*LINEAR)
    before = luminance_floor(cache.values[:, :3])
    cache.correct({name: values * (f if name == "irradiance" else f[:, None]) for name, values in found.items()}, numbers)
    if before > 0.0:  # it counts as dark and as bright what did before
        cache.luminance_floor *= luminance_floor(cache.values[:, :3]) / before
    cache.probes[:, :3] *= f
    cache.probes[:, 4:] *= np.tile(np.repeat(f, 3), 2)  # M and ∇E, three numbers of each channel
    cache.refresh_count += 1  # how far they reach is compared again
