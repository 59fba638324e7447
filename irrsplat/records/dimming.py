"""Dimmed and recoloured lights: scale the records, whose content is linear in the light, channel by channel."""

from __future__ import annotations

import numpy as np

from irrsplat.records.record_cache import RecordCache, luminance_floor

LINEAR = ("irradiance", "vectors", "gradient")  # columns in proportion to the light; R depends on geometry alone


def dim(cache: RecordCache, factor: np.ndarray) -> None:
    """Scale all records and their probes by `factor` (3,), red, green and blue. No record becomes stale.

    The second derivatives stay: they are relative to luminance, and change only if the factors differ. They affect radii only.
    """
    f = np.asarray(factor, np.float32)
    numbers = np.arange(cache.count)
    found = cache.records.read(*LINEAR)
    before = luminance_floor(cache.values[:, :3])
    cache.correct({name: values * (f if name == "irradiance" else f[:, None]) for name, values in found.items()}, numbers)
    if before > 0.0:  # the split into dark and bright records stays
        cache.luminance_floor *= luminance_floor(cache.values[:, :3]) / before
    probe = cache.column("probe")
    probe[:, :3] *= f
    probe[:, 4:] *= np.tile(np.repeat(f, 3), 2)  # M and ∇E, three numbers of each channel
    cache.refresh_count += 1  # triggers a new comparison of radii
