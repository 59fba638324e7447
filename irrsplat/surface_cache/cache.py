"""The surface cache: irradiance at sites spread over all surfaces, seen or not, which what records see is lit by.

It holds E_(N−1) where records are to hold E_N, and is made once for all views, bounce by bounce: rays from every site tell what
light comes to it first, and which other sites they meet; from then on all is sums.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, HitLight, ShadowMaps, Sites, TriangleOrder
from irrsplat.gather.hemicube import frames
from irrsplat.gather.look import gather_records
from irrsplat.gather.record_frame import OFFSET
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.trace import TraceGather
from irrsplat.gather.world import World
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.time_budget import Budget, Pace
from irrsplat.gpu.timers import Timers
from irrsplat.lighting.light_table import light_defines
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.flatten import flatten
from irrsplat.settings import Settings
from irrsplat.surface_cache import clustering
from irrsplat.surface_cache.lookup_table import Lookup
from irrsplat.surface_cache.tessellation import Lattice, lattice
from irrsplat.surface_cache.transport import Bounced, Transport, bounces
from irrsplat.surface_cache.view import SurfaceViewPass
from irrsplat.surface_cache.visibility import VisibilityPass

POINTS = 2000  # of a side of all surfaces, about
SIDE = 16  # side² rays a site
MOST = 4096  # sites
_ROUNDS = 4  # in which members that do not see their site find others
_BATCH = 128  # sites gathered at once, at most
_SKY, _DARK = 0, 1  # the numbers of the values of all that sees nothing but the sky, and of what no light reaches
_ANY = 3  # as shaders/surface_cache/lookup.glsl has it
_CHANCES = 4  # sites that a member tries of those that face otherwise
_FIRST = 0.6  # of MOST: sites at first, before those are made that members who do not see theirs need
_VOXEL = 0.7  # of the spacing: how near members of one site lie
_LEAST = 0.02  # of the spacing squared: what is smaller gets a site of its own only where there are some left


class SurfaceCache(Owner):
    """The surface cache of a world's scene."""

    def __init__(self, world: World, settings: Settings, timers: Timers) -> None:
        ctx, scene = world.ctx, world.scene
        self.ctx, self.scene, self.settings, self.timers = ctx, scene, settings, timers
        self.world, self.tree = world, world.tree
        self.offset = OFFSET * scene.diagonal
        self.sight = VisibilityPass(ctx)
        self.look = self._look()
        self.reduce = ReducePass(ctx, gradients=False)
        self.records = RecordCache(ctx)  # one for each value, in their order
        self.seen = SurfaceViewPass(ctx)
        self.pace = Pace(ctx)
        self.result: Bounced | None = None  # what the values hold
        self.whole = False  # whether that is what settings and lights ask for
        self._preparing: Iterator[float] | None = None
        self._share = 0.0  # of the preparation
        self._sealed = clustering.sealed(scene)
        self.lattice: Lattice | None = None
        self.transport: Transport | None = None
        self._area, self._unknown = np.zeros(1), np.zeros(1, bool)  # m² of each site; whether its row in `transport` is missing
        self._bouncing: Iterator[Bounced] | None = None
        self._viewed: tuple[GBuffer, Bounced | None, moderngl.Texture] | None = None
        nothing = Lookup(ctx, np.zeros((0, 3, 4)), np.zeros((0, 2, 4)), 1, np.zeros(0, np.intp))
        self.lookup = self.making = nothing  # the one in use, and the one whose values are not made yet, or the same

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.sight, self.look, self.reduce, self.records, self.seen, self.lookup, self.making)

    def _look(self) -> TraceGather:
        return TraceGather(self.world, SIDE, _BATCH, surface=True, hits=True)

    def uniforms(self, lookup: Lookup | None = None) -> dict[TriangleOrder, dict[str, Any]]:
        """The uniforms of surface_cache/lookup.glsl and lib/bvh.glsl, for triangles numbered either way."""
        common = {**self.tree.ray_uniforms, "surface_offset": self.offset}
        orders: tuple[TriangleOrder, ...] = ("scene", "tree")
        return {order: {**common, **(lookup or self.lookup).uniforms(order)} for order in orders}

    @property
    def sites(self) -> Sites:
        """Where the values were gathered; none while they are those of sites that are being replaced."""
        return self.records.sites(slice(_DARK + 1, self.records.count if self.lookup is self.making else 0))

    @property
    def share(self) -> float:
        """How much of the making is done, 0..1."""
        if self.whole or not self.records.count:
            return float(self.whole) or 0.5 * self._share
        return 0.5 + 0.49 * (1.0 - len(self.records.stale) / self.records.count)

    def view(self, gbuffer: GBuffer) -> moderngl.Texture:
        """What the cache says of every pixel, as SurfaceViewPass has it; valid until the next call."""
        if self._viewed is None or self._viewed[0] is not gbuffer or self._viewed[1] is not self.result:
            self._viewed = gbuffer, self.result, self.seen(gbuffer, self.uniforms()["scene"])
        return self._viewed[2]

    # ---- what changes ----------------------------------------------------------------------------------------------

    def change(self, settings: Settings) -> None:
        """Go on with other settings, and with the world as it is now, relit or moved; what depends on them is made again by
        `advance`.

        Until then the values are those from before, on what has moved too.
        """
        scene = self.world.scene
        old, before, self.settings, self.scene = self.settings, self.scene, settings, scene
        if light_defines(before) != light_defines(scene):
            self.look.release()
            self.look = self._look()
        relit, moved = before.lights != scene.lights, before.meshes is not scene.meshes
        if old.seed != settings.seed or old.shadow_size != settings.shadow_size or relit or moved:
            self.expire()
        if moved:
            self.offset = OFFSET * scene.diagonal
            self.lookup.follow(self.tree.corners, self.tree.order)
        sealed = clustering.sealed(scene) if relit or moved else self._sealed
        if moved or not np.array_equal(self._sealed, sealed):  # a lamp went in somewhere, or out
            self._sealed, self.lattice, self._preparing = sealed, None, None
        if old.seed != settings.seed or self.lattice is None:
            self.transport = None
        if old.bounces != settings.bounces:
            self._bouncing, self.whole = None, False

    def expire(self) -> None:
        """Gather all again."""
        self.records.invalidate()
        self._bouncing, self.whole = None, False

    # ---- making ----------------------------------------------------------------------------------------------------

    def advance(self, shadows: ShadowMaps, budget: Budget) -> bool:
        """Go on making it while the budget lasts; True where that has changed the values, which are then whole."""
        if self.whole:
            return False
        try:
            with self.timers("surface"):
                while self.lattice is None:
                    self._preparing = self._preparing or self._prepare()
                    self._share = next(self._preparing, 1.0)
                    if budget.left <= 0.0:
                        return False
                self._gather(shadows, budget)
                if len(self.records.stale):
                    return False
                if not self._bounce(budget):
                    return False
        except BaseException:
            self._preparing = self._bouncing = None  # a generator that was interrupted is over
            raise
        return True

    def _prepare(self) -> Iterator[float]:
        """Choose the sites and make the tables that find them; yields the share that is done, now and then."""
        cut, some, names, spacing = yield from self._cut()
        area = np.tile(cut.area, 2)
        value, sites = yield from self._share_out(cut, some, names, area, spacing)
        yield 0.7
        self._area = np.bincount(np.maximum(value, 0), weights=area * (value > _DARK), minlength=len(sites)).astype(float)
        self.records.truncate(0)
        if len(some):
            self.records.append(Sites(some.position[sites], some.normal[sites], some.geometric[sites]))
            self.records.invalidate()
        cells = yield from self._cells(cut, some, value)
        if self.making is not self.lookup:
            self.making.release()
        self.lattice, self.making = cut, Lookup(self.ctx, cut.table, cells, MOST, self.tree.order)

    def _cut(self) -> Any:
        """The lattice, its members and their keys, and its spacing in metres: by the surfaces' area, or wider where too many
        sites would come of it.

        A generator that returns them."""
        vertices, faces, _ = flatten(self.scene)
        a, b, c = vertices[faces, :3].astype(float).swapaxes(0, 1)
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
        spacing = float(np.sqrt(2.0 * area / POINTS)) or 1.0  # a lattice of right-angled triangles has two points per spacing²
        while True:
            cut = lattice(vertices, faces, spacing, self.offset)
            yield 0.05
            some = clustering.members(cut, self.offset)
            left, names = np.flatnonzero(self._given(cut, some) < 0), clustering.keys(some, _VOXEL * spacing)
            area = np.tile(cut.area, 2)[left]
            best, _ = clustering.choose(names[left], some.position[left], area, _LEAST * spacing**2, len(left))
            yield 0.05
            if len(best) <= _FIRST * MOST:
                return cut, some, names, spacing
            spacing *= 1.05 * float(np.sqrt(len(best) / (_FIRST * MOST)))

    def _given(self, cut: Lattice, some: clustering.Members) -> np.ndarray:
        """(M,) the numbers of the members' values where they are known beforehand, else -1."""
        value = np.where(clustering.outside(some, self.scene.bounds), _SKY, -1)
        value[len(cut.face) + np.flatnonzero(self._sealed[cut.face])] = _DARK
        return value

    def _share_out(self, cut: Lattice, some: clustering.Members, names: np.ndarray, area: np.ndarray, spacing: float) -> Any:
        """The number of each member's value, -1: none, and which members are the sites; a generator that returns them."""
        value = self._given(cut, some)
        left, sites = np.flatnonzero(value < 0), np.zeros(_DARK + 1 if len(some) else 0, np.intp)
        for number in range(_ROUNDS):
            least = _LEAST * spacing**2 if number < _ROUNDS - 1 else 0.0
            best, whose = clustering.choose(names[left], some.position[left], area[left], least, MOST - len(sites))
            if not len(best):
                continue
            best = left[best]
            asking = np.flatnonzero(whose >= 0)
            seen = np.zeros(len(left), bool)
            seen[asking] = yield from self._sees(some, left[asking], best[whose[asking]])
            value[left[seen]] = len(sites) + whose[seen]
            left, sites = left[~seen], np.concatenate([sites, best])
        known = sites[_DARK + 1 :]
        member, site = clustering.others(some, names, left, known, _CHANCES)
        seen = yield from self._sees(some, left[member], known[site])
        value[left[member[seen][::-1]]] = _DARK + 1 + site[seen][::-1]  # of several the first is written last
        return value, sites

    def _cells(self, cut: Lattice, some: clustering.Members, value: np.ndarray) -> Any:
        """(C, 2, 4) the table of cells, as lookup.glsl has it: numbers of values, and which corners do not see each other,
        because something stands on the cell. A generator that returns it."""
        table = np.zeros((cut.cells, 2, 4), np.float32)
        for side, cells in enumerate(table.swapaxes(0, 1)):
            ends = cut.corners + side * len(cut.face)
            cells[:, :3] = value[ends]
            unlike = np.flatnonzero((value[ends] != value[ends[:, :1]]).any(1))
            free = np.ones((len(unlike), 3), bool)  # of each corner the edge across
            for k in range(3):
                free[:, k] = yield from self._sees(some, ends[unlike, k - 2], ends[unlike, k - 1])
            cells[unlike, 3] = np.where(free.all(1), 0, np.where(free.sum(1) == 1, 1 + np.argmax(free, axis=1), 1 + _ANY))
        return table

    def _sees(self, some: clustering.Members, a: np.ndarray, b: np.ndarray) -> Any:
        """Whether members a see members b (N,); a generator that returns it, and yields from batch to batch."""
        seen = np.ones(len(a), bool)
        for start in range(0, len(a), self.sight.capacity):
            part = slice(start, start + self.sight.capacity)
            seen[part] = self.sight(self.tree.ray_uniforms, clustering.ways(some, a[part], b[part])) | (a[part] == b[part])
            yield 0.2
        return seen

    def _gather(self, shadows: ShadowMaps, budget: Budget) -> None:
        """E_1 at the sites that lack it, and the rays that they send to each other."""
        if self.settings.most_bounces > 2 and self.transport is None:
            self.transport = Transport(self.records.count)
            self.records.invalidate()
            self._unknown = np.ones(self.records.count, bool)
        numbers = self.records.stale
        self.records.mark_refreshed(numbers[numbers <= _DARK])
        numbers, done = numbers[numbers > _DARK], 0
        light, seed = HitLight(shadows, self.uniforms(self.making)), self.settings.seed
        for count in self.pace.batches(len(numbers), self.look.capacity, budget):
            some = numbers[done : done + count]
            gather_records(self.look, self.reduce, light, self.records, some, seed)
            if self.transport is not None and self._unknown[some].any():
                self.transport.fill(some, self._shares(self.records.sites(some), some), self.look.hits(count))
                self._unknown[some] = False
            self.records.mark_refreshed(some)
            done += count

    def _shares(self, sites: Sites, numbers: np.ndarray) -> np.ndarray:
        """(N, R) cosθ·dω of the rays of sites, 0 for those below the surface."""
        frame = frames(sites.normal, sites.frame_rotations(numbers), self.settings.seed)
        below = np.einsum("nij,nj->ni", frame, sites.geometric) @ self.look.ways.T <= 0.0
        return np.where(below, 0.0, self.look.share.ravel())

    def _bounce(self, budget: Budget) -> bool:
        """All bounces from E_1, one after the other; True where they are made, and the values hold them."""
        settings = self.settings
        if self._bouncing is None:
            E_1 = self.records.read()["irradiance"]
            E_1[: _DARK + 1] = np.pi * np.outer([1.0, 0.0], self.scene.sky)[: len(E_1)]  # _SKY, _DARK
            transport = self.transport if settings.most_bounces > 2 else None
            self._bouncing = bounces(E_1, transport, self._area, settings.most_bounces, settings.bounces == "all")
        made = next(self._bouncing)
        while not made.whole:
            if budget.left <= 0.0:
                return False
            made = next(self._bouncing)
        self._bouncing, self.whole, self.result = None, True, made
        self.making.write(made.irradiance)
        if self.lookup is not self.making:
            self.lookup.release()
            self.lookup = self.making
        return True
