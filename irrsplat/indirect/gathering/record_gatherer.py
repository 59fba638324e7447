"""Gathering of records by the settings: the gather, the reduction, the surface cache for the light at hits, and the probes."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from irrsplat.core.buffers import Atlas, HitLight, ShadowMaps, Sites, Uniforms
from irrsplat.gather import kinds
from irrsplat.gather.hemisphere import Gather, gather_records
from irrsplat.gather.record_frame import FEW_RAYS
from irrsplat.gather.reduce import ReducePass
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.time_budget import HALF, Budget
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.indirect.gathering.change_probe import SIDE, adopt_probes, apply_probes, columns_of, scale_by_surface
from irrsplat.lighting.emitter_table import emitter_table
from irrsplat.lighting.light_table import light_defines
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.change import SceneChange
from irrsplat.scene.model import Scene
from irrsplat.settings import SETTINGS, Settings
from irrsplat.surface_cache.cache import SurfaceCache
from irrsplat.surface_cache.site_layout import Detail, detail_for
from irrsplat.surface_cache.transport import BouncedLight

_PLACES = "seed", "placement", "warmup"  # settings that determine the positions of records
_FIRST_LIGHT = 30.0  # ticks that the first values of the surface cache may take; input ends this one too
_RAY_NOISE = 0.04  # of E: records that cover only their near surroundings have a quarter of the rays where noise is below it
_NEAR_EXACT = 128  # side of gathers in which every record has all rays
_SURFACE = 0.35  # of a tick: share for the surface cache while records are gathered by its last values
_FIRST_RECORDS = 600  # records by coarse values, up to which finer values wait while ticks add further ones


@dataclass(frozen=True)
class Basis:
    """Scene and settings of the cache's records, and changes that the records do not follow yet.

    kind: of the gather, "trace", "embree" or "plane". moved: True if something has changed, and the affected records are not
    selected yet. relit: True if lights or materials have changed since the surface cache was of the present light. from_file: the
    statistics `bounces` of records from a file, until their surface cache is made.
    """

    scene: Scene
    settings: Settings
    kind: str
    moved: bool = False
    relit: bool = False
    from_file: Mapping[str, object] | None = None

    @cached_property
    def lights(self) -> dict[str, int]:
        """The kinds of lights that gathers are compiled for."""
        return light_defines(self.scene)

    @property
    def way(self) -> tuple[object, ...]:
        """The settings that determine a record's directions and their noise."""
        settings = self.settings
        return self.kind, settings.gather_size, settings.light_samples

    @property
    def uses_surface_cache(self) -> bool:
        """True if records use a surface cache: for more than one bounce."""
        return self.settings.most_bounces > 1


class RecordGatherer(Owner):
    """Gatherer of new and stale records of the `cache`, by the present light of the scene.

    measuring: True for a full surface cache with gathers of any size, because single readings would show the bias of a coarse
    one.
    """

    def __init__(
        self,
        world: World,
        settings: Settings,
        cache: RecordCache,
        timers: Timers,
        measuring: bool = False,
    ) -> None:
        self.ctx, self.world, self.cache, self.timers = world.ctx, world, cache, timers
        self._measuring = measuring
        self.atlas: Atlas | None = None  # radiance over the hemispheres of the last batch of records
        self.basis = Basis(world.scene, settings, kinds.kind(world.ctx, settings))
        if settings.most_bounces > 0:
            world.prebuild(caster=self._casts)
        self._count = 0  # of the records at the last advance of the surface cache
        self._built = True  # False while a tick awaits structures of rays
        self._made = self.own(Workshop())  # the surface cache, the gathers and the reductions

    # ---- the passes -------------------------------------------------------------------------------------------------

    def gather_pass(self, basis: Basis | None = None, side: int = 0, probe: bool = False) -> Gather:
        """Return the pass that gathers records along side² rays; 0: the settings' side.

        basis: another one than the present. The paper's algorithm gathers one record at a time, without next-event samples. For
        other sides, the number of samples grows in proportion to the rays, and is never less than the settings'. probe: True for
        rough values by at most `side` samples.
        """
        basis = basis or self.basis
        settings, name, capacity = basis.settings, f"gather of {side}", None
        samples, own = settings.light_samples, settings.gather_size
        if probe:
            rays = FEW_RAYS if side > 4 else 4 * FEW_RAYS  # the least records take less time each in large batches
            name, samples, capacity = f"probe of {side}", min(samples, side), rays // side**2
        elif side in (0, own):
            name, side = "gather", own
            samples, capacity = (0, 1) if settings.placement == "scan" else (samples, None)
        else:
            samples = min(samples * max(side, own) ** 2 // own**2, int(SETTINGS["light_samples"].high or 0))
            capacity = FEW_RAYS // side**2 if side < own else None
        settings = replace(settings, gather=basis.kind, gather_size=side, light_samples=samples)
        emitters = samples > 0 and emitter_table(self.world) is not None
        inputs = *replace(basis, settings=settings).way, basis.uses_surface_cache, basis.lights, emitters, capacity
        return self._made.get(name, inputs, lambda: kinds.gather_pass(self.world, settings, capacity))

    def _reduction(self, gradients: bool) -> ReducePass:
        """Return the pass that reduces hemisphere samples to records' values. gradients: M and ∇E as well."""
        return self._made.get(f"reduction {gradients}", (), lambda: ReducePass(self.ctx, gradients))

    @property
    def settings(self) -> Settings:
        """The settings by which records are gathered; without bounces, the last settings that had bounces."""
        return self.basis.settings

    @property
    def may_probe_holes(self) -> bool:
        """True if gathers trace rays that need no wait, the light at their hits is known, and pictures show probes."""
        return self._built and self.basis.kind != "plane" and self.settings.placement != "scan" and not self.awaits_light

    @property
    def surface(self) -> SurfaceCache | None:
        """The surface cache, made at its first use; None for fewer than two bounces."""
        if not self.basis.uses_surface_cache:
            return None
        detail = Detail() if self._measuring else detail_for(self.settings)
        return self._made.get("surface", detail, lambda: SurfaceCache(self.world, self.settings, self.timers, detail))

    @property
    def _casts(self) -> bool:
        """True if Embree traces rays, from records or from the sites of the surface cache."""
        basis = self.basis
        return basis.kind == "embree" or (basis.uses_surface_cache and kinds.ray_kind(self.ctx, basis.settings) == "embree")

    @property
    def _needs_tree(self) -> bool:
        """True if gathers need the tree for rays in shaders. With Embree, virtual point lights need the tree."""
        settings, lights = self.basis.settings, self.world.scene.lights
        lit = settings.light_samples > 0 and any(not one.directional for one in lights)
        return self.basis.kind != "embree" or lit

    @property
    def _without_tree(self) -> bool:
        """True if ticks gather without the tree for now: coarse light does not wait for the search of virtual point lights."""
        coarse = self.surface is not None and (self.awaits_light or self.provisional)
        return self.basis.kind == "embree" and coarse and self._needs_tree and not self.world.has_tree

    def light(self, shadows: ShadowMaps) -> HitLight:
        """Return the light at ray hits: shadow maps and, for several bounces, the surface cache."""
        surface = self.surface
        virtual = not self.provisional or self.world.has_tree
        return HitLight(shadows, None if surface is None else surface.uniforms(), virtual)

    # ---- changes ---------------------------------------------------------------------------------------------------

    def apply(self, settings: Settings, change: SceneChange, shadows: ShadowMaps | None) -> np.ndarray | None:
        """Apply other settings and another state of the scene, see RecordScheduler.apply.

        Return the numbers of the records that are kept, None for all. A change that fails, such as for lack of memory, has no
        effect. An interruption while records change removes all records.
        """
        old, cache, scene = self.basis, self.cache, change.new
        settings = settings if settings.most_bounces else replace(settings, bounces=old.settings.bounces)
        if settings == old.settings and not change and self.world.shows(scene):
            return None
        new = replace(old, scene=scene, settings=settings, kind=kinds.kind(self.ctx, settings))
        # work that may fail comes first
        # another way to gather voids all probes; records from a file have light that no probe finds without a surface cache
        other_bounces = old.settings.most_bounces != settings.most_bounces and old.way == new.way and not self.awaits_light
        if (other_bounces or (change and change.dimming is None)) and shadows is not None:
            self.probe_new(shadows, Budget(None))  # by the former light
        try:
            self.world.apply(change)
            self.gather_pass(new)
        except BaseException:
            self.atlas = None  # its gather may be gone
            self.world.apply(change.back)
            raise
        try:
            return self._follow_records(old, new, change)
        except BaseException:
            cache.truncate(0)
            self._made.clear()
            self.atlas, self.basis = None, new
            raise

    def _follow_records(self, old: Basis, new: Basis, change: SceneChange) -> np.ndarray | None:
        """Let the records and the surface cache follow the scene and the settings. Return the numbers of kept records, None for
        all."""
        cache, kept, was, settings = self.cache, None, old.settings, new.settings
        # pixels without a record show probes, and black records would stay
        if change.was_dark or any(getattr(was, name) != getattr(settings, name) for name in _PLACES):
            cache.truncate(0)
        if change.moved:
            kept = cache.move_with_meshes(change)
            cache.keep_only(kept)
        other = bool(change) and change.dimming is None
        if change.dimming is not None:
            cache.dim(change.dimming)
        surface = self._made.find("surface", SurfaceCache)
        if surface is not None:
            surface.change(settings, change)
        switched = old.uses_surface_cache != new.uses_surface_cache
        if old.way != new.way or switched or old.lights != new.lights or was.placement != settings.placement:
            self.atlas = None  # the gather of this atlas is gone
        more = settings.gradients and not was.gradients  # records of gathers without gradients have none
        gathered = old.way != new.way or more or was.shadow_size != settings.shadow_size
        new = replace(new, moved=old.moved or other, relit=old.relit or (other and change.changes_light))
        if other or gathered or was.most_bounces != settings.most_bounces:  # values of the surface cache replace a file's light
            new = replace(new, from_file=None)
        if gathered:
            cache.invalidate()
        elif switched or (other and change.changes_light):
            new = replace(new, moved=True)
            cache.column("due")[:] += 1.0
            if settings.gather_size >= _NEAR_EXACT or new.kind == "plane":  # probes are coarser than these gathers
                cache.invalidate(np.arange(cache.count))
        self.basis = new
        return kept

    def expire(self) -> None:
        """Gather everything again."""
        self.basis = replace(self.basis, from_file=None)
        self.cache.invalidate()
        surface = self._made.find("surface", SurfaceCache)
        if surface is not None:
            surface.expire()

    # ---- the surface cache -----------------------------------------------------------------------------------------

    def prepare(self, shadows: ShadowMaps, budget: Budget, idle: bool = False) -> bool:
        """Advance the surface cache that the settings require. Return True if records may be gathered now.

        idle: True if no record waits. A render with records from a file makes a surface cache only to gather further ones.
        """
        if self.basis.from_file is not None and not budget.limited and not len(self.cache.stale):
            return True
        if self.awaits_light:  # else pictures of a moving camera stay dark
            budget = budget.part(1.0, 0.0, _FIRST_LIGHT)
        postponed = budget.limited and self._without_tree
        self._built = not budget.limited or self.world.wait(budget.left, self._needs_tree and not postponed, self._casts)
        if not self._built:
            return False
        if not (postponed and self.awaits_light):
            self.world.prebuild(self._needs_tree)
        ready = self._advance(shadows, budget, idle)
        if ready and self.basis.moved:
            self._probe_changed(shadows, budget.part(HALF, 0.0, HALF))
        return ready

    def restore_surface(self, shadows: ShadowMaps, budget: Budget) -> None:
        """Make the surface cache if the records come from a file without one, since further records are to be gathered."""
        if self.basis.from_file is not None:
            self._advance(shadows, budget)

    def _advance(self, shadows: ShadowMaps, budget: Budget, idle: bool = False) -> bool:
        """Advance the surface cache, see `prepare`. Return True if records may be gathered now.

        Without values of the scene as it is, the surface cache takes the whole budget: coarse values take a fraction of a second.
        """
        surface, basis, cache = self.surface, self.basis, self.cache
        if surface is None:
            return True
        first, coarse = surface.result is None, surface.is_coarse
        sites = cache.sites(slice(0, cache.count))
        follows = budget.limited and not first and not surface.level.complete and len(sites) and sites.triangle is not None
        before, follower = surface.at(sites) if follows else None, surface.in_use.follower
        followed = follower is not None and not follower.is_rough
        part = budget if idle or not surface.current else budget.part(_SURFACE, 0.0)
        first_records, self._count = coarse and not idle and self._count < cache.count < _FIRST_RECORDS, cache.count
        # the full level, with virtual lights, waits while coarse values are of the present light
        waits = budget.limited and coarse and surface.in_use.complete and (self._without_tree or first_records)
        change = None if waits else surface.advance(shadows, part)
        if change is not None and basis.from_file is None:
            if first:
                cache.invalidate()
            else:
                adopt_probes(cache)
                cache.column("due")[:] += change
                self.basis = replace(self.basis, moved=True)
            unfinished = surface.relit and not surface.in_use.complete
            if before is not None and (unfinished or (basis.relit and surface.current and not followed)):
                cache.invalidate(scale_by_surface(cache, before, surface.at(sites), self.gather_pass().radii))
            if surface.level.complete:  # a moving light may have left provisional records behind
                cache.invalidate(np.flatnonzero(cache.column("gather_size") == SIDE))
        if change is not None:
            self.basis = replace(self.basis, relit=self.basis.relit and not surface.current, from_file=None)
        # coarse values of light before and after a change are older than the light that probes find
        current = surface.current or (change is not None and surface.in_use.follower is not None)
        return surface.result is not None and current

    def _probe_changed(self, shadows: ShadowMaps, budget: Budget) -> None:
        """Probe the records that a change may affect, the most affected first: correct their values, and mark records that have
        changed too much as stale."""
        cache, due = self.cache, self.cache.column("due")
        (numbers,) = np.nonzero(due)
        numbers = numbers[np.argsort(-due[numbers], kind="stable")]
        found = self._probed(shadows, numbers, budget)
        changed = apply_probes(cache, numbers[: len(found)], found, self.gather_pass().radii)
        if len(changed):  # the age of stale records is a factor of their priority
            cache.invalidate(changed)
        due[numbers[: len(found)]] = 0.0  # not before: after an interruption, these records are probed again
        if len(found) == len(numbers):
            self.basis = replace(self.basis, moved=False)

    def probe_new(self, shadows: ShadowMaps, budget: Budget) -> bool:
        """Probe records without a probe by the present light, for comparison with probes after a change. True if none is left.

        A view does so once it requests no record. Otherwise the first change of the scene waits for all probes.
        """
        adopt_probes(self.cache)
        numbers = np.flatnonzero(self.cache.column("probe")[:, 3] == 0.0)
        found = self._probed(shadows, numbers, budget)
        found[:, 3] = np.maximum(found[:, 3], 1e-30)  # metres: 0 marks records without a probe
        self.cache.column("probe")[numbers[: len(found)]] = found
        return len(found) == len(numbers)

    def _probed(self, shadows: ShadowMaps, numbers: np.ndarray, budget: Budget) -> np.ndarray:
        """Return (K, 22) probes of the first K of the records of these numbers within the budget, see columns_of."""
        probes = self.empty_probes()
        done = self.gather(self.cache.sites(numbers), shadows, budget, SIDE, probes=probes, gradients=self.settings.gradients)
        return columns_of(probes, np.arange(done))

    # ---- gathering -------------------------------------------------------------------------------------------------

    def empty_probes(self) -> RecordCache:
        """Return an empty cache for rough values; the next call removes them."""
        records = self._made.get("probes", (), lambda: RecordCache(self.ctx))
        records.truncate(0)
        return records

    def gather(
        self,
        at: Sites | np.ndarray,
        shadows: ShadowMaps,
        budget: Budget,
        side: int = 0,
        near: bool = False,
        probes: RecordCache | None = None,
        gradients: bool = False,
    ) -> int:
        """Gather records within the budget, and at least one. Return their number.

        This is the only loop that divides a budget among records.

        at: sites for new records, or the numbers of records to gather again in place; the first ones come first. side: of the
        square of rays; 0: the settings' side. near: True if new records cover only near surfaces, so that few rays may suffice.
        probes: another cache for rough values at the sites, with M and ∇E if `gradients`.
        """
        if not len(at):
            return 0
        cache, done, side = self.cache if probes is None else probes, 0, side or self._provisional_side
        settings, few = self.settings, 0 if side else self._fewer
        gather = self.gather_pass(side=side, probe=probes is not None or side == self._provisional_side > 0)
        reduce = self._reduction(settings.gradients if probes is None else gradients)
        gathered = partial(
            gather_records, reduce=reduce, light=self.light(shadows), cache=cache, seed=settings.seed, timers=self.timers
        )
        for some in gather.batches(len(at), budget):
            with cache.adding(at[some]) if isinstance(at, Sites) else nullcontext(at[some]) as numbers:
                sizes, left, atlas = np.full(len(numbers), side), numbers, None
                tried = near | (cache.column("gather_size")[numbers] == few) if few else np.False_
                if tried.any():  # all rays follow where the noise is too great
                    atlas = gathered(self.gather_pass(side=few), numbers=numbers[tried])
                    sizes[tried & (cache.records.read("noise")["noise"][numbers] <= _RAY_NOISE)] = few
                    left = numbers[sizes != few]
                atlas = gathered(gather, numbers=left) or atlas
                self.atlas = atlas if probes is None else self.atlas
                if isinstance(at, Sites):
                    cache.column("gather_size")[numbers] = sizes
                else:
                    cache.mark_refreshed(numbers, sizes)
            done = some.stop
        return done

    @property
    def provisional(self) -> bool:
        """True while coarse values of the surface cache light the records: new ones are gathered again with the full level."""
        surface = self.surface_now
        return surface is not None and surface.is_coarse

    @property
    def _provisional_side(self) -> int:
        """The side of provisional records' gathers; 0: the settings' side."""
        return SIDE if self.provisional and self.settings.gather_size > SIDE else 0

    @property
    def _fewer(self) -> int:
        """The side of a gather along a quarter of the rays; 0 where records need all rays."""
        settings, side = self.settings, self.settings.gather_size // 2
        may = settings.gather_size < _NEAR_EXACT and settings.gradients and self.basis.kind in ("trace", "embree")
        return side if may and side >= SIDE else 0

    # ---- for files, the viewer and the statistics ------------------------------------------------------------------

    @property
    def has_pending_changes(self) -> bool:
        """True if any record may be stale once pending changes are applied."""
        return self.basis.moved or (self.basis.from_file is None and self.surface_share < 1.0)

    def resume_with(self, bounces: Mapping[str, object]) -> None:
        """Continue with records from a file, which were gathered with these `bounces`.

        Their surface cache is made when further records are gathered.
        """
        self.basis = replace(self.basis, moved=False, from_file=bounces if self.awaits_light else None)

    @property
    def surface_share(self) -> float:
        """The completed share of the surface cache, 0..1; 1 where no cache is required."""
        return 1.0 if self.surface is None else self.surface.level.progress

    @property
    def awaits_light(self) -> bool:
        """True until the surface cache that the settings require has values."""
        return self.basis.uses_surface_cache and self.surface_now is None

    @property
    def surface_now(self) -> SurfaceCache | None:
        """The surface cache if it is required and has values; else None."""
        surface = self.surface
        return surface if surface is not None and surface.result is not None else None

    @property
    def surface_uniforms(self) -> Uniforms:
        """The uniforms of the surface cache's values; empty without any."""
        return {} if self.surface_now is None else self.surface_now.uniforms()

    @property
    def surface_result(self) -> BouncedLight | None:
        """The values of the surface cache; None without any."""
        return None if self.surface_now is None else self.surface_now.result

    def bounces(self, settings: Settings) -> Mapping[str, object]:
        """Return the statistics of the gather and of the bounces, as in image/statistics.py."""
        how = self.basis.kind
        everything, most = settings.bounces == "all", settings.most_bounces
        made = self.surface.result if self.surface is not None and most > 1 else None
        if made is not None:
            return {"gathered_by": how, "bounces": made.bounces, "bounces_converged": made.converged if everything else None}
        if self.basis.from_file is not None:
            return {"gathered_by": how, **self.basis.from_file}
        return {"gathered_by": how, "bounces": min(most, 1), "bounces_converged": False if everything else None}
