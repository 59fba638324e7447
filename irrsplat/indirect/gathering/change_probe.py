"""Effect of a change on records: a probe with few rays, compared with an earlier probe along equal directions.

The difference corrects a record until the next gather, and selects the records to gather again.
"""

from __future__ import annotations

import math

import numpy as np

from irrsplat.core.vectors import along_a_way
from irrsplat.records.record_cache import PROBED, RecordCache
from irrsplat.settings import WIDE

SIDE = 16  # of the gather of a probe, and of any other with few rays: its own rays still measure its noise
_MOST = 2.0  # times the surface cache, the most that a record is taken to be brighter; and the most that its gradient grows
_DARK = 0.1  # of the greater mean irradiance: below, the ratio of a record to the surface cache is not known
_NEAR = 8  # records whose mean change of the surface cache scales each of them
MAX_DRIFT = 0.02  # change of E or R, summed over the moves since a record was gathered, beyond which it is gathered again


def columns_of(cache: RecordCache, numbers: np.ndarray) -> np.ndarray:
    """Return (N, 22) float32, the columns PROBED of the records of these numbers, in the form of a probe."""
    found = cache.records.read(*PROBED)
    return np.concatenate(
        [found[name][numbers].reshape(len(numbers), math.prod(found[name].shape[1:])) for name in PROBED], axis=1
    )


def adopt_probes(cache: RecordCache) -> None:
    """Let records along as few rays as a probe be their own probes."""
    probe = cache.column("probe")
    few = np.flatnonzero((probe[:, 3] == 0.0) & (cache.column("gather_size") == SIDE))
    if len(few):
        probe[few] = columns_of(cache, few)


def correction(values: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return (N, 22) the corrected values of records that held `values`, by probes `before` and `after` a change.

    A control variate: value + c·(after − before) with the same directions in both. With E of a channel growing c is 1; where it
    fades, the record fades by the same ratio, and never below 0. ∇E and M go with their channel, and 1/R like an E.
    """
    E, q = slice(0, 3), 3
    x, old, new = (array.astype(float) for array in (values, before, after))
    for one in (x, old, new):
        one[:, q] = 1.0 / np.maximum(one[:, q], 1e-30)
    ratio = np.ones_like(x)
    ratio[:, : q + 1] = np.minimum(1.0, new[:, : q + 1] / np.maximum(old[:, : q + 1], 1e-30))
    ratio[:, 4:] = np.tile(np.repeat(ratio[:, E], 3, axis=1), 2)
    x = ratio * x + (new - ratio * old)
    x[:, q] = 1.0 / np.maximum(x[:, q], 1e-30)
    return np.asarray(x.astype(np.float32))


def change(before: np.ndarray, after: np.ndarray, luminance_floor: float) -> np.ndarray:
    """Return (N,) the greater of the relative changes of E and R, the first columns of (N, 4 and more).

    Each change is relative to the greater of the two values.

    luminance_floor: W/m², the least E in relative changes. Infinite where `before` has no R, which means no probe.
    """
    E = np.maximum(np.maximum(before, after)[:, :3].max(1), max(luminance_floor, 1e-20))
    off = np.abs(after - before)
    share: np.ndarray = np.maximum(off[:, :3].max(1) / E, off[:, 3] / np.maximum(before, after)[:, 3])
    return np.where(before[:, 3] > 0.0, share, np.inf)


def apply_probes(cache: RecordCache, numbers: np.ndarray, found: np.ndarray, radii: tuple[float, float]) -> np.ndarray:
    """Correct the records of these numbers (K,) by the probes `found` (K, 22), which the cache keeps.

    Return the numbers of the records that have changed too much. radii: metres, the least and the greatest R.
    """
    probe, drift = cache.column("probe"), cache.column("drift")
    before = probe[numbers]
    drift[numbers] = np.minimum(drift[numbers] + change(before, found, cache.luminance_floor), 1.0)
    known = (before[:, 3] > 0.0) & (before != found).any(1)
    if known.any():
        there = numbers[known]
        _set_columns(cache, there, correction(columns_of(cache, there), before[known], found[known]), radii)
    probe[numbers] = found
    return np.asarray(numbers[drift[numbers] > MAX_DRIFT])


def scale_by_surface(cache: RecordCache, before: np.ndarray, after: np.ndarray, radii: tuple[float, float]) -> np.ndarray:
    """Let all records follow the surface cache at their places, (N, 3) W/m² `before` and `after`. Return the numbers of the
    records that have changed too much.

    A record holds its former ratio to the surface cache, which resolves near surfaces less. Its probe follows, too, so that the
    next probe corrects the estimate. Light changes by the ratio of means over near records: values that follow a light are noisy
    from site to site. In the dark, where a ratio is not known, each record has its own change.
    """
    numbers, floor = np.arange(cache.count), _DARK * float(max(before.mean(), after.mean())) + 1e-20
    around, later = np.split(_around(cache, np.concatenate([before, after], axis=1)), 2, axis=1)
    known = around / (around + floor)
    after = known * before * later / np.maximum(around, 1e-20) + (1.0 - known) * after
    x = columns_of(cache, numbers)
    E = np.maximum(x[:, :3] + (after - before) * np.minimum((x[:, :3] + floor) / (before + floor), _MOST), 0.0)
    scale = np.minimum(E / np.maximum(x[:, :3], 1e-20), _MOST)
    added = (E - scale * x[:, :3])[:, :, None] * cache.sites(numbers).normal[:, None]
    rows = x.copy()
    rows[:, :3] = E
    rows[:, 4:13] = (scale[:, :, None] * x[:, 4:13].reshape(-1, 3, 3) + added).reshape(-1, 9)
    rows[:, 13:] = np.repeat(scale, 3, axis=1) * x[:, 13:]
    probe, drift = cache.column("probe"), cache.column("drift")
    probe[:] = np.where(probe[:, 3:4] > 0.0, probe + rows - x, 0.0)
    drift[:] = np.minimum(drift + change(x, rows, cache.luminance_floor), 1.0)
    _set_columns(cache, numbers, rows, radii)
    return np.flatnonzero(drift > MAX_DRIFT)


def _around(cache: RecordCache, values: np.ndarray) -> np.ndarray:
    """Return (N, K) the means of `values` (N, K) over _NEAR records that lie close together and face alike."""
    sites, count = cache.sites(slice(0, cache.count)), cache.count
    axis = np.abs(sites.normal).argmax(1)
    facing = 2 * axis + (sites.normal[np.arange(count), axis] < 0.0)
    order = np.lexsort((along_a_way(sites.position), facing))
    sums = np.cumsum(np.pad(values[order].astype(float), ((1, 0), (0, 0))), axis=0)
    first, after = (np.clip(np.arange(count) + step, 0, count) for step in (-_NEAR // 2, _NEAR // 2))
    means = np.empty(values.shape)
    means[order] = (sums[after] - sums[first]) / (after - first)[:, None]
    return means


def _set_columns(cache: RecordCache, numbers: np.ndarray, rows: np.ndarray, radii: tuple[float, float]) -> None:
    """Set the values of records to these rows, in the form of probes. A greatest radius of 0 stays: it marks enclosed records."""
    R, enclosed = np.clip(rows[:, 3], *radii), cache.records.read("max_radius")["max_radius"][numbers] == 0.0
    values = {"irradiance": rows[:, :3], "radius": R, "max_radius": np.where(enclosed, 0.0, np.minimum(WIDE * R, radii[1]))}
    values |= {"vectors": rows[:, 4:13].reshape(-1, 3, 3), "gradient": rows[:, 13:].reshape(-1, 3, 3)}
    cache.correct(values, numbers)
