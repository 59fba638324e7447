"""The persistent record cache: where records are kept in world space, so that they outlive camera moves."""

from __future__ import annotations

import math

import moderngl
import numpy as np

from irrsplat.buffers import Records, Sites
from irrsplat.display import LUMINANCE
from irrsplat.gpu.holder import Holder
from irrsplat.gpu.target import float_texture
from irrsplat.scene.build import unit
from irrsplat.scene.model import Scene
from irrsplat.scene.motion import Ride, ride, untouched

_DARK = 0.02  # of the records' mean luminance
_COLUMNS = 1024
_TEXTURES = 10  # position, normal, irradiance and radius, the six of Records.vectors, walls
_KNOWN = ("_position", "_normal", "_geometric", "_triangle", "_era", "_probes", "_drift", "_name")  # of each record, here
_ROWS = 4  # at first; doubled whenever they are full


class RecordCache(Holder):
    """Records in the order in which they were asked for: where they lie is known here too, E and R on the GPU alone.

    A change of what records are gathered from makes all of them `stale`; they keep what they have until `renewed`.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.count = 0
        self._position = np.zeros((_ROWS * _COLUMNS, 4), "f4")
        self._normal = np.zeros_like(self._position)
        self._geometric = np.zeros_like(self._position)
        self._triangle = np.zeros(len(self._position), np.intp)
        self._era = np.zeros(len(self._position), np.intp)  # in which each record was gathered
        self._probes = np.zeros_like(self._position)  # what probes.py has of it, E and R; R = 0: nothing
        self._drift = np.zeros(len(self._position), "f4")  # by how much that has changed since it was gathered
        self._name = np.zeros(len(self._position), np.intp)  # its number at first; it turns the frame that it looks in
        self.era = 0  # how often all records have become stale
        self.renewals = 0  # how often records have been gathered again
        self.edits = 0  # how often records that were there have changed or gone
        self.dark = 0.0  # W/m², see `gauge`
        self._textures = [float_texture(ctx, (_COLUMNS, _ROWS)) for _ in range(_TEXTURES)]
        self._limit = float_texture(ctx, (_COLUMNS, _ROWS), 1)
        self.unlimit()

    @property
    def records(self) -> Records:
        """The textures as they stand; valid until the next `append`."""
        position, normal, irradiance, *vectors, walls = self._textures
        return Records(position, normal, irradiance, tuple(vectors), walls, self.count, _COLUMNS, self._limit, self.dark)

    def append(self, sites: Sites, values: np.ndarray | None = None) -> int:
        """Add records at `sites`; returns the first one's number.

        values: (N, 4) float32 E in W/m² and R_k in metres; without it the reduction has yet to write them on the GPU.
        """
        first, self.count = self.count, self.count + len(sites)
        self._reserve(self.count)
        self._position[first : self.count, :3] = sites.position
        self._normal[first : self.count, :3] = sites.normal
        self._geometric[first : self.count, :3] = sites.geometric
        self._triangle[first : self.count] = -1 if sites.triangle is None else sites.triangle
        self._era[first : self.count] = self.era
        self._probes[first : self.count], self._drift[first : self.count] = 0.0, 0.0
        name = (self._name[first - 1] + 1 if first else 0) + np.arange(len(sites))
        self._name[first : self.count] = name if sites.turn is None else sites.turn
        low, high = first // _COLUMNS, -(-self.count // _COLUMNS)
        for texture, rows in zip(self._textures, (self._position, self._normal), strict=False):
            part = rows[low * _COLUMNS : high * _COLUMNS]
            texture.write(part.tobytes(), viewport=(0, low, _COLUMNS, high - low))
        if values is not None:
            self._put(2, first, values)
            for i in range(3):  # a record without directions: M = E·n_k, no gradient
                self._put(3 + i, first, np.pad(sites.normal * values[:, i : i + 1], ((0, 0), (0, 1))))
                self._put(6 + i, first, np.zeros_like(values))
            self._put(9, first, np.zeros_like(values))
        return first

    def _put(self, texture: int, first: int, values: np.ndarray) -> None:
        whole = np.frombuffer(self._textures[texture].read(), "f4").reshape(-1, 4).copy()
        whole[first : first + len(values)] = values
        self._textures[texture].write(whole.tobytes())

    def _reserve(self, count: int) -> None:
        rows = len(self._position) // _COLUMNS
        if count <= rows * _COLUMNS:
            return
        while count > rows * _COLUMNS:
            rows *= 2
        more = rows * _COLUMNS - len(self._position)
        for name in _KNOWN:
            array = getattr(self, name)
            setattr(self, name, np.pad(array, ((0, more),) + ((0, 0),) * (array.ndim - 1)))
        old, self._textures = self._textures, [float_texture(self.ctx, (_COLUMNS, rows)) for _ in range(_TEXTURES)]
        for texture, was in zip(self._textures, old, strict=True):
            texture.write(was.read(), viewport=(0, 0, *was.size))
            was.release()
        was, self._limit = self._limit, float_texture(self.ctx, (_COLUMNS, rows), 1)
        self.unlimit()
        self._limit.write(was.read(), viewport=(0, 0, *was.size))
        was.release()

    def read(self) -> dict[str, np.ndarray]:
        """The records as numpy arrays: `position`, `normal`, `irradiance` (N, 3) and `radius` (N,), float32."""
        last = self._last()
        return {
            "position": self._position[: self.count, :3].copy(),
            "normal": self._normal[: self.count, :3].copy(),
            "irradiance": last[:, :3].copy(),
            "radius": last[:, 3].copy(),
        }

    def _last(self) -> np.ndarray:
        """(N, 4) float32 E in W/m² and R_k in metres."""
        return np.frombuffer(self._textures[2].read(), "f4").reshape(-1, 4)[: self.count]

    @property
    def probes(self) -> np.ndarray:
        """(N, 4) float32, what a few directions brought of E, W/m², and R, metres (see probes.py); R = 0: not looked."""
        return self._probes[: self.count]

    @property
    def drift(self) -> np.ndarray:
        """(N,) float32, how much `probes` have changed since the records were gathered; at most 1, as where nothing is known."""
        return self._drift[: self.count]

    def gauge(self) -> None:
        """Set `dark` by the records that there are: a share of their mean luminance, in steps, so that it seldom changes.

        Without it a room that no light enters would be filled with records that differ by nothing but noise.
        """
        mean = float((self._last()[:, :3] @ LUMINANCE).mean(dtype=float)) if self.count else 0.0
        dark = 2.0 ** math.floor(math.log2(_DARK * mean)) if mean > 0.0 else 0.0
        if dark != self.dark:
            self.dark = dark
            self.edits += 1

    def limits(self, count: int) -> np.ndarray:
        """(count,) float32: how far the first so many records may reach, as a share of their radii."""
        return np.frombuffer(self._limit.read(), "f4")[:count]

    def unlimit(self) -> None:
        """Let every record reach as far as its own R, those to come too."""
        self._limit.write(np.ones(self._limit.width * self._limit.height, "f4").tobytes())

    @property
    def stale(self) -> np.ndarray:
        """The numbers of the records whose light is no longer what it was when they were gathered, the stalest first."""
        (numbers,) = np.nonzero(self._era[: self.count] < self.era)
        return numbers[np.argsort(self._era[numbers], kind="stable")]

    def age(self, numbers: np.ndarray) -> np.ndarray:
        """(N,) how often the records of these numbers have become stale since they were gathered; 0 where they are gone."""
        there = numbers < self.count
        age = np.zeros(len(numbers), np.intp)
        age[there] = self.era - self._era[numbers[there]]
        return age

    def expire(self, numbers: np.ndarray | None = None) -> None:
        """Make the records of these numbers stale, or all of them; of them all, what `probes` says is no longer so."""
        fresh = self._era[: self.count] == self.era
        self.era += 1
        if numbers is None:
            self._probes[: self.count], self._drift[: self.count] = 0.0, 1.0
            return
        fresh[numbers] = False
        self._era[: self.count][fresh] = self.era

    def renewed(self, numbers: np.ndarray) -> None:
        """Say that the records of these numbers have been gathered again."""
        self._era[numbers], self._drift[numbers] = self.era, 0.0
        self.renewals += 1
        self.edits += 1

    def sites(self, numbers: np.ndarray | slice) -> Sites:
        """Where the records of these numbers lie."""
        triangle = self._triangle[numbers]
        position, normal, geometric = (array[numbers, :3] for array in (self._position, self._normal, self._geometric))
        return Sites(position, normal, geometric, triangle if (triangle >= 0).all() else None, self._name[numbers])

    def keep(self, numbers: np.ndarray) -> None:
        """Forget all records but those of these numbers, ascending, which close ranks in their order. Gathered again, they look
        in the same directions as before."""
        if len(numbers) == self.count:
            return
        for name in _KNOWN:
            array = getattr(self, name)
            array[: len(numbers)] = array[numbers]
        for texture in (*self._textures, self._limit):
            rows = np.frombuffer(texture.read(), "f4").reshape(-1, texture.components).copy()
            rows[: len(numbers)] = rows[numbers]
            texture.write(rows.tobytes())
        self.count = len(numbers)
        self.edits += 1

    def follow(self, before: Scene, after: Scene) -> None:
        """Meshes have moved: records on them move along, with what they hold; those that are close by are forgotten."""
        position, geometric, triangle = (a[: self.count] for a in (self._position, self._geometric, self._triangle))
        kept = untouched(position[:, :3], geometric[:, :3], triangle, before, after)
        moved = ride(position[:, :3], triangle, before, after)
        if len(moved.numbers):
            position[moved.numbers, :3] = moved.position
            for normals in (self._normal, self._geometric):
                normals[moved.numbers, :3] = moved.normals(normals[moved.numbers, :3])
            for texture, rows in zip(self._textures, (self._position, self._normal), strict=False):
                texture.write(rows.tobytes())
            self._turn_vectors(moved)
            self._probes[moved.numbers[~moved.rigid]] = 0.0
            self.edits += 1
        self.keep(np.flatnonzero(kept))

    def _turn_vectors(self, moved: Ride) -> None:
        """Take along what records say by directions: M, ∇E, and the axis, of which each texture of M has a component."""
        textures = self._textures[3:9]
        content = [np.frombuffer(t.read(), "f4").reshape(-1, 4).copy() for t in textures]
        axis = np.stack([rows[moved.numbers, 3] for rows in content[:3]], axis=-1)
        axis = unit(np.einsum("nij,nj->ni", moved.turn, axis))
        for i, (texture, rows) in enumerate(zip(textures, content, strict=True)):
            rows[moved.numbers, :3] = np.einsum("nij,nj->ni", moved.turn, rows[moved.numbers, :3])
            if i < 3:
                rows[moved.numbers, 3] = axis[:, i]
            texture.write(rows.tobytes())

    def truncate(self, count: int) -> None:
        """Forget every record from number `count` on; 0 forgets all."""
        if count < self.count:
            self.count = count
            self.edits += 1

    def release(self) -> None:
        """Free the textures."""
        for texture in (*self._textures, self._limit):
            texture.release()
