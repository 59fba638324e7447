"""A level of a surface cache: its sites, the transport of light between them, and the values for lookups.

After the choice of sites, rays from each site find its one-bounce light and the sites that light their hits. All bounces then
follow by sums. While lights or meshes move, a Follower updates the values in use.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from irrsplat.core.buffers import ShadowMaps, Sites
from irrsplat.core.timing.background import Steps, in_background
from irrsplat.gather.stratified import LEAST_SIDE
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.world import World
from irrsplat.scene.appearance import in_order
from irrsplat.scene.change import SceneChange
from irrsplat.settings import Settings
from irrsplat.surface_cache.follower import Follower
from irrsplat.surface_cache.site_layout import Detail, SiteChooser
from irrsplat.surface_cache.site_places import site_places
from irrsplat.surface_cache.site_rays import SiteRays
from irrsplat.surface_cache.surface_sites import SurfaceSites
from irrsplat.surface_cache.transport import BouncedLight, Transport, sum_bounces

_CLOSE = 0.1  # of the mean irradiance: change from a gather up to which values that follow replace coarse ones
_STILL = 3  # ticks without a change, after which sites are chosen again for the present places of meshes


class SiteLevel(Owner):
    """A level of the surface cache of a world's scene.

    detail: the density of its sites and rays. shown: the sites with the values of lookups; None before the first values.
    complete: True if these values are complete for the scene and the settings. sites: the sites of the present scene; None
    until they are chosen. follower: updates the values in use until the next values are complete; None if the transport between
    the sites is unknown. still: number of frames since the scene has changed.
    """

    def __init__(self, world: World, settings: Settings, detail: Detail) -> None:
        self.world, self.detail = world, detail
        self._rays = SiteRays(world, settings, detail)
        self._making: Steps[BouncedLight] | None = None  # the unfinished solution
        self._unlit = world.unlit_interiors  # of the scene that the sites are of
        self.still = np.inf
        self._moved = False  # True if meshes have moved since the choice of the sites
        self._mixed = False  # True if the values that are being made are of light before and after a change
        self.shown: SurfaceSites | None = None
        self.complete = False
        self.sites: SurfaceSites | None = None
        self.follower: Follower | None = None

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (self._rays, self.shown, self.sites)

    @property
    def settings(self) -> Settings:
        """The settings by which the values are made."""
        return self._rays.settings

    @property
    def light(self) -> BouncedLight | None:
        """The light that lookups find; None before the first values."""
        return None if self.shown is None else self.shown.light

    @property
    def progress(self) -> float:
        """The completed share of the values for the scene and settings, 0..1; 0 while sites are chosen."""
        if self.complete:
            return 1.0
        if self.sites is None:
            return 0.0
        records = self.sites.records
        return 0.99 * (1.0 - len(records.stale) / max(records.count, 1))

    # ---- changes ---------------------------------------------------------------------------------------------------

    @property
    def is_close(self) -> bool:
        """True if values that follow a change of the scene differ little from the values of the last gather."""
        if self.light is None or self.follower is None:
            return False
        gathered = self.follower.gathered
        return bool(np.abs(self.light.irradiance - gathered).mean() <= _CLOSE * gathered.mean())

    def change(self, settings: Settings, change: SceneChange, finish: bool = False) -> None:
        """Use other settings, and the world's scene after a `change`. The former values stay until `advance` makes new ones.

        finish: True if half-made values are completed first.
        """
        unlit, self._unlit = self._unlit, self.world.unlit_interiors
        old, relit, moved = self.settings, change.changes_light and change.dimming is None, bool(change.moved)
        other_rays = old.seed != settings.seed
        other_light = old.light_samples != settings.light_samples or old.shadow_size != settings.shadow_size
        alike = unlit == self._unlit and not other_rays
        if finish and relit and alike and not moved and settings == old and 0.0 < self.progress < 1.0:
            self._mixed = True
            return
        if change.hides or other_rays:  # sites without a place
            self._forget_transport()
        if change.other_sky:
            self.follower = None
        if change.repainted:
            self._repaint(change)
        if moved and self.follower is not None:
            self.follower.move(change)
        elif moved or not alike:
            self.choose_again()
        if change.dimming is not None:
            self._dim(change.dimming)
        if moved or relit:
            self.still, self._moved = 0, self._moved or moved
        if relit and self.follower is not None:
            self.follower.relit = True
        if other_rays or other_light or relit or moved:
            self.expire()
        elif old.bounces != settings.bounces:
            self._bounce_again()
        self._rays.settings = settings

    def _dim(self, factor: np.ndarray) -> None:
        """Scale all finished and unfinished values by `factor`, (3,)."""
        f = np.asarray(factor, np.float32)
        self._sum_again()
        for sites in filter(None, {self.sites, self.shown}):
            sites.records.dim(f)
            if sites.light is not None:
                sites.show(replace(sites.light, irradiance=sites.light.irradiance * f))
        if self.follower is not None:
            self.follower.dim(f)

    def _repaint(self, change: SceneChange) -> None:
        """Let the follower follow repainted meshes; without one, discard the transport, which is of other reflectances."""
        if self.follower is None:
            self._forget_transport()
        else:
            self.follower.repaint(change)
        if self.sites is not None and self.sites is not self.shown:
            self.sites.transport = None

    def expire(self) -> None:
        """Gather all sites again."""
        if self.sites is not None:  # one by one, because a move may change their order later
            self.sites.records.invalidate(np.arange(self.sites.records.count))
        self._bounce_again()

    def _bounce_again(self) -> None:
        self.complete = False
        self._sum_again()

    def _sum_again(self) -> None:
        """Begin the sum of bounces again; a choice of sites and places continues."""
        if self.sites is not None and self.sites.places is not None:
            self._making = None

    def suits_view(self) -> bool:
        """True if another choice of sites would not shorten the steps much at the eye of the present view, or it is in a wall."""
        eyes, diagonal = self.world.eyes, self.world.scene.diagonal
        rooms = Budget(None).advance(self._chooser.rooms(eyes))
        assert self.shown is not None and rooms is not None
        grading, least = self.shown.grading, self._chooser.least_room
        return all(room < least or grading.suits(eye, room, diagonal) for eye, room in zip(eyes, rooms, strict=True))

    def choose_again(self) -> None:
        """Choose the sites again; the present sites stay until new values are complete."""
        if self.follower is None:
            self._forget_transport()
        before, self.sites = self.sites, None
        self._making, self.complete = None, False
        if before is not None and before is not self.shown:
            before.release()

    def _forget_transport(self) -> None:
        """Discard the transport between sites: until the next gather, no value follows changes."""
        self.follower = None
        for sites in (self.sites, self.shown):
            if sites is not None:
                sites.transport = None

    # ---- making ----------------------------------------------------------------------------------------------------

    def make(self, shadows: ShadowMaps, budget: Budget) -> bool:
        """Continue the next solution until the budget ends. Return True if lookups use its values now."""
        self._tick = shadows, budget
        self._making = self._making or self._solution()
        try:
            made = budget.advance(self._making)
            if made is None:
                return False
            assert self.sites is not None
            self._use(self.sites, made)
        except BaseException:  # a generator that was interrupted, or has returned, is over
            self._making = None
            raise
        if self._mixed:
            self._mixed = False
            self._forget_transport()
            self.expire()
        return True

    def follow(self, shadows: ShadowMaps, budget: Budget) -> float | None:
        """Update the values in use while the scene changes from frame to frame. Return their relative change; None for none."""
        follower, shown = self.follower, self.shown
        changing = self.still <= (_STILL if self._moved else 0)
        self.still += 1
        if follower is None or not (changing and budget.limited):
            if self._moved:
                self.still, self._moved = np.inf, False
                self.choose_again()
            return None
        assert shown is not None and shown.light is not None
        due, before = shown.records.column("due"), shown.light.irradiance
        order = np.argsort(-due, kind="stable")[: np.count_nonzero(due)]  # the sites around which most has moved come first
        done = self._gather(self._rays.gather(0.0), shown, order, shadows, budget.part(0.0, 0.0))
        E = follower.step(shadows, before, order[:done])
        shown.show(replace(shown.light, irradiance=E))
        return float(np.abs(E - before).mean() / max(float(before.mean()), 1e-20))

    @property
    def _chooser(self) -> SiteChooser:
        return SiteChooser(self.world.scene, self._rays.reach, self.detail, self.world.eyes)

    def _solution(self) -> Steps[BouncedLight]:
        """Return the light of all bounces at the sites. Choose the sites and their places, and gather E_1, where necessary."""
        if self.sites is None:
            self.sites = SurfaceSites(self.world.ctx, (yield from self._chooser.layout()))
        sites, records = self.sites, self.sites.records
        if sites.places is None:
            sites.places = yield from self._places(sites)
        while True:
            gather = self._rays.gather(1.0 / max(records.count, 1))
            if self.settings.most_bounces > 2 and sites.transport is None:
                records.invalidate()
                sites.transport = Transport(records.count, gather.share.size)
            self._gather(gather, sites, records.stale, *self._tick)
            if not len(records.stale):
                return (yield from sum_bounces(records.read()["irradiance"], sites.transport, self.settings))
            yield True

    def _places(self, sites: SurfaceSites) -> Steps[Sites]:
        """Return the ray origins of sites, by a survey along few rays."""
        records, rays = sites.records, LEAST_SIDE**2
        survey, shape = Transport(records.count, rays), (records.count, rays)
        met: list[np.ndarray] = [np.zeros((*shape, 3), "f4"), np.zeros((*shape, 3), "f4"), np.zeros(shape, np.intp)]
        while True:
            gather = self._rays.gather(0.0, survey=True)
            for batch in self._rays.gathered(gather, sites, np.flatnonzero(~survey.known), *self._tick):
                survey.fill(batch, *gather.hits(len(batch)))
                for column, values in zip(met, gather.met(len(batch)), strict=True):
                    column[batch] = values
            if survey.known.all():
                break
            yield True
        R, corners, meshes = records.read()["radius"], self.world.geometry.corners, in_order(self.world.scene)
        emissive = np.repeat([any(mesh.material.emission) for mesh in meshes], [len(mesh.faces) for mesh in meshes])
        where, seed = records.sites(slice(0, records.count)), self.settings.seed
        draw = partial(site_places, where, survey, met, R, sites.area, sites.level, corners, emissive, seed)
        return (yield from in_background(draw))

    def _gather(self, gather: TraceGather, sites: SurfaceSites, numbers: np.ndarray, shadows: ShadowMaps, budget: Budget) -> int:
        """Gather E_1 at sites of these numbers, and missing rows of their transport, within the budget. Return their number."""
        done, transport = 0, sites.transport
        for batch in self._rays.gathered(gather, sites, numbers, shadows, budget):
            if transport is not None and not transport.known[batch].all():
                transport.fill(batch, *gather.hits(len(batch)))
            sites.records.mark_refreshed(batch)
            done += len(batch)
        return done

    def _use(self, sites: SurfaceSites, made: BouncedLight) -> None:
        """Set the values of the lookups to those `made` at these `sites`."""
        sites.show(made)
        follower, everything = None, self.settings.bounces == "all" and self.detail.level <= 0
        if sites.transport is not None and sites.records.count and everything and not self._mixed:
            follower = Follower(self._rays, sites, sites.records.read()["irradiance"], made, self._tick[0])
        before, self.shown, self.follower = self.shown, sites, follower
        self._making, self.still, self._moved = None, np.inf, False
        if before is not None and before is not sites:
            before.release()
        self.complete = True  # last: after an interruption, the level is made again
