"""The surface cache: irradiance at sites spread over all surfaces, seen or not, which light what records see.

It holds E_(N−1) where records are to hold E_N, and is made once for all views: sites are chosen, rays from every site find its
first light and the other sites that they meet, and from then on all bounces are sums.

It is a sequence of levels, each a complete solution. Ticks make a coarse one first, in a fraction of the time, and use its
values until those of the full one are there. Progressive refinement makes finer ones.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, HitLight, ShadowMaps, Sites, Uniforms
from irrsplat.gather.record_frame import offset_of
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.time_budget import Budget, Pace
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.records.dimming import dim
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.change import SceneChange
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings
from irrsplat.surface_cache.clustering import unlit_interiors
from irrsplat.surface_cache.follower import Follower
from irrsplat.surface_cache.lookup_table import LaidOut, LookupTable, Solution, unknown
from irrsplat.surface_cache.site_layout import (
    COARSE,
    DARK_VALUE,
    FIRST_SITE,
    MAX_LEVEL,
    MAX_SITES,
    SKY_VALUE,
    Detail,
    SiteChooser,
    SiteLayout,
)
from irrsplat.surface_cache.site_rays import PlaceSearch, SiteRays
from irrsplat.surface_cache.transport import BouncedLight, Transport, sum_bounces
from irrsplat.surface_cache.view import SurfaceViewPass

_RESTS = 3  # ticks without a change after which sites are chosen for meshes where they are now
_FOLLOWING = 0.15  # of a tick: gathering sites again may take that much in any case while things move
_LIGHT = "bounces", "light_samples", "shadow_size"  # settings on which values depend, in addition to the seed


@dataclass(frozen=True)
class _Basis:
    """The inputs of sites and values. unlit: (F,) from clustering.unlit_interiors."""

    scene: Scene
    settings: Settings
    unlit: np.ndarray


@dataclass(frozen=True)
class _Changing:
    """The scene's changes from frame to frame.

    now: True if the scene has changed since the last frame. moved: True if meshes have moved and the sites are still the former
    ones. rested: frames without a change since then."""

    now: bool = False
    moved: bool = False
    rested: int = 0


class SurfaceCache(Owner):
    """The surface cache of a world's scene.

    detail: the density of its sites and rays. The one of level 0 has the others: the values of the coarse one stand in for its
    own in ticks, and those of finer ones replace its own. unlit: as in _Basis, where that is known.
    """

    def __init__(self, world: World, settings: Settings, timers: Timers, detail: Detail, unlit: np.ndarray | None = None) -> None:
        self.ctx, self.world, self.timers, self._detail = world.ctx, world, timers, detail
        self._basis = _Basis(world.scene, settings, unlit_interiors(world.scene) if unlit is None else unlit)
        self._rays = SiteRays(world, settings, detail)
        self._coarse: SurfaceCache | None = None  # made by the first tick that needs it
        self._stood_in = False  # True while lookups find the values of the coarse one
        self._relit = False  # True while its own values are of other lights or materials
        self.last_change = 1.0  # of the values by their last change, relative to them, about; 1 if they were made anew
        self._view_pass = SurfaceViewPass(self.ctx)
        self._point_pass = SurfaceViewPass(self.ctx)
        self._made = Workshop()
        self._pace, self._quick_pace = Pace(self.ctx), Pace(self.ctx)
        self._choosing: Generator[float, None, SiteLayout] | None = None
        self._chosen = 0.0  # the share of the choice of sites that is done
        self._searching: PlaceSearch | None = None  # for the places that these look from
        self._laid_out: LaidOut | None = None  # the sites of the scene as it is; None while they are still to be chosen
        self.transport: Transport | None = None  # between these
        self._bouncing: Iterator[BouncedLight] | None = None
        self._follower: Follower | None = None  # of the values in use, while others are still to be made
        self._changing = _Changing()
        self._solution = Solution(unknown(self.ctx))
        self._finer: list[SurfaceCache] = []  # the last two finer levels, of which the last one's values are in use
        self._next: SurfaceCache | None = None  # the level after these, while it is made
        self._viewed: tuple[GBuffer, BouncedLight | None, moderngl.Texture] | None = None

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        passes = self._rays, self._view_pass, self._point_pass
        return (
            *passes,
            self._made,
            self._solution.table,
            self._solution.laid_out,
            self._laid_out,
            *self._finer,
            self._next,
            self._coarse,
        )

    # ---- what it holds ---------------------------------------------------------------------------------------------

    @property
    def result(self) -> BouncedLight | None:
        """The values that lookups read; None before the first values exist."""
        return self._now.light

    @property
    def refinements(self) -> int:
        """The number of levels by which the values in use are finer."""
        return self._finer[-1]._detail.level if self._finer else 0

    @property
    def may_refine(self) -> bool:
        """True if there may be a finer level."""
        return self.refinements < MAX_LEVEL

    @property
    def before(self) -> LookupTable:
        """The table of the level before that in use."""
        return self._finer[0]._solution.table if len(self._finer) > 1 else self._solution.table

    @property
    def _now(self) -> Solution:
        """The values that lookups read."""
        return self._coarse._own if self._coarse is not None and self._stood_in else self._own

    @property
    def _own(self) -> Solution:
        """Its own values, and not those of the coarse one."""
        return self._finer[-1]._solution if self._finer else self._solution

    @property
    def stands_in(self) -> bool:
        """True while lookups find coarse values."""
        return self._coarse is not None and self._stood_in

    @property
    def current(self) -> bool:
        """True if lookups find values of about the present light. Moved meshes change little of the light."""
        return self._now.complete or self._changing.now or not self._outdated

    @property
    def _outdated(self) -> bool:
        """True if its own values are of another light, or missing."""
        return self._relit or self._solution.light is None

    @property
    def complete(self) -> bool:
        """True if the values in use are complete for the scene and settings."""
        return self._solution.complete

    @property
    def progress(self) -> float:
        """The completed share of the values for the scene and settings, 0..1."""
        if self.complete:
            return 1.0
        records = None if self._laid_out is None else self._laid_out.records
        if records is None or not records.count:
            return 0.5 * self._chosen
        return 0.5 + 0.49 * (1.0 - len(records.stale) / records.count)

    @property
    def lookup(self) -> LookupTable:
        """The table that lookups go through."""
        return self._now.table

    @property
    def records(self) -> RecordCache | None:
        """The records of the values, in their order; None before the first are made."""
        return None if self._now.laid_out is None else self._now.laid_out.records

    @property
    def layout(self) -> SiteLayout | None:
        """The sites of the scene as it is; None while they are still to be chosen."""
        return None if self._laid_out is None else self._laid_out.layout

    @property
    def sites(self) -> Sites:
        """The sites where the values were gathered."""
        records = self.records
        if records is None:
            nowhere = np.zeros((0, 3), np.float32)
            return Sites(nowhere, nowhere, nowhere)
        return records.sites(slice(FIRST_SITE, records.count))

    def uniforms(self, table: LookupTable | None = None) -> Uniforms:
        """The uniforms of shaders/surface_cache/lookup.glsl, with this table or else with that in use."""
        return (table or self.lookup).uniforms | self.world.triangles.corner_uniforms

    def view(self, gbuffer: GBuffer) -> moderngl.Texture:
        """Return the cache's values at every pixel, as from SurfaceViewPass; valid until the next call."""
        if self._viewed is None or self._viewed[0] is not gbuffer or self._viewed[1] is not self.result:
            self._viewed = gbuffer, self.result, self._view_pass(gbuffer, self.uniforms())
        return self._viewed[2]

    def at(self, sites: Sites) -> np.ndarray:
        """(N, 3) what the cache says at `sites` whose triangles are known, W/m²."""
        return self._point_pass.at(sites, self.uniforms())

    # ---- what changes ----------------------------------------------------------------------------------------------

    def change(self, settings: Settings, change: SceneChange) -> None:
        """Use other settings, and the world's scene as it is after a `change`. `advance` makes values again that depend on these;
        until then the former values hold, on moved meshes, too.

        Interrupted, it does no harm to be called again: the basis is replaced last.
        """
        old, scene = self._basis, change.new
        relit, moved = change.looks_otherwise and change.dimming is None, bool(change.moved)
        unlit = unlit_interiors(scene) if change else old.unlit
        other_rays = old.settings.seed != settings.seed
        if change or other_rays or any(getattr(old.settings, name) != getattr(settings, name) for name in _LIGHT):
            self._coarsen()
        if change.hides or change.repainted:  # sites without a place, or other reflectances in the transport
            self.transport = self._follower = None
        if moved and self._follower is not None:
            self._follower.move(change)
            held = self._solution.laid_out
            if held is not None and held.places is not None:
                held.places = held.places.moved(change)
        elif moved or not np.array_equal(old.unlit, unlit):  # a light entered or left a closed mesh
            self._drop_sites()
        if change.other_sky:  # which sites one value does for depends on whether it is the same all around
            self.transport = self._follower = None
            self._drop_sites()
        if change.dimming is not None:
            self._dim(change.dimming)
        if moved or relit:
            self._changing = _Changing(now=True, moved=self._changing.moved or moved)
        self._relit |= relit
        if relit and self._follower is not None:
            self._follower.relight()
        if other_rays:
            self.transport = self._follower = None
        other_samples = old.settings.light_samples != settings.light_samples
        if other_rays or other_samples or old.settings.shadow_size != settings.shadow_size or relit or moved:
            self.expire()
        if old.settings.bounces != settings.bounces:
            self._bounce_again()
        if self._coarse is not None and moved and self._follower is not None:  # its own values follow, others come when it rests
            self._coarse.release()
            self._coarse, self._stood_in = None, False
        elif self._coarse is not None:
            self._coarse.change(settings, change)
        self._basis, self._rays.settings = _Basis(scene, settings, unlit), settings

    def _dim(self, factor: np.ndarray) -> None:
        """Let all values be those of light that is `factor` times as strong, (3,), however far they are made."""
        held, f = self._solution, np.asarray(factor, np.float32)
        self._bouncing = None
        caches = [laid_out.records for laid_out in {self._laid_out, held.laid_out} if laid_out is not None]
        for records in caches:
            dim(records, f)
        if self._follower is not None:
            self._follower.dim(f)
        if held.light is not None:
            light = replace(held.light, irradiance=held.light.irradiance * f)
            held.table.write(light.irradiance)
            self._solution = replace(held, light=light)

    def expire(self) -> None:
        """Gather all again."""
        self._coarsen()
        if self._laid_out is not None:  # one by one: which of them a move concerns most is still to be known
            self._laid_out.records.invalidate(np.arange(self._laid_out.records.count))
        self._bounce_again()
        if self._coarse is not None:
            self._coarse.expire()

    def _bounce_again(self) -> None:
        self._solution = replace(self._solution, complete=False)
        self._bouncing = None

    def _drop_sites(self) -> None:
        """Choose the sites again; those whose values are in use stay until there are others."""
        before, self._laid_out = self._laid_out, None
        self._choosing = self._searching = self.transport = None
        self._bounce_again()
        if before is not None and before is not self._solution.laid_out:
            before.release()

    # ---- making ----------------------------------------------------------------------------------------------------

    def advance(self, shadows: ShadowMaps, budget: Budget) -> bool:
        """Make values, coarse ones first, until the budget ends; True if lookups find other values than before."""
        if self.complete:
            return False
        with self.timers("surface"):
            followed = self._follow(shadows, budget)
        if followed:
            assert self._follower is not None
            self._stood_in, self.last_change = False, self._follower.change
            return True
        detail, outdated = self._detail, budget.limited and self._outdated
        if outdated and not detail.level and detail.rays_in_all > COARSE.rays_in_all:
            self._coarse = coarse = self._coarse or self._level(COARSE)
            if not coarse.complete:
                changed = coarse.advance(shadows, budget)
                self._stood_in, self.last_change = self._stood_in or changed, coarse.last_change
                return changed
        try:
            with self.timers("surface"):
                laid_out = self._lay_out(budget)
                if laid_out is None or not self._find_places(laid_out, shadows, budget):
                    return False
                self._gather_sites(laid_out, shadows, budget)
                if len(laid_out.records.stale):
                    return False
                made = self._bounce(laid_out, budget)
                if made is None:
                    return False
                self._use(laid_out, made, shadows)
        except BaseException:
            self._choosing = self._searching = self._bouncing = None  # a generator that was interrupted is over
            raise
        return True

    def _follow(self, shadows: ShadowMaps, budget: Budget) -> bool:
        """Update the values in use while the scene changes from frame to frame; return True if they were updated."""
        changing, follower, held = self._changing, self._follower, self._solution
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
        self._solution = replace(held, light=replace(held.light, irradiance=E))
        return True

    def _gather_some(self, laid_out: LaidOut, follower: Follower, shadows: ShadowMaps, budget: Budget) -> np.ndarray:
        """Gather those sites again around which most has changed, as many as the budget has time for; their numbers."""
        records, places, done = laid_out.records, laid_out.places, 0
        assert places is not None
        gather, light = self._rays.gather_for(records.count, quick=True), HitLight(shadows, self.uniforms(laid_out.table))
        order = follower.order
        order = order[order >= FIRST_SITE]
        for count in self._quick_pace.batches(len(order), gather.capacity, budget, gather.share.size):
            numbers = order[done : done + count]
            self._rays.light(gather, light, records, numbers, places.of)
            if not follower.transport.known[numbers].all():
                self._rays.link(gather, follower.transport, places, numbers)
            records.mark_refreshed(numbers)
            done += count
        return order[:done]

    def _lay_out(self, budget: Budget) -> LaidOut | None:
        """The sites, once all are chosen; None where the budget ends before."""
        while self._laid_out is None:
            if self._choosing is None:
                scene, unlit = self._basis.scene, self._basis.unlit
                offset = offset_of(scene)
                self._choosing = SiteChooser(scene, unlit, offset, self._rays.see, self._detail).layout()
            try:
                self._chosen = next(self._choosing)
            except StopIteration as end:
                self._laid_out = LaidOut(self.ctx, end.value)
                self._choosing, self._chosen = None, 1.0
            if budget.left <= 0.0:
                return None
        return self._laid_out

    def _find_places(self, laid_out: LaidOut, shadows: ShadowMaps, budget: Budget) -> bool:
        """Find out from where the sites look; whether that is known."""
        if laid_out.places is None:
            if self._searching is None:
                self._searching = PlaceSearch(self._rays, laid_out)
            laid_out.places = self._searching.advance(shadows, budget)
            if laid_out.places is None:
                return False
            self._searching = None
        return True

    def _gather_sites(self, laid_out: LaidOut, shadows: ShadowMaps, budget: Budget) -> None:
        """Gather E_1 at the sites that lack it, and which sites their rays meet where these are not known yet."""
        records, places, settings = laid_out.records, laid_out.places, self._basis.settings
        assert places is not None
        gather = self._rays.gather_for(records.count)
        if settings.most_bounces > 2 and self.transport is None:
            records.invalidate()
            self.transport = Transport(records.count, gather.share.size)
        stale = records.stale
        records.mark_refreshed(stale[stale < FIRST_SITE])
        stale, done = stale[stale >= FIRST_SITE], 0
        light = HitLight(shadows, self.uniforms(laid_out.table))
        for count in self._pace.batches(len(stale), gather.capacity, budget, gather.share.size):
            numbers = stale[done : done + count]
            self._rays.light(gather, light, records, numbers, places.of)
            if self.transport is not None and not self.transport.known[numbers].all():
                self._rays.link(gather, self.transport, places, numbers)
            records.mark_refreshed(numbers)
            done += count

    def _level(self, detail: Detail) -> SurfaceCache:
        """Return a surface cache of the same scene in another detail."""
        return SurfaceCache(self.world, self._basis.settings, self.timers, detail, self._basis.unlit)

    def refine(self, shadows: ShadowMaps, budget: Budget) -> bool:
        """Continue the next finer level, as far as the budget goes. Return True if lookups find its values now.

        They hold until the light of the scene changes.
        """
        if self._solution.laid_out is None or not self.complete:
            return False
        self._next = self._next or self._level(self._detail.finer(self.refinements + 1))
        if not self._next.advance(shadows, budget):
            return False
        gone, self._finer, self._next = self._finer[:-1], [*self._finer[-1:], self._next], None
        for level in gone:
            level.release()
        return True

    def _coarsen(self) -> None:
        """Go back to the values from before all refinements."""
        gone, self._finer, self._next = [*self._finer, *filter(None, [self._next])], [], None
        for level in gone:
            level.release()

    def _first(self, records: RecordCache) -> np.ndarray:
        """Return (S, 3) E_1 at the sites, W/m², with the values that are known without a gather."""
        E_1 = records.read()["irradiance"]
        E_1[SKY_VALUE : SKY_VALUE + 1] = np.pi * np.asarray(self._basis.scene.sky)
        E_1[DARK_VALUE : DARK_VALUE + 1] = 0.0
        return E_1

    def _bounces(self, E_1: np.ndarray, laid_out: LaidOut) -> Iterator[BouncedLight]:
        """Light of E_1 (S, 3) at the sites, by one bounce more from each to the next, to the last that the settings ask for."""
        most, everything = self._basis.settings.most_bounces, self._basis.settings.bounces == "all"
        return sum_bounces(E_1, self.transport if most > 2 else None, laid_out.layout.area, most, everything)

    def _bounce(self, laid_out: LaidOut, budget: Budget) -> BouncedLight | None:
        """All bounces from E_1, one after the other; None where the budget ends before."""
        if self._bouncing is None:
            self._bouncing = self._bounces(self._first(laid_out.records), laid_out)
        made = next(self._bouncing)
        while not made.complete:
            if budget.left <= 0.0:
                return None
            made = next(self._bouncing)
        return made

    def _use(self, laid_out: LaidOut, made: BouncedLight, shadows: ShadowMaps) -> None:
        """Make these the values that lookups find."""
        laid_out.table.write(made.irradiance)
        before, self._solution = self._solution, Solution(laid_out.table, laid_out, made, complete=True)
        self._bouncing, self._changing = None, _Changing()
        self._follower, self._stood_in, self._relit, self.last_change = None, False, False, 1.0
        if self.transport is not None and self._basis.settings.bounces == "all" and self._detail.level <= 0:
            E_1, E = self._first(laid_out.records), made.irradiance.copy()
            area = laid_out.layout.area
            self._follower = Follower(self.world, laid_out.records, area, self.transport, self._made, MAX_SITES, E_1, E)
            self._follower.begin(shadows)
        if before.laid_out is None:
            before.table.release()
        elif before.laid_out is not laid_out:
            before.laid_out.release()
