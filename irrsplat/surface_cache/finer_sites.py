"""Refinement of a surface cache while a view rests: more rays from its sites, then more sites where light changes."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from irrsplat.core.buffers import HitLight, ShadowMaps
from irrsplat.core.timing.beside import beside
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.time_budget import Budget, Pace
from irrsplat.gpu.world import World
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.model import Scene
from irrsplat.settings import Settings
from irrsplat.surface_cache.lookup_table import Held, LaidOut, LookupTable
from irrsplat.surface_cache.site_layout import DARK_VALUE, FIRST_SITE, MAX_REFINED_SITES, SKY_VALUE, SiteChooser, SiteLayout
from irrsplat.surface_cache.site_rays import PlaceSearch, SiteRays
from irrsplat.surface_cache.site_splitting import SiteSplitter, SplitLayout, uncut
from irrsplat.surface_cache.transport import BouncedLight, Transport, sum_bounces

_MORE, _ROOM = 0.75, 0.7  # of the sites, and of those that there may be beside them: how many a refinement adds
_WORTH = 0.1  # of the sites: fewer are not worth one
_SAME = 1e-6  # of its area: by how much a site's may differ that speaks for the same surface


def with_known(E_1: np.ndarray, scene: Scene) -> np.ndarray:
    """The irradiance E_1 (S, 3) of sites, with the values that are known without a gather set in place."""
    E_1[SKY_VALUE : SKY_VALUE + 1] = np.pi * np.asarray(scene.sky)
    E_1[DARK_VALUE : DARK_VALUE + 1] = 0.0
    return E_1


def bounces_of(E_1: np.ndarray, transport: Transport | None, area: np.ndarray, settings: Settings) -> Iterator[BouncedLight]:
    """Light of E_1 (S, 3) at sites that stand for `area` (S,), by one bounce more from each to the next, to the last that the
    settings ask for."""
    return sum_bounces(
        E_1, transport if settings.most_bounces > 2 else None, area, settings.most_bounces, settings.bounces == "all"
    )


@dataclass(frozen=True, eq=False)
class _Work:
    """The next refinement, as far as it is made. E_1: (S, 3) of the sites, by more rays where it is `known` (S,). choosing: the
    sites; once they are chosen, `cut` has them, None where no cell is cut, and `laid_out`. searching: for their places.
    transport: between them; None where no bounce needs it. made: bounces so far."""

    E_1: np.ndarray
    known: np.ndarray
    choosing: Generator[float, None, SplitLayout] | None = None
    cut: SplitLayout | None = None
    laid_out: LaidOut | None = None
    searching: PlaceSearch | None = None
    transport: Transport | None = None
    making: Iterator[BouncedLight] | None = None
    made: BouncedLight | None = None


class FinerSites(Owner):
    """Refines the values `base` of a surface cache, between whose sites `transport` is known.

    The first refinement lets E_1 come from four times as many rays at the same sites, each further one adds sites where light
    changes most. held: what lookups find by the last one that is done; refinements: how many these are.
    """

    def __init__(
        self,
        world: World,
        rays: SiteRays,
        chooser: SiteChooser,
        base: Held,
        transport: Transport | None,
        settings: Settings,
    ) -> None:
        assert base.laid_out is not None
        self.world, self.rays, self.chooser, self.settings = world, rays, chooser, settings
        self.held, self.refinements = base, 0
        self._base, self._before = base, base
        self._pace, self._link_pace = Pace(world.ctx), Pace(world.ctx)
        self._cut: SplitLayout | None = None  # made by the first refinement that cuts cells
        count = base.laid_out.records.count
        self._E_1 = np.zeros((count, 3), np.float32)  # of the sites, by more rays
        self._known = np.arange(count) < FIRST_SITE  # which of them have it
        self._transport: Transport | None = transport
        self._work: _Work | None = None

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees: all but the base."""
        work = None if self._work is None else self._work.laid_out
        made = {self.held.laid_out, self._before.laid_out, work} - {self._base.laid_out, None}
        return tuple(made)

    @property
    def before(self) -> LookupTable:
        """The table from before the last refinement."""
        return self._before.table

    @property
    def may_split(self) -> bool:
        """Whether the next refinement adds a good many sites, if there has been a first one."""
        assert self.held.laid_out is not None
        count = self.held.laid_out.records.count
        return self._further(count) > _WORTH * count

    def refine(self, shadows: ShadowMaps, budget: Budget) -> bool:
        """Go on with the next refinement, as far as the budget goes; whether it is done now. One that fails begins anew."""
        try:
            return self._refine(shadows, budget)
        except BaseException:  # its generators are at their end
            work, self._work = self._work, None
            if work is not None and work.laid_out is not None and work.laid_out is not self.held.laid_out:
                work.laid_out.release()
            raise

    def _refine(self, shadows: ShadowMaps, budget: Budget) -> bool:
        work = self._work or self._begun()
        self._work = work = self._chosen(work, budget)
        if work.laid_out is None:
            return False
        self._work = work = self._placed(work, shadows, budget)
        if work.searching is not None or not self._linked(work, shadows, budget) or not self._lit(work, shadows, budget):
            return False
        self._work = work = self._bounced(work, budget)
        if work.made is None or not work.made.complete:
            return False
        self._hold(work)
        return True

    def _further(self, count: int) -> int:
        """How many sites a refinement adds to `count`, about."""
        return min(int(_MORE * count), int(_ROOM * (MAX_REFINED_SITES - count)))

    def _begun(self) -> _Work:
        assert self.held.light is not None and self.held.laid_out is not None
        if not self.refinements:
            same = self._laid_out(self.held.laid_out.layout)
            same.places = self.held.laid_out.places
            return _Work(self._E_1, self._known, laid_out=same, transport=self._transport)
        E = self.held.light.irradiance
        return _Work(self._E_1, self._known, self._split(SiteSplitter(self.chooser, E.astype(float), self._further(len(E)))))

    def _split(self, splitter: SiteSplitter) -> Generator[float, None, SplitLayout]:
        """Choose further sites."""
        assert self._base.laid_out is not None
        cut = self._cut
        if cut is None:  # seconds for a million triangles
            cut = yield from beside(partial(uncut, self._base.laid_out.layout), 0.0)
        return (yield from splitter.split(cut))

    def _laid_out(self, layout: SiteLayout) -> LaidOut:
        """Sites on the GPU, by the base's tables as far as they are the same."""
        return LaidOut(self.world.ctx, layout, self._base.laid_out)

    def _chosen(self, work: _Work, budget: Budget) -> _Work:
        """Go on choosing the sites."""
        if work.laid_out is not None or work.choosing is None:
            return work
        cut = budget.go_on(work.choosing)
        if cut is None:
            return work
        laid_out, transport = self._laid_out(cut.layout), None
        if self.settings.most_bounces > 2:
            transport = Transport(laid_out.records.count, self.rays.linking_gather(laid_out.records.count).share.size)
            transport.known[:FIRST_SITE] = True
        searching = PlaceSearch(self.rays, laid_out)
        return replace(work, choosing=None, cut=cut, laid_out=laid_out, searching=searching, transport=transport)

    def _placed(self, work: _Work, shadows: ShadowMaps, budget: Budget) -> _Work:
        """Go on with the search for the places of the sites. Those that speak for the same surface as before keep theirs."""
        found = None if work.searching is None else work.searching.go_on(shadows, budget)
        if found is None:
            return work
        before, laid_out = self.held.laid_out, work.laid_out
        assert before is not None and before.places is not None and laid_out is not None
        area, now = before.layout.area, laid_out.layout.area
        same = np.flatnonzero(np.abs(now[: len(area)] - area) <= _SAME * area)
        laid_out.places = before.places.onto(found, same)
        E_1, known = np.zeros((len(now), 3), np.float32), np.arange(len(now)) < FIRST_SITE
        E_1[same], known[same] = work.E_1[same], work.known[same]
        return replace(work, searching=None, E_1=E_1, known=known)

    def _linked(self, work: _Work, shadows: ShadowMaps, budget: Budget) -> bool:
        """Go on with the transport between the sites; whether it is known."""
        assert work.laid_out is not None
        transport, records, places, done = work.transport, work.laid_out.records, work.laid_out.places, 0
        if transport is None or transport is self._transport:
            return True
        assert places is not None
        gather, table, left = self.rays.linking_gather(records.count), work.laid_out.table, np.flatnonzero(~transport.known)
        light = HitLight(shadows, table.uniforms)
        for count in self._link_pace.batches(len(left), gather.capacity, budget, gather.share.size):
            numbers = left[done : done + count]
            self.rays.light(gather, light, records, numbers, places.of)
            self.rays.link(gather, transport, places, numbers)
            done += count
        return done == len(left)

    def _lit(self, work: _Work, shadows: ShadowMaps, budget: Budget) -> bool:
        """Go on gathering E_1 at the sites that lack it by more rays; whether all have it."""
        assert self._base.laid_out is not None and work.laid_out is not None and work.laid_out.places is not None
        sites, places, left, done = work.laid_out.layout.sites, work.laid_out.places, np.flatnonzero(~work.known), 0
        gather = self.rays.finer_gather(self._base.laid_out.records.count)
        with RecordCache(self.world.ctx) as scratch:
            for count in self._pace.batches(len(left), gather.capacity, budget, gather.share.size):
                scratch.append(sites[left[done : done + count]])
                rows = np.arange(done, done + count)
                self.rays.light(gather, HitLight(shadows), scratch, rows, lambda rows: places.of(left[rows]))
                done += count
            work.E_1[left[:done]] = scratch.read()["irradiance"]
        work.known[left[:done]] = True
        return done == len(left)

    def _bounced(self, work: _Work, budget: Budget) -> _Work:
        """Go on with the sum of all bounces."""
        assert work.laid_out is not None
        E_1, area = with_known(work.E_1.copy(), self.chooser.scene), work.laid_out.layout.area
        making = work.making or bounces_of(E_1, work.transport, area, self.settings)
        made = next(making)
        while not made.complete and budget.left > 0.0:
            made = next(making)
        return replace(work, making=making, made=made)

    def _hold(self, work: _Work) -> None:
        """Let lookups find its values."""
        assert work.laid_out is not None and work.made is not None
        work.laid_out.table.write(work.made.irradiance)
        gone, self._before = self._before, self.held
        if gone is not self._base and gone.laid_out is not None:
            gone.laid_out.release()
        self.held = Held(work.laid_out.table, work.laid_out, work.made, complete=True)
        self._cut, self._E_1, self._known, self._transport, self._work = work.cut, work.E_1, work.known, work.transport, None
        self.refinements += 1
