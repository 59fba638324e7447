"""The persistent record cache: where records are kept in world space, so that they outlive camera moves."""

from __future__ import annotations

import math
from collections.abc import Mapping

import moderngl
import numpy as np

from irrsplat.core.buffers import Records, Sites
from irrsplat.core.color import LUMINANCE
from irrsplat.core.vectors import unit
from irrsplat.gpu import texel_table
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import float_texture
from irrsplat.records.motion import Ride, ride, untouched
from irrsplat.scene.model import Scene

_DARK = 0.02  # of the records' mean luminance
_COLUMNS = 1024
_TEXTURES = 10  # position, normal, irradiance and radius, the six of Records.vectors, walls
_ROWS = 4  # at first; doubled whenever they are full
_VALUES = 2  # which of them holds E and R

# what is known of each record here: where it lies, in which era it was gathered, its values where `read` (else the GPU alone has
# them), in which view it was last seen, the name that it keeps when others before it go, what turns the frame that it looks in,
# what probes.py has of it (E and R; R = 0: nothing), and by how much that has changed since it was gathered
_KNOWN: dict[str, tuple[tuple[int, ...], str]] = {
    "position": ((4,), "f4"),
    "normal": ((4,), "f4"),
    "geometric": ((4,), "f4"),
    "triangle": ((), "i8"),
    "era": ((), "i8"),
    "values": ((4,), "f4"),
    "read": ((), "?"),
    "viewed": ((), "i8"),
    "name": ((), "i8"),
    "turn": ((), "i8"),
    "probes": ((4,), "f4"),
    "drift": ((), "f4"),
}
_KEPT = tuple(name for name in _KNOWN if name not in ("values", "read"))  # in files; E and R are among the textures


class RecordCache(Owner):
    """Records in the order in which they were asked for; what they hold is on the GPU, and where they lie is known here too.

    A change of what records are gathered from makes all of them `stale`; they keep what they have until `renewed`.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.count = 0
        self._known = {name: np.zeros((_ROWS * _COLUMNS, *shape), kind) for name, (shape, kind) in _KNOWN.items()}
        self.era = 0  # how often all records have become stale
        self._stale: np.ndarray | None = None  # the answer of `stale`, while it holds
        self._view = 0
        self._next = 0  # name
        self.renewals = 0  # how often records have been gathered again
        self.edits = 0  # how often records that were there have changed or gone
        self.evicted = 0  # how many records have gone by `keep`
        self.dark = 0.0  # W/m², see `gauge`
        self._textures = [float_texture(ctx, (_COLUMNS, _ROWS)) for _ in range(_TEXTURES)]
        self._limit = float_texture(ctx, (_COLUMNS, _ROWS), 1)
        self.unlimit()

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (*self._textures, self._limit)

    @property
    def records(self) -> Records:
        """The textures as they stand; valid until the next `append`."""
        position, normal, irradiance, *vectors, walls = self._textures
        return Records(position, normal, irradiance, tuple(vectors), walls, self.count, _COLUMNS, self._limit, self.dark)

    @property
    def positions(self) -> np.ndarray:
        """(N, 3) float32, where they lie: a view of the cache's own array."""
        return self._known["position"][: self.count, :3]

    # ---- more records, and what they hold ---------------------------------------------------------------------------

    def append(self, sites: Sites, values: np.ndarray | None = None) -> int:
        """Add records at `sites`; returns the first one's number.

        values: (N, 4) float32 E in W/m² and R_k in metres; without it the reduction has yet to write them on the GPU.
        """
        first, self.count = self.count, self.count + len(sites)
        self._reserve(self.count)
        new, known = slice(first, self.count), self._known
        for name, rows in (("position", sites.position), ("normal", sites.normal), ("geometric", sites.geometric)):
            known[name][new, :3] = rows
        known["triangle"][new] = -1 if sites.triangle is None else sites.triangle
        known["era"][new], known["viewed"][new], known["read"][new] = self.era, self._view, False
        known["probes"][new], known["drift"][new] = 0.0, 0.0
        known["name"][new] = self._next + np.arange(len(sites))
        known["turn"][new] = known["name"][new] if sites.turn is None else sites.turn
        self._next += len(sites)
        for texture, name in zip(self._textures, ("position", "normal"), strict=False):
            texel_table.write(texture, first, known[name][new])
        texel_table.write(self._limit, first, np.ones((len(sites), 1)))
        if values is not None:
            self._put(_VALUES, first, values)
            for i in range(3):  # a record without directions: M = E·n_k, no gradient
                self._put(3 + i, first, np.pad(sites.normal * values[:, i : i + 1], ((0, 0), (0, 1))))
                self._put(6 + i, first, np.zeros_like(values))
            self._put(9, first, np.zeros_like(values))
        return first

    def _put(self, texture: int, first: int, values: np.ndarray) -> None:
        texel_table.write(self._textures[texture], first, values)

    def _reserve(self, count: int) -> None:
        rows = self._limit.height
        if count <= rows * _COLUMNS:
            return
        while count > rows * _COLUMNS:
            rows *= 2
        for name, array in self._known.items():
            self._known[name] = np.concatenate([array, np.zeros((rows * _COLUMNS - len(array), *array.shape[1:]), array.dtype)])
        old = [*self._textures, self._limit]
        *self._textures, self._limit = made = [float_texture(self.ctx, (_COLUMNS, rows), t.components) for t in old]
        self.unlimit()
        for was, texture in zip(old, made, strict=True):
            texel_table.copy(self.ctx, was, texture)
            was.release()

    @property
    def values(self) -> np.ndarray:
        """(N, 4) float32 E in W/m² and R_k in metres, the cache's own array; what the GPU alone has yet is read first."""
        known, new = self._known, np.flatnonzero(~self._known["read"][: self.count])
        if len(new):
            rows = texel_table.read(self.ctx, self._textures[_VALUES], new[0], new[-1] + 1)
            known["values"][new], known["read"][new] = rows[new - new[0]], True
        return known["values"][: self.count]

    def read(self) -> dict[str, np.ndarray]:
        """The records as numpy arrays: `position`, `normal`, `irradiance` (N, 3) and `radius` (N,), float32."""
        values = self.values
        return {
            "position": self.positions.copy(),
            "normal": self._known["normal"][: self.count, :3].copy(),
            "irradiance": values[:, :3].copy(),
            "radius": values[:, 3].copy(),
        }

    @property
    def probes(self) -> np.ndarray:
        """(N, 4) float32, what a few directions brought of E, W/m², and R, metres (see probes.py); R = 0: not looked."""
        return self._known["probes"][: self.count]

    @property
    def drift(self) -> np.ndarray:
        """(N,) float32, how much `probes` have changed since the records were gathered; at most 1, as where nothing is known."""
        return self._known["drift"][: self.count]

    def gauge(self) -> None:
        """Set `dark` by the records that there are: a share of their mean luminance, in steps, so that it seldom changes.

        Without it a room that no light enters would be filled with records that differ by nothing but noise.
        """
        mean = float((self.values @ np.append(LUMINANCE, np.float32(0.0))).mean(dtype=float)) if self.count else 0.0
        dark = 2.0 ** math.floor(math.log2(_DARK * mean)) if mean > 0.0 else 0.0
        if dark != self.dark:
            self.dark = dark
            self.edits += 1

    def limits(self, count: int) -> np.ndarray:
        """(count,) float32: how far the first so many records may reach, as a share of their radii."""
        return texel_table.read(self.ctx, self._limit, 0, count)[:, 0]

    def unlimit(self) -> None:
        """Let every record reach as far as its own R, those to come too."""
        self._limit.write(np.ones(self._limit.width * self._limit.height, "f4").tobytes())

    def sites(self, numbers: np.ndarray | slice) -> Sites:
        """Where the records of these numbers lie."""
        triangle = self._known["triangle"][numbers]
        position, normal, geometric = (self._known[name][numbers, :3] for name in ("position", "normal", "geometric"))
        return Sites(position, normal, geometric, triangle if (triangle >= 0).all() else None, self._known["turn"][numbers])

    # ---- what is stale ----------------------------------------------------------------------------------------------

    @property
    def stale(self) -> np.ndarray:
        """The numbers of the records whose light is no longer what it was when they were gathered, the stalest first."""
        if self._stale is None:
            era = self._known["era"]
            (numbers,) = np.nonzero(era[: self.count] < self.era)
            self._stale = numbers[np.argsort(era[numbers], kind="stable")]
        return self._stale

    def age(self, numbers: np.ndarray) -> np.ndarray:
        """(N,) how often the records of these numbers have become stale since they were gathered; 0 where they are gone."""
        there = numbers < self.count
        age = np.zeros(len(numbers), np.intp)
        age[there] = self.era - self._known["era"][numbers[there]]
        return age

    def expire(self, numbers: np.ndarray | None = None) -> None:
        """Make the records of these numbers stale, or all of them; of them all, what `probes` says is no longer so."""
        era = self._known["era"][: self.count]
        fresh = era == self.era
        self.era += 1
        self._stale = None
        if numbers is None:
            self.probes[:], self.drift[:] = 0.0, 1.0
            return
        fresh[numbers] = False
        era[fresh] = self.era

    def renewed(self, numbers: np.ndarray) -> None:
        """Say that the records of these numbers have been gathered again."""
        known = self._known
        known["era"][numbers], known["read"][numbers], known["drift"][numbers] = self.era, False, 0.0
        self._stale = None
        self.renewals += 1
        self.edits += 1

    # ---- what goes --------------------------------------------------------------------------------------------------

    def truncate(self, count: int) -> None:
        """Forget every record from number `count` on; 0 forgets all."""
        if count < self.count:
            self.count, self._stale = count, None
            self._next = int(self._known["name"][count - 1]) + 1 if count else 0
            self.edits += 1

    def saw(self, numbers: np.ndarray) -> None:
        """Say that a new view has these records in it."""
        self._view += 1
        self._known["viewed"][numbers] = self._view

    @property
    def unseen(self) -> np.ndarray:
        """(N,) for how many views each record has not been in any."""
        return self._view - self._known["viewed"][: self.count]

    def keep(self, numbers: np.ndarray) -> None:
        """Forget all records but those of these numbers, ascending, which close ranks in their order. Gathered again, they look
        in the same directions as before."""
        if len(numbers) == self.count:
            return
        for array in self._known.values():
            array[: len(numbers)] = array[numbers]
        for texture in (*self._textures, self._limit):
            texel_table.write(texture, 0, texel_table.read(self.ctx, texture, 0, self.count)[numbers])
        self.evicted += self.count - len(numbers)
        self.count, self._stale = len(numbers), None
        self.edits += 1

    def follow(self, before: Scene, after: Scene) -> np.ndarray:
        """Meshes have moved: records on them move along, with what they hold. Returns the numbers of those that are to be kept,
        which are not close to what has moved."""
        known = {name: array[: self.count] for name, array in self._known.items()}
        kept = untouched(self.positions, known["geometric"][:, :3], known["triangle"], before, after)
        moved = ride(self.positions, known["triangle"], before, after)
        if len(moved.numbers):
            self.positions[moved.numbers] = moved.position
            for name in ("normal", "geometric"):
                known[name][moved.numbers, :3] = moved.normals(known[name][moved.numbers, :3])
            for texture, name in zip(self._textures, ("position", "normal"), strict=False):
                texel_table.write(texture, 0, known[name])
            self._turn_vectors(moved)
            self.probes[moved.numbers[~moved.rigid]] = 0.0
            self.edits += 1
        return np.flatnonzero(kept)

    def _turn_vectors(self, moved: Ride) -> None:
        """Take along what records say by directions: M, ∇E, and the axis, of which each texture of M has a component."""
        textures = self._textures[3:9]
        content = [texel_table.read(self.ctx, t, 0, self.count).copy() for t in textures]
        axis = np.stack([rows[moved.numbers, 3] for rows in content[:3]], axis=-1)
        axis = unit(np.einsum("nij,nj->ni", moved.turn, axis))
        for i, (texture, rows) in enumerate(zip(textures, content, strict=True)):
            rows[moved.numbers, :3] = np.einsum("nij,nj->ni", moved.turn, rows[moved.numbers, :3])
            if i < 3:
                rows[moved.numbers, 3] = axis[:, i]
            texel_table.write(texture, 0, rows)

    def find(self, name: int) -> int | None:
        """The number that the record of this name has now; None where it is gone."""
        names = self._known["name"][: self.count]
        number = int(np.searchsorted(names, name))
        return number if number < self.count and names[number] == name else None

    def name(self, number: int) -> int:
        """The name of a record, which it keeps whatever goes before it; its number, as long as nothing does."""
        return int(self._known["name"][number])

    # ---- files ------------------------------------------------------------------------------------------------------

    def state(self, stale: bool = False) -> dict[str, np.ndarray]:
        """All that there is to the records, as arrays: what `restore` goes on from as if nothing had happened.

        stale: there, all of them are stale.
        """
        kept = {name: self._known[name][: self.count].copy() for name in _KEPT}
        textures = [texel_table.read(self.ctx, t, 0, self.count) for t in self._textures[_VALUES:]]
        limit = texel_table.read(self.ctx, self._limit, 0, self.count)
        clocks = np.array([self.era + stale, self._view, self._next])
        return {**kept, "content": np.stack(textures, axis=1), "limit": limit, "clocks": clocks, "dark": np.array(self.dark)}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Hold the records of `state`, and no others. Raises KeyError or ValueError, and changes nothing, where it is none."""
        check_state(state)
        count = len(state["name"])
        self.truncate(0)
        self._reserve(count)
        self.count, self._stale, self.dark = count, None, float(state["dark"])
        self.era, self._view, self._next = (int(clock) for clock in state["clocks"])
        for name in _KEPT:
            self._known[name][:count] = state[name]
        self._known["read"][:count] = False
        content = np.moveaxis(state["content"], 1, 0)
        values = [self._known["position"][:count], self._known["normal"][:count], *content, state["limit"]]
        for texture, rows in zip((*self._textures, self._limit), values, strict=True):
            texel_table.write(texture, 0, rows)
        self.edits += 1


def check_state(state: Mapping[str, np.ndarray]) -> None:
    """Raises KeyError or ValueError where the arrays of RecordCache.state are incomplete, of wrong shape or not finite."""
    count = len(state["name"])
    shapes = {name: (count, *shape) for name, (shape, _) in _KNOWN.items() if name in _KEPT}
    shapes |= {"content": (count, _TEXTURES - _VALUES, 4), "limit": (count, 1), "clocks": (3,), "dark": ()}
    for name, shape in shapes.items():
        if state[name].shape != shape or not np.isfinite(state[name]).all():
            raise ValueError(name)
