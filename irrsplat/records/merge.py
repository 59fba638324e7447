"""Merging of caches of one scene, and pruning of a cache: drop records whose places other records cover well enough.

A pixel of some view requested each record because the weight of the records there was too small. The same criterion, Σw, is
applied to the records of other caches. It is evaluated at the record's place, with the radii of a view at the distance of the
request. A record goes if a single renderer that had seen all views would hardly have requested it. Where inter-record variance is
high, limits have shortened the radii already.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_array
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
    weights = _weights_at_places(state, settings, np.flatnonzero(may))
    kept, total = np.ones(len(may), bool), np.where(may, weights.sum(1), -np.inf)
    least = _ENOUGH * settings.threshold if most is None else -np.inf
    for _ in range(len(may) - (most or 0)):
        going = int(total.argmax())
        if total[going] < least:
            break
        kept[going], total[going] = False, -np.inf
        covered = slice(*weights.indptr[going : going + 2])
        total[weights.indices[covered]] -= weights.data[covered]
    return Merged(selected(state, np.flatnonzero(kept)), int(np.count_nonzero(~kept)))


def _weights_at_places(state: CacheState, settings: Settings, places: np.ndarray) -> csc_array:
    """Return (N, N) sparse: the weight w of each record (column) at the places of these records (rows).

    The formulas are those of shaders/indirect/splat.frag. A record has no weight at its own place.
    """
    records = state.records
    columns = {name: records[name].astype(float) for name in (*COLUMNS, "screen")}
    columns |= {name: columns[name][:, :3] for name in ("position", "normal")}
    radii = settings.a * own_radii(columns, float(records["luminance_floor"]), settings) * columns["limit"][:, None]
    position, normal, screen, count = columns["position"], columns["normal"], columns["screen"], len(radii)
    # metres: the greatest distance of records that contribute at a place
    widest = bounded(np.full(count, radii.max(initial=0.0)), screen, settings) * (1.0 + 1e-6)
    tree, found = cKDTree(position), [(np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0))]
    # sorted: the search radius of a batch is its greatest one
    parts = [places[np.argsort(widest[places], kind="stable")]] if len(places) else []
    while parts:
        part = parts.pop()
        near, within = cKDTree(position[part]), float(widest[part].max())
        if len(part) > 1 and near.count_neighbors(tree, within) > _PAIRS:
            parts += [part[len(part) // 2 :], part[: len(part) // 2]]
            continue
        pairs = near.sparse_distance_matrix(tree, within, output_type="ndarray")
        i, j = part[pairs["i"]], pairs["j"]
        others = {name: columns[name][j] for name in ("position", "normal", "axis")}
        w = weights(others, bounded(radii[j], screen[i, None], settings), position[i], normal[i], settings)
        counts = (w > 0.0) & (i != j)
        found.append((i[counts], j[counts], w[counts]))
    i, j, w = (np.concatenate(column) for column in zip(*found, strict=True))
    return csc_array((w, (i, j)), shape=(count, count))


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
