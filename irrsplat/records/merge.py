"""Merging of caches of one scene, and pruning of a cache: drop records whose places other records cover well enough.

A pixel of some view requested each record because the weight of the records there was too small. The same criterion, Σw, is
applied to the records of other caches. It is evaluated at the record's place, with the radii of a view at the distance of the
request. A record goes if a single renderer that had seen all views would hardly have requested it. Where inter-record variance is
high, limits have shortened the radii already.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from irrsplat.core.record_layout import COLUMNS
from irrsplat.records.cache_file import CacheState, selected
from irrsplat.records.record_cache import luminance_floor
from irrsplat.records.weight import bounded, own_radii, weights
from irrsplat.settings import Settings

# times the Σw below which a pixel requests a record: the pixels around the requesting one need cover as well. Two halves of a
# flight through atrium: at 2, 1.7 % of the pixels request again after merging; at 2.5, 1.5 %, for 5 % more records
_ENOUGH = 2.5
_PAIRS = 1 << 22  # pairs in one batch


class Merged(NamedTuple):
    """A cache, and the number of records of its sources that it dropped."""

    state: CacheState
    dropped: int


def merge(states: Sequence[CacheState], settings: Settings) -> Merged:
    """Merge caches of one scene and one set of settings.

    All records of the first cache stay. Of the others, those stay whose places further records do not cover. Radius limits start
    anew: the next renderer of the cache computes them.
    """
    whole, source = _joined(states)
    return _without_covered(whole, settings, source > 0)


def prune(state: CacheState, settings: Settings, most: int | None = None) -> Merged:
    """Drop records whose places the others cover, the best covered first.

    most: upper limit of the records that stay; then only as many go as necessary, uncovered ones included. None: drop all
    covered records.
    """
    return _without_covered(state, settings, np.ones(len(state.records["id"]), bool), most)


def _without_covered(state: CacheState, settings: Settings, may: np.ndarray, most: int | None = None) -> Merged:
    """Drop records that `may` (N,) go, the best covered first, see `prune`."""
    table = _Table.of(state, settings)
    pairs = _Pairs.among(table, np.flatnonzero(may))
    kept = np.ones(len(table), bool)
    while most is None or kept.sum() > most:
        total = pairs.sums(kept)
        covered = total >= _ENOUGH * settings.threshold if most is None else True
        (left,) = np.nonzero(kept & may & covered)
        if not len(left):
            break
        going = pairs.apart(left[np.argsort(-total[left], kind="stable")])
        if most is not None:  # a quarter at once: the cover of the remaining records falls with each drop
            going = going[: min(int(kept.sum()) - most, -(-len(going) // 4))]
        kept[going] = False
    return Merged(selected(state, np.flatnonzero(kept)), int(np.count_nonzero(~kept)))


# ---- weights of records at each other's places --------------------------------------------------------------------------


@dataclass(frozen=True)
class _Table:
    """The records of a cache, a row each: the columns of record_layout.COLUMNS that weights depend on, and `screen`.

    radii: (N, 2) a·R in metres, within the records' limits and before the bounds of a view.
    """

    columns: Mapping[str, np.ndarray]
    radii: np.ndarray
    settings: Settings

    @classmethod
    def of(cls, state: CacheState, settings: Settings) -> _Table:
        records = state.records
        columns = {name: records[name].astype(float) for name in (*COLUMNS, "screen")}
        columns |= {name: columns[name][:, :3] for name in ("position", "normal")}
        radii = settings.a * own_radii(columns, float(records["luminance_floor"]), settings) * columns["limit"][:, None]
        return cls(columns, radii, settings)

    def __len__(self) -> int:
        return len(self.radii)

    @cached_property
    def widest(self) -> np.ndarray:
        """(N,) metres, the greatest distance of records that may contribute to each place."""
        widest = float(self.radii.max(initial=0.0))
        return bounded(np.full(len(self), widest), self.columns["screen"], self.settings) * (1.0 + 1e-6)

    def weights(self, place: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Return (P,) the weights w of the records `other` at the places of the records `place` (P,).

        The formulas are those of shaders/indirect/splat.frag; 0 where a record does not contribute.
        """
        settings, columns = self.settings, self.columns
        reach = bounded(self.radii[other], columns["screen"][place, None], settings)
        records = {name: columns[name][other] for name in ("position", "normal", "axis")}
        return weights(records, reach, columns["position"][place], columns["normal"][place], settings)


@dataclass(frozen=True)
class _Pairs:
    """Weights of records at the places of others.

    place, other: (P,) numbers of the records. weight: (P,) w of `other` at `place`, above 0.
    """

    count: int  # of records
    place: np.ndarray
    other: np.ndarray
    weight: np.ndarray

    @classmethod
    def among(cls, table: _Table, places: np.ndarray) -> _Pairs:
        """Compute the weights at the places of these records (P,)."""
        position, count = table.columns["position"], len(table)
        places = places[np.argsort(table.widest[places], kind="stable")]  # keeps the search radius of batches small
        tree = cKDTree(position)
        none = np.zeros(0, np.intp)
        chunks = [(none, none, np.zeros(0))]
        parts = [places] if len(places) else []
        while parts:
            part = parts.pop()
            near, within = cKDTree(position[part]), float(table.widest[part].max())
            if len(part) > 1 and near.count_neighbors(tree, within) > _PAIRS:
                parts += [part[len(part) // 2 :], part[: len(part) // 2]]
                continue
            found = near.sparse_distance_matrix(tree, within, output_type="ndarray")
            i, j = part[found["i"]], found["j"]
            w = table.weights(i, j)
            counts = (w > 0.0) & (i != j)
            chunks.append((i[counts], j[counts], w[counts]))
        return cls(count, *(np.concatenate(parts) for parts in zip(*chunks, strict=True)))

    def sums(self, kept: np.ndarray) -> np.ndarray:
        """Return (N,) Σw of the `kept` (N,) records at each place."""
        return np.bincount(self.place, self.weight * kept[self.other], self.count)

    def apart(self, numbers: np.ndarray) -> np.ndarray:
        """Return the subset of `numbers`, in their order, in which no record contributes to the place of another."""
        rank = np.full(self.count, len(numbers))
        rank[numbers] = np.arange(len(numbers))
        later = np.maximum(rank[self.place], rank[self.other])
        free = np.ones(len(numbers) + 1, bool)  # and one for all other pairs
        free[later] = False
        return numbers[free[:-1]]


# ---- arrays of cache files ---------------------------------------------------------------------------------------------


def _joined(states: Sequence[CacheState]) -> tuple[CacheState, np.ndarray]:
    """Return all records in one state with new ids, and (N,) the cache of each.

    Ages of stale records and numbers of views unseen stay.
    """
    clocks = np.array([state.records["clocks"] for state in states])
    epoch, view, _ = (int(clock) for clock in clocks.max(0))
    records: dict[str, np.ndarray] = {}
    for name in states[0].records:
        if name not in ("clocks", "luminance_floor"):
            records[name] = np.concatenate([state.records[name] for state in states])
    counts = [len(state.records["id"]) for state in states]
    source = np.repeat(np.arange(len(states)), counts)
    records["epoch"] = records["epoch"] + (epoch - clocks[:, 0])[source]
    records["last_view"] = records["last_view"] + (view - clocks[:, 1])[source]
    records["id"] = np.arange(len(source))
    records["clocks"] = np.array([epoch, view, len(source)])
    records["luminance_floor"] = np.array(luminance_floor(records["irradiance"]))
    return replace(states[0], records=records, bounces=_bounces(states)), source


def _bounces(states: Sequence[CacheState]) -> dict[str, object]:
    """Return the bounce statistics of the cache with the fewest bounces."""
    found = [dict(state.bounces) for state in states]
    return min(found, key=lambda bounces: (bool(bounces.get("bounces_converged")), int(str(bounces.get("bounces", 0)))))
