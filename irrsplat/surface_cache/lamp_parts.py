"""What single lamps bring, apart from all other light: since light is a sum over its sources, a lamp whose part is known may be
dimmed and recoloured without gathering anything.

A part is gathered as everything else is, along the same rays, while its lamp alone shines, SCALE times as bright as white 1; what
else shines is so little beside it that it does not count.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import moderngl
import numpy as np

from irrsplat.core.buffers import LIGHT_ROWS, LightRow, ShadowMaps
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.change import SceneChange
from irrsplat.scene.model import Light
from irrsplat.surface_cache.lookup_table import LookupTable

SCALE = 2.0**24
_LOSS = 0.5  # of what is left: where other rays took more than that away, their noise may show
MOST = 4  # lamps whose parts are kept
LINEAR = ("irradiance", "vectors", "gradient")


def uncoloured(light: Light) -> Light:
    """The lamp without its colour and name: what its part depends on."""
    plain = replace(light, color=(1.0, 1.0, 1.0), name="")
    vectors = {name: tuple(value) for name, value in vars(plain).items() if isinstance(value, list)}  # to be keys they are tuples
    return replace(plain, **vectors) if vectors else plain  # type: ignore[arg-type]


def recoloured(change: SceneChange) -> dict[Light, np.ndarray] | None:
    """By how much the colours (3,) of which lamps have changed, where nothing else has; None where something has."""
    old, new = change.old.lights, change.new.lights
    if not change.by_lamps_alone:
        return None
    found: dict[Light, np.ndarray] = {}
    for a, b in zip(old, new, strict=True):
        lamp = uncoloured(a)
        if lamp != uncoloured(b):
            return None
        if a.color != b.color:
            found[lamp] = found.get(lamp, np.zeros(3)) + np.subtract(b.color, a.color)
    return found


def alone(shadows: ShadowMaps, lights: tuple[Light, ...], lamp: Light) -> ShadowMaps:
    """The shadow maps of these lights, of which `lamp` alone shines, white and SCALE times as bright as 1."""
    table, number = shadows.table.copy(), [uncoloured(light) for light in lights].index(lamp)
    table[LightRow.COLOR :: LIGHT_ROWS, :3] = 0.0
    table[number * LIGHT_ROWS + LightRow.COLOR, :3] = SCALE * (1.0 if lamp.physical else np.pi)
    return replace(shadows, table=table)


@dataclass(frozen=True, eq=False)
class SitePart:
    """A lamp's part of the surface cache for the colour white 1, (S, 3) each: E_1, E of all bounces, the lamp's direct light D
    and, where it is followed, c beyond what F makes of that (see Follower)."""

    E_1: np.ndarray
    E: np.ndarray
    D: np.ndarray | None
    beyond: np.ndarray | None


class LampPart(Owner):
    """The part of one lamp. records: what it brings to records, times SCALE; ids, sizes: which these are in their cache, and the
    sides of their gathers. site_records: the same of sites, of which the first `sites_done` are gathered; sites: their values
    once all of them are; `table` finds E, times SCALE."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.records, self.site_records = RecordCache(ctx), RecordCache(ctx)
        self.ids, self.sizes = np.zeros(0, np.int64), np.zeros(0, np.int64)
        self.sites_done = 0
        self.sites: SitePart | None = None
        self.table: LookupTable | None = None

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.records, self.site_records, self.table)

    def rows(self, cache: RecordCache) -> np.ndarray:
        """(N,) for each record of the cache the number of its part here; -1 where it is not known."""
        rows = np.full(cache.count, -1)
        if not len(self.ids) or not cache.count:
            return rows
        order = np.argsort(self.ids, kind="stable")
        found = order[np.maximum(np.searchsorted(self.ids[order], cache.ids, side="right") - 1, 0)]  # the last of equal ones
        same = (self.ids[found] == cache.ids) & (self.records.positions[found] == cache.positions).all(1)
        rows[same] = found[same]
        return rows

    def unknown(self, cache: RecordCache) -> np.ndarray:
        """The numbers of those records of the cache whose part is not known here."""
        return np.flatnonzero(self.rows(cache) < 0)

    def note(self, ids: np.ndarray, sizes: np.ndarray) -> None:
        """Records of these ids and sides have been added to `records`."""
        self.ids, self.sizes = np.append(self.ids, ids), np.append(self.sizes, sizes)

    def add(self, cache: RecordCache, rows: np.ndarray, colour: np.ndarray, alike: bool) -> np.ndarray:
        """Let the records of the cache whose parts are known, by `rows`, hold so much more of the lamp, (3,).

        alike: whether they were lit by such a surface cache as their parts. Returns the numbers of those that are to be gathered
        again: they come from other rays than their parts, and have lost so much of their light that the noise of both may show.
        """
        numbers = np.flatnonzero(rows >= 0)
        found, part, f = cache.gathered(*LINEAR), self.records.gathered(*LINEAR), colour / SCALE
        after = {
            name: found[name][numbers] + (f if name == "irradiance" else f[:, None]) * part[name][rows[numbers]]
            for name in LINEAR
        }
        after["irradiance"] = np.maximum(after["irradiance"], 0.0)
        cache.correct({name: values.astype(np.float32) for name, values in after.items()}, numbers)
        cache.probes[numbers] = 0.0
        lost = np.maximum(found["irradiance"][numbers] - after["irradiance"], 0.0).max(1)
        other_rays = (self.sizes[rows[numbers]] != cache.gather_sizes[numbers]) | (not alike)
        cache.refresh_count += 1
        lossy: np.ndarray = numbers[other_rays & (lost > _LOSS * after["irradiance"].max(1))]
        return lossy


def brighten(cache: RecordCache, brighter: Mapping[LampPart, np.ndarray], alike: bool) -> None:
    """Let all records of the cache hold so much more of these lamps, colours (3,), and make those stale of which it is not known
    how much that is. alike: whether they were lit by such a surface cache as their parts."""
    rows = {part: part.rows(cache) for part in brighter}
    known = np.all([found >= 0 for found in rows.values()], axis=0)
    stale = ~known
    for part, colour in brighter.items():
        stale[part.add(cache, np.where(known, rows[part], -1), colour, alike)] = True
    if stale.any():
        cache.due[stale] += 1.0
        cache.invalidate(np.flatnonzero(stale))


class LampParts(Owner):
    """The parts of those lamps whose colours have changed last, MOST of them."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self._parts: dict[Light, LampPart] = {}

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return tuple(self._parts.values())

    def __iter__(self) -> Iterator[tuple[Light, LampPart]]:
        return iter(list(self._parts.items()))

    def of(self, colours: Mapping[Light, np.ndarray], with_sites: bool) -> dict[LampPart, np.ndarray] | None:
        """The parts of these lamps with their `colours`; None where one is not known yet, or `with_sites` not that of sites."""
        if any(lamp not in self._parts for lamp in colours):
            return None
        parts = {self._parts[lamp]: colour for lamp, colour in colours.items()}
        return parts if all(part.ids.size and (part.sites is not None) >= with_sites for part in parts) else None

    def follow(self, change: SceneChange, same_settings: bool) -> None:
        """Keep the parts while only colours change, and begin those of lamps that have been recoloured."""
        lately = recoloured(change)
        if not same_settings or (change and lately is None):
            keep: list[Light] = []
        else:
            keep = list(dict.fromkeys([*(lately or {} if change.dimming is None else {}), *self._parts]))[:MOST]
        for lamp in set(self._parts) - set(keep):
            self._parts.pop(lamp).release()
        self._parts = {lamp: self._parts.get(lamp) or LampPart(self.ctx) for lamp in keep}

    def forget(self) -> None:
        """Free them all."""
        while self._parts:
            self._parts.popitem()[1].release()
