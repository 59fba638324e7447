"""One level of a surface cache: its sites, the light between them, and the values that lookups find.

Sites are chosen, rays from every site find its first light and the other sites that they hit, and from then on all bounces are
sums. While lights or meshes move, a Follower updates the values in use.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace

import numpy as np

from irrsplat.core.buffers import HitLight, ShadowMaps
from irrsplat.gather.record_frame import offset_of
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.records.dimming import dim
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.change import SceneChange
from irrsplat.settings import Settings
from irrsplat.surface_cache.clustering import unlit_interiors
from irrsplat.surface_cache.follower import Follower
from irrsplat.surface_cache.lookup_table import LaidOut, Solution, unknown
from irrsplat.surface_cache.site_layout import DARK_VALUE, FIRST_SITE, SKY_VALUE, Clusters, Detail, SiteChooser, SiteLayout
from irrsplat.surface_cache.site_places import members_places
from irrsplat.surface_cache.site_rays import PlaceSearch, SiteRays
from irrsplat.surface_cache.transport import BouncedLight, Transport, sum_bounces

_STILL = 3  # ticks without a change, after which sites are chosen again for the present places of meshes
_FOLLOWING = 0.15  # of a tick: gathering sites again may take that much in any case while things move


@dataclass(frozen=True)
class _Changing:
    """The scene's changes from frame to frame.

    now: True if the scene has changed since the last frame. moved: True if meshes have moved and the sites are still the former
    ones. rested: frames without a change since then.
    """

    now: bool = False
    moved: bool = False
    still: int = 0


@dataclass
class _Steps:
    """The unfinished steps of a level. chosen: the finished share of the choice of sites."""

    choosing: Generator[float, None, tuple[SiteLayout, Clusters]] | None = None
    chosen: float = 0.0
    searching: PlaceSearch | None = None
    bouncing: Iterator[BouncedLight] | None = None


class SiteLevel(Owner):
    """A level of the surface cache of a world's scene.

    detail: the density of its sites and rays. solution: the values in use.
    """

    def __init__(self, world: World, settings: Settings, timers: Timers, detail: Detail) -> None:
        self.ctx, self.world, self.timers, self.detail = world.ctx, world, timers, detail
        self.settings, self._scene, self._unlit = settings, world.scene, unlit_interiors(world.scene)
        self._rays = SiteRays(world, settings, detail)
        self._made = Workshop()
        self._steps, self._changing = _Steps(), _Changing()
        self.laid_out: LaidOut | None = None  # the sites of the scene as it is; None while they are still to be chosen
        self._transport: Transport | None = None  # between these sites
        self.follower: Follower | None = None  # of the values in use, while the next ones are still to be made
        self.solution = Solution(unknown(self.ctx))

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (self._rays, self._made, self.solution.table, self.solution.laid_out, self.laid_out)

    @property
    def complete(self) -> bool:
        """True if the values are complete for the scene and settings."""
        return self.solution.complete

    @property
    def changes(self) -> bool:
        """True if the scene has changed since the last frame."""
        return self._changing.now

    @property
    def progress(self) -> float:
        """The completed share of the values for the scene and settings, 0..1."""
        if self.complete:
            return 1.0
        records = None if self.laid_out is None else self.laid_out.records
        if records is None or not records.count:
            return 0.5 * self._steps.chosen
        return 0.5 + 0.49 * (1.0 - len(records.stale) / records.count)

    # ---- changes ---------------------------------------------------------------------------------------------------

    def hold_light(self, shadows: ShadowMaps) -> None:
        """Prepare to follow a change of the scene. shadows: the maps before the change."""
        if self.follower is not None:
            self.follower.begin(shadows)

    def change(self, settings: Settings, change: SceneChange) -> None:
        """Use other settings, and the world's scene after a `change`. The former values hold until `advance` makes others."""
        unlit = unlit_interiors(change.new) if change else self._unlit
        old, relit, moved = self.settings, change.changes_light and change.dimming is None, bool(change.moved)
        other_rays = old.seed != settings.seed
        if change.hides or change.repainted:  # sites without a place, or other reflectances in the transport
            self._transport = self.follower = None
        if (moved or relit) and self.follower is not None and not self.follower.begun:  # changed before any shadow map
            self.follower = None
        if moved and self.follower is not None:
            self.follower.move(change)
            held = self.solution.laid_out
            if held is not None and held.places is not None:
                held.places = held.places.moved(change)
        elif moved or not np.array_equal(self._unlit, unlit):  # a light entered or left a closed mesh
            self._drop_sites()
        if change.other_sky:  # which sites share a value depends on whether the sky is the same all around
            self._transport = self.follower = None
            self._drop_sites()
        if change.dimming is not None:
            self._dim(change.dimming)
        if moved or relit:
            self._changing = _Changing(now=True, moved=self._changing.moved or moved)
        if relit and self.follower is not None:
            self.follower.relight()
        if other_rays:
            self._transport = self.follower = None
        other_light = old.light_samples != settings.light_samples or old.shadow_size != settings.shadow_size
        if other_rays or other_light or relit or moved:
            self.expire()
        if old.bounces != settings.bounces:
            self._bounce_again()
        self._scene, self._unlit, self.settings, self._rays.settings = change.new, unlit, settings, settings

    def _dim(self, factor: np.ndarray) -> None:
        """Scale all finished and unfinished values by `factor`, (3,)."""
        held, f = self.solution, np.asarray(factor, np.float32)
        self._steps.bouncing = None
        caches = [laid_out.records for laid_out in {self.laid_out, held.laid_out} if laid_out is not None]
        for records in caches:
            dim(records, f)
        if self.follower is not None:
            self.follower.dim(f)
        if held.light is not None:
            light = replace(held.light, irradiance=held.light.irradiance * f)
            held.table.write(light.irradiance)
            self.solution = replace(held, light=light)

    def expire(self) -> None:
        """Gather all sites again."""
        if self.laid_out is not None:  # one by one, since their order after a move is decided later
            self.laid_out.records.invalidate(np.arange(self.laid_out.records.count))
        self._bounce_again()

    def _bounce_again(self) -> None:
        self.solution = replace(self.solution, complete=False)
        self._steps.bouncing = None

    def _drop_sites(self) -> None:
        """Choose the sites again; the present sites stay until new values are complete."""
        before, self.laid_out = self.laid_out, None
        self._steps.choosing = self._steps.searching = self._transport = None
        self._bounce_again()
        if before is not None and before is not self.solution.laid_out:
            before.release()

    # ---- making ----------------------------------------------------------------------------------------------------

    def advance(self, shadows: ShadowMaps, budget: Budget) -> float | None:
        """Make values until the budget ends. Return their relative change, 1 for a new solution; None if they are as before."""
        if self.complete:
            return None
        followed = self.follow(shadows, budget)
        if followed is not None:
            return followed
        return 1.0 if self.make(shadows, budget) else None

    def make(self, shadows: ShadowMaps, budget: Budget) -> bool:
        """Continue the next solution until the budget ends. Return True if lookups find its values now."""
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
                self._use(laid_out, made)
        except BaseException:  # a generator that was interrupted is over
            self._steps.choosing = self._steps.searching = self._steps.bouncing = None
            raise
        return True

    def follow(self, shadows: ShadowMaps, budget: Budget) -> float | None:
        """Update the values in use while the scene changes from frame to frame. Return their relative change; None for none."""
        changing, follower, held = self._changing, self.follower, self.solution
        following = budget.limited and follower is not None and (changing.now or (changing.moved and changing.still < _STILL))
        self._changing = replace(changing, now=False, still=0 if changing.now else changing.still + 1)
        if not following:
            if changing.moved:
                self._changing = _Changing()
                self._drop_sites()
            return None
        assert follower is not None and held.laid_out is not None and held.light is not None
        with self.timers("surface"):
            gather, order = self._rays.gather_for(held.laid_out.records.count, quick=True), follower.order
            order = order[order >= FIRST_SITE]
            part = budget.part(0.0, 0.0, _FOLLOWING)
            done = self._gather(gather, held.laid_out, order, follower.transport, shadows, part)
            E = follower.step(shadows, order[:done])
        held.table.write(E)
        self.solution = replace(held, light=replace(held.light, irradiance=E))
        return follower.change

    def _gather(
        self,
        gather: TraceGather,
        laid_out: LaidOut,
        numbers: np.ndarray,
        transport: Transport | None,
        shadows: ShadowMaps,
        budget: Budget,
    ) -> int:
        """Gather E_1 at sites of these numbers, within the budget. Return their number.

        transport: gets the sites that the rays of unknown rows hit; None for two bounces.
        """
        records, places, done = laid_out.records, laid_out.places, 0
        assert places is not None
        virtual = self.detail.level >= 0 or self.world.has_tree  # coarse light does not wait for the tree of their rays
        light = HitLight(shadows, laid_out.table.uniforms | self.world.triangles.corner_uniforms, virtual)
        for some in gather.batches(len(numbers), budget):
            batch = numbers[some]
            self._rays.light(gather, light, records, batch, places.of)
            if transport is not None and not transport.known[batch].all():
                self._rays.link(gather, transport, places, batch)
            records.mark_refreshed(batch)
            done = some.stop
        return done

    def _lay_out(self, budget: Budget) -> LaidOut | None:
        """Return the sites once all are chosen; None if the budget ends before."""
        while self.laid_out is None:
            if self._steps.choosing is None:
                offset = offset_of(self._scene)
                self._steps.choosing = SiteChooser(self._scene, self._unlit, offset, self._rays.reach, self.detail).layout()
            try:
                self._steps.chosen = next(self._steps.choosing)
            except StopIteration as end:
                layout, clusters = end.value
                self.laid_out = LaidOut(self.ctx, layout)
                if self.detail.level < 0:  # a survey takes a sixth of the time to the first light, and hardly changes the error
                    self.laid_out.places = members_places(layout.sites, clusters, self.settings.seed)
                self._steps.choosing, self._steps.chosen = None, 1.0
            if budget.left <= 0.0:
                return None
        return self.laid_out

    def _find_places(self, laid_out: LaidOut, shadows: ShadowMaps, budget: Budget) -> bool:
        """Find the origins of the rays of sites. Return True once all are known."""
        if laid_out.places is None:
            if self._steps.searching is None:
                self._steps.searching = PlaceSearch(self._rays, laid_out)
            laid_out.places = self._steps.searching.advance(shadows, budget)
            if laid_out.places is None:
                return False
            self._steps.searching = None
        return True

    def _gather_sites(self, laid_out: LaidOut, shadows: ShadowMaps, budget: Budget) -> None:
        """Gather E_1 at the sites that lack it, and find the sites that their rays hit if these are not known yet."""
        records = laid_out.records
        gather = self._rays.gather_for(records.count)
        if self.settings.most_bounces > 2 and self._transport is None:
            records.invalidate()
            self._transport = Transport(records.count, gather.share.size)
        stale = records.stale
        records.mark_refreshed(stale[stale < FIRST_SITE])
        self._gather(gather, laid_out, stale[stale >= FIRST_SITE], self._transport, shadows, budget)

    def _first(self, records: RecordCache) -> np.ndarray:
        """Return (S, 3) E_1 at the sites, W/m², with the values that are known without a gather."""
        E_1 = records.read()["irradiance"]
        E_1[SKY_VALUE : SKY_VALUE + 1] = np.pi * np.asarray(self._scene.sky)
        E_1[DARK_VALUE : DARK_VALUE + 1] = 0.0
        return E_1

    def _bounces(self, E_1: np.ndarray, laid_out: LaidOut) -> Iterator[BouncedLight]:
        """Return the light of E_1 (S, 3) at the sites, with one bounce more in each item, up to the settings' last bounce."""
        most, everything = self.settings.most_bounces, self.settings.bounces == "all"
        return sum_bounces(E_1, self._transport if most > 2 else None, laid_out.area, most, everything)

    def _bounce(self, laid_out: LaidOut, budget: Budget) -> BouncedLight | None:
        """Return the light of all bounces from E_1; None if the budget ends before."""
        if self._steps.bouncing is None:
            self._steps.bouncing = self._bounces(self._first(laid_out.records), laid_out)
        made = next(self._steps.bouncing)
        while not made.complete:
            if budget.left <= 0.0:
                return None
            made = next(self._steps.bouncing)
        return made

    def _use(self, laid_out: LaidOut, made: BouncedLight) -> None:
        """Let lookups find these values."""
        laid_out.table.write(made.irradiance)
        before, self.solution = self.solution, Solution(laid_out.table, laid_out, made, complete=True)
        self._steps.bouncing, self._changing = None, _Changing()
        self.follower = None
        if self._transport is not None and self.settings.bounces == "all" and self.detail.level <= 0:
            E_1, E = self._first(laid_out.records), made.irradiance.copy()
            self.follower = Follower(self.world, laid_out.records, laid_out.area, self._transport, self._made, E_1, E)
        if before.laid_out is None:
            before.table.release()
        elif before.laid_out is not laid_out:
            before.laid_out.release()
