"""The surface cache: irradiance at sites spread over all surfaces, seen or not, which light what records see.

It holds E_(N−1) where records are to hold E_N, and is made once for all views: sites are chosen, rays from every site tell what
light comes to it first and which other sites they meet, and from then on all bounces are sums.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass, replace

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, HitLight, ShadowMaps, Sites, TriangleOrder, Uniforms
from irrsplat.gather.autotune import ray_kind
from irrsplat.gather.look import gather_records
from irrsplat.gather.record_frame import OFFSET, tangent_frames
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.time_budget import Budget, Pace
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.lighting.emitter_table import emitter_table
from irrsplat.lighting.light_table import light_defines
from irrsplat.records.dimming import dim
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.change import SceneChange
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings
from irrsplat.surface_cache.clustering import unlit_interiors
from irrsplat.surface_cache.follower import Follower
from irrsplat.surface_cache.lamp_parts import SCALE, LampPart, SitePart
from irrsplat.surface_cache.lookup_table import LookupTable, unknown
from irrsplat.surface_cache.site_layout import DARK_VALUE, FIRST_SITE, MAX_SITES, SKY_VALUE, SiteChooser, SiteLayout
from irrsplat.surface_cache.site_splitting import SiteSplitter, SplitLayout, leaves_of
from irrsplat.surface_cache.transport import BouncedLight, Transport, sum_bounces
from irrsplat.surface_cache.view import SurfaceViewPass
from irrsplat.surface_cache.visibility import VisibilityPass, seen_by_embree

RAYS = 10 << 18  # of all sites together, about: where these are many, what lights a record is the mean of more of them
SIDES = (8, 16)  # the least and the greatest: side² rays a site
_LIGHT_SAMPLES = 0.25  # of its rays: a site's shadow rays to emitters, at most
_RESTS = 3  # ticks without a change after which sites are chosen for meshes where they are now
_FOLLOWING = 0.15  # of a tick: gathering sites again may take that much in any case while things move
_LIGHT = "bounces", "light_samples", "shadow_size"  # settings on which values depend, beside the seed
_MORE, _ROOM = 0.5, 0.7  # of the sites, and of those that there may be beside them: how many a refinement adds
_WORTH = 0.1  # of the sites: fewer are not worth one
_BATCH = 128  # sites gathered at once, at most


@dataclass(frozen=True)
class _Basis:
    """What sites and values depend on. unlit: (F,) as clustering.unlit_interiors has it of the scene."""

    scene: Scene
    settings: Settings
    unlit: np.ndarray


class _LaidOut(Owner):
    """Sites on the GPU: a record for each value, in the order of the values, and the table by which these are looked up."""

    def __init__(self, ctx: moderngl.Context, layout: SiteLayout, order: np.ndarray) -> None:
        self.layout = layout
        self.records = RecordCache(ctx)
        self.table = LookupTable(ctx, layout.tessellation.table, layout.cells, MAX_SITES, order)
        if len(layout.sites):
            self.records.append(layout.sites)
            self.records.invalidate()

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.records, self.table)


@dataclass(frozen=True)
class _Held:
    """What lookups find: `table`, whose values are `light`, those of the sites `laid_out`; None before the first are made.

    complete: whether they are what scene and settings ask for.
    """

    table: LookupTable
    laid_out: _LaidOut | None = None
    light: BouncedLight | None = None
    complete: bool = False


@dataclass(frozen=True, eq=False)
class _Step:
    """A refinement of the values: what it holds, the cells that may be cut further, E_1 (S, 3) by more rays, and the transport."""

    held: _Held
    cut: SplitLayout
    E_1: np.ndarray
    transport: Transport | None


@dataclass(frozen=True, eq=False)
class _Finer:
    """A refinement under way. choosing: its sites, None once they are in `laid_out`. first: the number of the first site that lacks
    E_1 by more rays; done: of the first that still does."""

    choosing: Generator[float, None, SplitLayout] | None
    E_1: np.ndarray
    first: int
    done: int
    cut: SplitLayout | None = None
    laid_out: _LaidOut | None = None
    transport: Transport | None = None


@dataclass(frozen=True)
class _Changing:
    """How the scene changes while ticks go on. now: whether it has changed since the last tick. moved: whether meshes have, and
    the sites are still those from before; rested: for so many ticks nothing has changed since."""

    now: bool = False
    moved: bool = False
    rested: int = 0


class SurfaceCache(Owner):
    """The surface cache of a world's scene."""

    def __init__(self, world: World, settings: Settings, timers: Timers) -> None:
        self.ctx, self.world, self.timers = world.ctx, world, timers
        self._basis = _Basis(world.scene, settings, unlit_interiors(world.scene))
        self._visibility = VisibilityPass(self.ctx, world.material_defines)
        self._reduce = ReducePass(self.ctx, gradients=False)
        self._view_pass = SurfaceViewPass(self.ctx)
        self._point_pass = SurfaceViewPass(self.ctx)
        self._made = Workshop()
        self._pace, self._quick_pace, self._finer_pace = Pace(self.ctx), Pace(self.ctx), Pace(self.ctx)
        self._choosing: Generator[float, None, SiteLayout] | None = None
        self._chosen = 0.0  # the share of the choice of sites that is done
        self._laid_out: _LaidOut | None = None  # the sites of the scene as it is; None while they are still to be chosen
        self.transport: Transport | None = None  # between these
        self._bouncing: Iterator[BouncedLight] | None = None
        self._follower: Follower | None = None  # of the values in use, while others are still to be made
        self._changing = _Changing()
        self._held = _Held(unknown(self.ctx))
        self._coarse: _Held | None = None  # what was held before the refinements in use; None: there are none
        self._steps: list[_Step] = []  # these; lookups find the last one's values
        self._finer: _Finer | None = None
        self._viewed: tuple[GBuffer, BouncedLight | None, moderngl.Texture] | None = None

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        passes = self._visibility, self._reduce, self._view_pass, self._point_pass
        finer = None if self._finer is None else self._finer.laid_out
        held = [one.held for one in self._steps] + ([] if self._coarse is None else [self._coarse]) + [self._held]
        laid_out = {one.laid_out for one in held if one.laid_out is not None} | {self._laid_out, finer}
        tables = {one.table for one in held if one.laid_out is None}
        return (*passes, self._made, *tables, *laid_out)

    def _gather_for(self, sites: int, quick: bool = False) -> TraceGather:
        """Rays from so many sites, compiled for the kinds of lights that there are. quick: as few as may be."""
        side = SIDES[0] if quick else int(np.clip(np.sqrt(RAYS / max(sites, 1)), *SIDES))
        lights, samples = light_defines(self.world.scene), min(self._basis.settings.light_samples, int(_LIGHT_SAMPLES * side**2))
        embree, emitters = self._embree, samples > 0 and emitter_table(self.world) is not None
        return self._made.get(
            "quick gather" if quick else "gather",
            (side, lights, samples, embree, emitters),
            lambda: TraceGather(self.world, side, _BATCH, surface=True, hits=True, light_samples=samples, embree=embree),
        )

    @property
    def _embree(self) -> bool:
        """Whether Embree traces its rays."""
        return ray_kind(self.ctx, self._basis.settings) == "embree"

    # ---- what it holds ---------------------------------------------------------------------------------------------

    @property
    def result(self) -> BouncedLight | None:
        """What lookups find; None before the first values are made."""
        return self._held.light

    @property
    def last_change(self) -> float:
        """How much what lookups find has changed last, about, relative to it: 1 where it was made anew."""
        return 1.0 if self.complete or self._follower is None else self._follower.change

    @property
    def following(self) -> bool:
        """Whether what lookups find follows a scene that goes on changing, until it is made anew."""
        return self._follower is not None and not self.complete

    @property
    def refined(self) -> bool:
        """Whether its values come from more rays than it is made by."""
        return bool(self._steps)

    @property
    def refinements(self) -> int:
        """How often the values in use were refined."""
        return len(self._steps)

    @property
    def may_split(self) -> bool:
        """Whether there may be a good many further sites."""
        records = self.records
        return records is not None and self._further(records.count) > _WORTH * records.count

    @property
    def before(self) -> LookupTable | None:
        """The table from before the last refinement; None without one."""
        if not self._steps:
            return None
        return self._steps[-2].held.table if len(self._steps) > 1 else self._coarse and self._coarse.table

    @property
    def complete(self) -> bool:
        """Whether that is what scene and settings ask for."""
        return self._held.complete

    @property
    def progress(self) -> float:
        """How much of what they ask for is made, 0..1."""
        if self.complete:
            return 1.0
        records = None if self._laid_out is None else self._laid_out.records
        if records is None or not records.count:
            return 0.5 * self._chosen
        return 0.5 + 0.49 * (1.0 - len(records.stale) / records.count)

    @property
    def lookup(self) -> LookupTable:
        """The table that lookups go through."""
        return self._held.table

    @property
    def records(self) -> RecordCache | None:
        """The records of the values, in their order; None before the first are made."""
        return None if self._held.laid_out is None else self._held.laid_out.records

    @property
    def layout(self) -> SiteLayout | None:
        """The sites of the scene as it is; None while they are still to be chosen."""
        return None if self._laid_out is None else self._laid_out.layout

    @property
    def sites(self) -> Sites:
        """Where the values were gathered."""
        records = self.records
        if records is None:
            nowhere = np.zeros((0, 3), np.float32)
            return Sites(nowhere, nowhere, nowhere)
        return records.sites(slice(FIRST_SITE, records.count))

    def uniforms(self, table: LookupTable | None = None) -> dict[TriangleOrder, Uniforms]:
        """The uniforms of shaders/surface_cache/lookup.glsl for triangles numbered either way, with this table or else with that
        in use."""
        table = table or self.lookup
        return {"scene": table.uniforms("scene"), "tree": table.uniforms("tree")}

    def view(self, gbuffer: GBuffer) -> moderngl.Texture:
        """What the cache says of every pixel, as SurfaceViewPass has it; valid until the next call."""
        if self._viewed is None or self._viewed[0] is not gbuffer or self._viewed[1] is not self.result:
            self._viewed = gbuffer, self.result, self._view_pass(gbuffer, self.uniforms()["scene"])
        return self._viewed[2]

    def at(self, sites: Sites) -> np.ndarray:
        """(N, 3) what the cache says at `sites` whose triangles are known, W/m²."""
        return self._point_pass.at(sites, self.uniforms()["scene"])

    # ---- what changes ----------------------------------------------------------------------------------------------

    def change(self, settings: Settings, change: SceneChange, brighter: Mapping[LampPart, np.ndarray] | None = None) -> None:
        """Go on with other settings, and with the world's scene as it is after a `change`; what depends on that is made again by
        `advance`. Until then the values are those from before, on what has moved too. brighter: where nothing but the colours of
        lamps has changed, whose parts are all known, by how much, (3,) each.

        Interrupted, it does no harm to be called again: the basis is replaced last.
        """
        old, scene = self._basis, change.new
        relit, moved = change.looks_otherwise and change.dimming is None and brighter is None, bool(change.moved)
        unlit = unlit_interiors(scene) if change else old.unlit
        other_rays = old.settings.seed != settings.seed
        if change or other_rays or any(getattr(old.settings, name) != getattr(settings, name) for name in _LIGHT):
            self._coarsen()
        if moved:
            self.lookup.follow(self.world.tree.corners, self.world.tree.order)
        if change.hides or change.repainted:  # sites without a place, or other reflectances in the transport
            self.transport = self._follower = None
        if moved and self._follower is not None:
            self._follower.move(change)
        elif moved or not np.array_equal(old.unlit, unlit):  # a lamp went into a closed mesh, or out
            self._drop_sites()
        if change.other_sky:  # which sites one value does for depends on whether it is the same all around
            self.transport = self._follower = None
            self._drop_sites()
        if change.dimming is not None:
            self._dim(change.dimming)
        for part, colour in (brighter or {}).items():
            self._add(part, colour.astype(np.float32))
        if moved or relit:
            self._changing = _Changing(now=True, moved=self._changing.moved or moved)
        if relit and self._follower is not None:
            self._follower.relight()
        if other_rays:
            self.transport = self._follower = None
        other_samples = old.settings.light_samples != settings.light_samples
        if other_rays or other_samples or old.settings.shadow_size != settings.shadow_size or relit or moved:
            self.expire()
        if old.settings.bounces != settings.bounces:
            self._bounce_again()
        self._basis = _Basis(scene, settings, unlit)

    def _dim(self, factor: np.ndarray) -> None:
        """Let all values be those of light that is `factor` times as strong, (3,), however far they are made."""
        held, f = self._held, np.asarray(factor, np.float32)
        self._bouncing = None
        caches = [laid_out.records for laid_out in {self._laid_out, held.laid_out} if laid_out is not None]
        for records in caches:
            dim(records, f)
        if self._follower is not None:
            self._follower.dim(f)
        if held.light is not None:
            light = replace(held.light, irradiance=held.light.irradiance * f)
            held.table.write(light.irradiance)
            self._held = replace(held, light=light)

    def _add(self, part: LampPart, colour: np.ndarray) -> None:
        """Let all values, which are complete, hold so much more of a lamp, (3,)."""
        sites, held = part.sites, self._held
        assert sites is not None and held.light is not None and held.laid_out is not None
        numbers = np.arange(held.laid_out.records.count)
        E_1 = np.maximum(held.laid_out.records.values[:, :3] + colour * sites.E_1, 0.0)
        normal = held.laid_out.records.sites(numbers).normal
        held.laid_out.records.correct({"irradiance": E_1, "vectors": normal[:, None] * E_1[:, :, None]}, numbers)
        light = replace(held.light, irradiance=np.maximum(held.light.irradiance + colour * sites.E, 0.0))
        held.table.write(light.irradiance)
        self._held, self._bouncing = replace(held, light=light), None
        if self._follower is not None and sites.beyond is not None and sites.D is not None:
            self._follower.add(*(colour * one for one in (sites.E_1, sites.E, sites.beyond, sites.D)))

    def learn(self, part: LampPart, shadows: ShadowMaps, budget: Budget) -> bool:
        """Go on with the part of a lamp, which shines alone in `shadows` (see lamp_parts.alone); whether it is known."""
        laid_out, settings = (self._coarse or self._held).laid_out, self._basis.settings
        if part.sites is not None or laid_out is None:
            return part.sites is not None
        count, light = laid_out.records.count, HitLight(shadows, self.uniforms(laid_out.table))
        if not part.site_records.count:
            part.site_records.append(laid_out.records.sites(slice(0, count)))
            part.sites_done = FIRST_SITE
        gather = self._gather_for(count)
        with self.timers("surface"):
            for batch in self._pace.batches(count - part.sites_done, gather.capacity, budget):
                numbers = part.sites_done + np.arange(batch)
                gather_records(gather, self._reduce, light, part.site_records, numbers, settings.seed)
                part.sites_done += batch
            if part.sites_done < count:
                return False
            E_1 = part.site_records.read()["irradiance"] / np.float32(SCALE)
            E_1[:FIRST_SITE] = 0.0
            *_, light_of_all = self._bounces(E_1, laid_out, self.transport)
            E = light_of_all.irradiance
            beyond, D = (None, None) if self._follower is None else self._follower.parts(E_1, shadows, SCALE)
            table = LookupTable(
                self.ctx, laid_out.layout.tessellation.table, laid_out.layout.cells, MAX_SITES, self.world.tree.order
            )
            table.write(SCALE * E)
            part.table, part.sites = table, SitePart(E_1, E, D, beyond)
        return True

    def expire(self) -> None:
        """Gather all again."""
        self._coarsen()
        if self._laid_out is not None:  # one by one: which of them a move concerns most is still to be known
            self._laid_out.records.invalidate(np.arange(self._laid_out.records.count))
        self._bounce_again()

    def _bounce_again(self) -> None:
        self._held = replace(self._held, complete=False)
        self._bouncing = None

    def _drop_sites(self) -> None:
        """Choose the sites again; those whose values are in use stay until there are others."""
        before, self._laid_out = self._laid_out, None
        self._choosing = self.transport = None
        self._bounce_again()
        if before is not None and before is not self._held.laid_out:
            before.release()

    # ---- making ----------------------------------------------------------------------------------------------------

    def advance(self, shadows: ShadowMaps, budget: Budget) -> bool:
        """Go on making it while the budget lasts; True where that has changed the values, which are then complete."""
        if self.complete:
            return False
        try:
            with self.timers("surface"):
                if self._follow(shadows, budget):
                    return True
                laid_out = self._lay_out(budget)
                if laid_out is None:
                    return False
                self._gather_sites(laid_out, shadows, budget)
                if len(laid_out.records.stale):
                    return False
                made = self._bounce(laid_out, budget)
                if made is None:
                    return False
                self._hold(laid_out, made, shadows)
        except BaseException:
            self._choosing = self._bouncing = None  # a generator that was interrupted is over
            raise
        return True

    def _follow(self, shadows: ShadowMaps, budget: Budget) -> bool:
        """Where the scene goes on changing from tick to tick, let the values in use follow it; whether they do."""
        changing, follower, held = self._changing, self._follower, self._held
        following = budget.limited and follower is not None and (changing.now or (changing.moved and changing.rested < _RESTS))
        self._changing = replace(changing, now=False, rested=0 if changing.now else changing.rested + 1)
        if not following:
            if changing.moved:
                self._changing = _Changing()
                self._drop_sites()
            return False
        assert follower is not None and held.laid_out is not None and held.light is not None
        gathered = self._gather_some(held.laid_out, follower, shadows, budget.part(0.0, 0.0, _FOLLOWING))
        E = follower.step(shadows, gathered)
        held.table.write(E)
        self._held = replace(held, light=replace(held.light, irradiance=E))
        return True

    def _gather_some(self, laid_out: _LaidOut, follower: Follower, shadows: ShadowMaps, budget: Budget) -> np.ndarray:
        """Gather those sites again around which most has changed, as many as the budget has time for; their numbers."""
        records, seed, done = laid_out.records, self._basis.settings.seed, 0
        gather, light = self._gather_for(records.count, quick=True), HitLight(shadows, self.uniforms(laid_out.table))
        order = follower.order
        order = order[order >= FIRST_SITE]
        for count in self._quick_pace.batches(len(order), gather.capacity, budget, gather.share.size):
            numbers = order[done : done + count]
            gather_records(gather, self._reduce, light, records, numbers, seed)
            if not follower.transport.known[numbers].all():
                follower.transport.fill(numbers, self._shares(gather, records.sites(numbers), numbers), gather.hits(count))
            records.mark_refreshed(numbers)
            done += count
        return order[:done]

    def _lay_out(self, budget: Budget) -> _LaidOut | None:
        """The sites, once all are chosen; None where the budget ends before."""
        while self._laid_out is None:
            if self._choosing is None:
                scene, unlit = self._basis.scene, self._basis.unlit
                offset = OFFSET * scene.diagonal
                self._choosing = SiteChooser(scene, unlit, offset, self._see).layout()
            try:
                self._chosen = next(self._choosing)
            except StopIteration as end:
                self._laid_out = _LaidOut(self.ctx, end.value, self.world.tree.order)
                self._choosing, self._chosen = None, 1.0
            if budget.left <= 0.0:
                return None
        return self._laid_out

    def _see(self, lines: np.ndarray) -> np.ndarray:
        """(N,) which of these sight lines (N, 3, 3) are free; what is cut out, only shaders know."""
        if self._embree and not self.world.material_defines["CUT_OUTS"]:
            return seen_by_embree(self.world.caster, lines)
        return self._visibility(self.world.ray_uniforms, lines)

    def _gather_sites(self, laid_out: _LaidOut, shadows: ShadowMaps, budget: Budget) -> None:
        """Gather E_1 at the sites that lack it, and which sites their rays meet where these are not known yet."""
        records, settings = laid_out.records, self._basis.settings
        gather = self._gather_for(records.count)
        if settings.most_bounces > 2 and self.transport is None:
            records.invalidate()
            self.transport = Transport(records.count, gather.share.size)
        stale = records.stale
        records.mark_refreshed(stale[stale < FIRST_SITE])
        stale, done = stale[stale >= FIRST_SITE], 0
        light = HitLight(shadows, self.uniforms(laid_out.table))
        for count in self._pace.batches(len(stale), gather.capacity, budget, gather.share.size):
            numbers = stale[done : done + count]
            gather_records(gather, self._reduce, light, records, numbers, settings.seed)
            if self.transport is not None and not self.transport.known[numbers].all():
                self.transport.fill(numbers, self._shares(gather, records.sites(numbers), numbers), gather.hits(count))
            records.mark_refreshed(numbers)
            done += count

    def _shares(self, gather: TraceGather, sites: Sites, numbers: np.ndarray) -> np.ndarray:
        """(N, R) cosθ·dω of the rays of sites, 0 for those below the surface."""
        frames = tangent_frames(sites.normal, sites.frame_rotations(numbers), self._basis.settings.seed)
        below = np.einsum("nij,nj->ni", frames, sites.geometric) @ gather.directions.T <= 0.0
        return np.where(below, 0.0, gather.share.ravel())

    def refine(self, shadows: ShadowMaps, budget: Budget) -> bool:
        """Go on with a refinement of the values in use, as far as the budget goes; whether it is done. They hold until the light of the
        scene changes.

        The first one lets E_1 come from four times as many rays, and each further one adds sites where light changes most.
        """
        held = self._held
        if held.light is None or held.laid_out is None or not held.complete:
            return False
        with self.timers("surface"):
            finer = self._finer = self._finer or self._begin_finer(held.light.irradiance)
            if finer.laid_out is None:
                finer = self._choose_finer(finer, budget)
            if finer.laid_out is not None and self._link_finer(finer, shadows, budget):
                finer = self._gather_finer(finer, shadows, budget)
            self._finer = finer
            if finer.laid_out is None or finer.done < finer.laid_out.records.count:
                return False
            self._end_finer(finer)
        return True

    def _further(self, count: int) -> int:
        """How many sites a refinement adds to `count`, about."""
        return min(int(_MORE * count), int(_ROOM * (MAX_SITES - count)))

    def _begin_finer(self, E: np.ndarray) -> _Finer:
        """The beginning of the next refinement of values E (S, 3)."""
        laid_out = self._held.laid_out
        assert laid_out is not None
        if not self._steps:
            cut = SplitLayout(laid_out.layout, leaves_of(laid_out.layout.tessellation))
            return _Finer(None, np.zeros((FIRST_SITE, 3), np.float32), FIRST_SITE, FIRST_SITE, cut, laid_out, self.transport)
        last, scene = self._steps[-1], self._basis.scene
        chooser = SiteChooser(scene, self._basis.unlit, OFFSET * scene.diagonal, self._see)
        choosing = SiteSplitter(chooser, E.astype(float), self._further(len(E))).split(last.cut)
        return _Finer(choosing, last.E_1, len(last.E_1), len(last.E_1))

    def _choose_finer(self, finer: _Finer, budget: Budget) -> _Finer:
        """Go on choosing its sites."""
        assert finer.choosing is not None
        try:
            while True:
                next(finer.choosing)
                if budget.left <= 0.0:
                    return finer
        except StopIteration as end:
            cut: SplitLayout = end.value
        laid_out, transport = _LaidOut(self.ctx, cut.layout, self.world.tree.order), None
        if self._basis.settings.most_bounces > 2:
            transport = Transport(laid_out.records.count, self._gather_for(laid_out.records.count).share.size)
            transport.known[:FIRST_SITE] = True
        return replace(finer, choosing=None, cut=cut, laid_out=laid_out, transport=transport)

    def _link_finer(self, finer: _Finer, shadows: ShadowMaps, budget: Budget) -> bool:
        """Go on with the transport between its sites; whether it is known."""
        assert finer.laid_out is not None
        transport, records = finer.transport, finer.laid_out.records
        if transport is None or finer.laid_out is self._held.laid_out:
            return True
        gather, light = self._gather_for(records.count), HitLight(shadows, self.uniforms(finer.laid_out.table))
        left, done = np.flatnonzero(~transport.known), 0
        for count in self._pace.batches(len(left), gather.capacity, budget, gather.share.size):
            numbers = left[done : done + count]
            gather_records(gather, self._reduce, light, records, numbers, self._basis.settings.seed)
            transport.fill(numbers, self._shares(gather, records.sites(numbers), numbers), gather.hits(count))
            done += count
        return done == len(left)

    def _gather_finer(self, finer: _Finer, shadows: ShadowMaps, budget: Budget) -> _Finer:
        """Go on gathering E_1 where it comes from few rays. Sites that the last values have too keep the records of these."""
        assert finer.laid_out is not None
        sites, gather, done = finer.laid_out.layout.sites, self._finer_gather(finer.laid_out.records.count), finer.done
        E_1 = [finer.E_1]
        with RecordCache(self.ctx) as scratch:
            for count in self._finer_pace.batches(len(sites) - done, gather.capacity, budget, gather.share.size):
                numbers = np.arange(done, done + count)
                rotated = replace(sites[numbers], frame_rotation=numbers)
                rows = scratch.append(rotated) + np.arange(count)
                gather_records(gather, self._reduce, HitLight(shadows), scratch, rows, self._basis.settings.seed)
                done += count
            E_1.append(scratch.read()["irradiance"])
        return replace(finer, done=done, E_1=np.concatenate(E_1))

    def _end_finer(self, finer: _Finer) -> None:
        """Let lookups find its values."""
        assert finer.laid_out is not None and finer.cut is not None
        E_1, held = finer.E_1.copy(), self._held
        E_1[SKY_VALUE : SKY_VALUE + 1] = np.pi * np.asarray(self._basis.scene.sky)
        E_1[DARK_VALUE : DARK_VALUE + 1] = 0.0
        laid_out = finer.laid_out
        if laid_out is held.laid_out:  # the values of before stay in its table
            laid_out = _LaidOut(self.ctx, laid_out.layout, self.world.tree.order)
        *_, made = self._bounces(E_1, laid_out, finer.transport)
        laid_out.table.write(made.irradiance)
        if self._coarse is None:
            self._coarse = held
        elif len(self._steps) > 1:
            self._steps[-2] = replace(self._steps[-2], transport=None)
        after = _Held(laid_out.table, laid_out, made, complete=True)
        self._steps.append(_Step(after, finer.cut, finer.E_1, finer.transport))
        self._held, self._finer = after, None

    def _coarsen(self) -> None:
        """Go back to the values from before all refinements."""
        if self._finer is not None and self._finer.laid_out not in (None, self._held.laid_out):
            self._finer.laid_out.release()
        self._finer = None
        if self._coarse is not None:
            steps, self._steps = self._steps, []
            self._held, self._coarse = replace(self._coarse, complete=self._held.complete), None
            for step in steps:
                if step.held.laid_out is not None:
                    step.held.laid_out.release()

    def _finer_gather(self, sites: int) -> TraceGather:
        """Twice as many rays in either direction from so many sites, which ask for nothing but the light that they meet."""
        side, samples, lights = (
            2 * self._gather_for(sites).side,
            self._basis.settings.light_samples,
            light_defines(self.world.scene),
        )
        samples, embree = min(samples, int(_LIGHT_SAMPLES * side**2)), self._embree
        emitters = samples > 0 and emitter_table(self.world) is not None
        return self._made.get(
            "finer gather",
            (side, lights, samples, embree, emitters),
            lambda: TraceGather(self.world, side, _BATCH, light_samples=samples, embree=embree),
        )

    def _first(self, records: RecordCache) -> np.ndarray:
        """(S, 3) E_1 at the sites, W/m²."""
        E_1 = records.read()["irradiance"]
        E_1[SKY_VALUE : SKY_VALUE + 1] = np.pi * np.asarray(self._basis.scene.sky)
        E_1[DARK_VALUE : DARK_VALUE + 1] = 0.0
        return E_1

    def _bounces(self, E_1: np.ndarray, laid_out: _LaidOut, transport: Transport | None) -> Iterator[BouncedLight]:
        """Light of E_1 (S, 3) at the sites, by one bounce more from each to the next, to the last that the settings ask for."""
        settings = self._basis.settings
        transport = transport if settings.most_bounces > 2 else None
        return sum_bounces(E_1, transport, laid_out.layout.area, settings.most_bounces, settings.bounces == "all")

    def _bounce(self, laid_out: _LaidOut, budget: Budget) -> BouncedLight | None:
        """All bounces from E_1, one after the other; None where the budget ends before."""
        if self._bouncing is None:
            self._bouncing = self._bounces(self._first(laid_out.records), laid_out, self.transport)
        made = next(self._bouncing)
        while not made.complete:
            if budget.left <= 0.0:
                return None
            made = next(self._bouncing)
        return made

    def _hold(self, laid_out: _LaidOut, made: BouncedLight, shadows: ShadowMaps) -> None:
        """Make these the values that lookups find."""
        laid_out.table.write(made.irradiance)
        before, self._held = self._held, _Held(laid_out.table, laid_out, made, complete=True)
        self._bouncing, self._changing = None, _Changing()
        self._follower = None
        if self.transport is not None and self._basis.settings.bounces == "all":
            E_1, E = self._first(laid_out.records), made.irradiance.copy()
            area = laid_out.layout.area
            self._follower = Follower(self.world, laid_out.records, area, self.transport, self._made, MAX_SITES, E_1, E)
            self._follower.begin(shadows)
        if before.laid_out is None:
            before.table.release()
        elif before.laid_out is not laid_out:
            before.laid_out.release()
