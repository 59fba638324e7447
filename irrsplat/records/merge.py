"""Merging of caches of one scene, and pruning of a cache: drop records whose places other records cover well enough.

A pixel of some view requested each record because the weight of the records there was too small. The same criterion, Σw, is
applied to the records of other caches. It is evaluated at the record's place, with the radii of a view at the distance of the
request. A record goes if a single renderer that had seen all views would hardly have requested it. Where inter-record variance is
high, limits have shortened the radii already.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from irrsplat.records.cache_file import CacheState, selected
from irrsplat.records.record_cache import luminance_floor
from irrsplat.records.weight import bounded, limits_of, own_radii, weights
from irrsplat.settings import Settings

# times the Σw below which a pixel requests a record: the pixels around the requesting one need cover as well. Two halves of a
# flight through atrium: at 2, 1.7 % of the pixels request again after merging; at 2.5, 1.5 %, for 5 % more records
_ENOUGH = 2.5
_AT_ONCE = 1024  # places in one batch, each with up to a few thousand records around it


def merge(states: Sequence[CacheState], settings: Settings) -> CacheState:
    """Merge caches of one scene and one set of settings.

    All records of the first cache stay. Of the others, those stay whose places further records do not cover. Radius limits start
    anew: the next renderer of the cache computes them.
    """
    whole, source = _joined(states)
    return _without_covered(whole, settings, source > 0)


def prune(state: CacheState, settings: Settings, most: int | None = None) -> CacheState:
    """Drop records whose places the others cover, the best covered first.

    most: upper limit of the records that stay; then only as many go as necessary, uncovered ones included. None: drop all
    covered records.
    """
    return _without_covered(state, settings, np.ones(len(state.records["id"]), bool), most)


def _without_covered(state: CacheState, settings: Settings, may: np.ndarray, most: int | None = None) -> CacheState:
    """Drop records that `may` (N,) go, the best covered first, see `prune`."""
    place, other, weight = _pairs(state, settings, np.flatnonzero(may))
    kept = np.ones(len(may), bool)
    while most is None or kept.sum() > most:
        total = np.bincount(place, weight * kept[other], len(kept))  # Σw of the kept records at each place
        covered = total >= _ENOUGH * settings.threshold if most is None else True
        (left,) = np.nonzero(kept & may & covered)
        if not len(left):
            break
        going = left[np.argsort(-total[left], kind="stable")]
        rank = np.full(len(kept), len(going))
        rank[going] = np.arange(len(going))
        apart = np.ones(len(going) + 1, bool)  # and one for all other pairs
        apart[np.maximum(rank[place], rank[other])] = False
        going = going[apart[:-1]]  # none of these contributes to the place of another
        if most is not None:  # a quarter at once: the cover of the remaining records falls with each drop
            going = going[: min(int(kept.sum()) - most, -(-len(going) // 4))]
        kept[going] = False
    return selected(state, np.flatnonzero(kept))


def _pairs(state: CacheState, settings: Settings, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the pairs of records of which one contributes to the place of the other, one of `places` (K,).

    They are numbers (P,) of the places and of the contributing records, and the weights (P,) w > 0 by the formulas of
    shaders/indirect/splat.frag.
    """
    floor = float(state.records["luminance_floor"])
    columns = {name: rows.astype(float) for name, rows in state.records.items() if name != "clocks"}
    position, normal = (columns[name][:, :3] for name in ("position", "normal"))
    share, most = limits_of(columns)
    radii = settings.a * own_radii(columns, floor, settings) * share  # before the bounds of a view
    widest = bounded(np.full(len(radii), radii.max(initial=0.0)), columns["screen"], settings)
    tree, none = cKDTree(position), np.zeros(0, np.intp)
    pairs = [(none, none, np.zeros(0))]
    for part in np.split(places, range(_AT_ONCE, len(places), _AT_ONCE)):
        near = tree.query_ball_point(position[part], widest[part])
        place, other = np.repeat(part, [len(one) for one in near]), np.concatenate([none, *near]).astype(np.intp)
        records = {"position": position[other], "normal": normal[other], "axis": columns["axis"][other]}
        reach = np.minimum(bounded(radii[other], columns["screen"][place, None], settings), most[other])
        w = weights(records, reach, position[place], normal[place], settings)
        counts = (w > 0.0) & (place != other)
        pairs.append((place[counts], other[counts], w[counts]))
    place, other, weight = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    return place, other, weight


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
    # the statistics of the cache with the fewest bounces
    by = min(states, key=lambda one: (bool(one.bounces.get("bounces_converged")), int(str(one.bounces.get("bounces", 0)))))
    return replace(states[0], records=records, bounces=by.bounces), source
