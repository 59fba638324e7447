"""Rays from the sites of a surface cache: their incident light, the sites that they hit, and visibility."""

from __future__ import annotations

from collections.abc import Callable, Generator
from functools import partial

import numpy as np

from irrsplat.core.buffers import HitLight, ShadowMaps, Sites
from irrsplat.core.timing.background import in_background
from irrsplat.gather.hemisphere import gather_records
from irrsplat.gather.kinds import ray_kind
from irrsplat.gather.record_frame import places_of_texels, tangent_frames
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.world import World
from irrsplat.lighting.emitter_table import emitter_table
from irrsplat.lighting.light_table import light_defines
from irrsplat.records.record_cache import RecordCache
from irrsplat.settings import Settings
from irrsplat.surface_cache.lookup_table import LaidOut
from irrsplat.surface_cache.site_layout import Detail
from irrsplat.surface_cache.site_places import PLACES, Places, Survey
from irrsplat.surface_cache.transport import Transport
from irrsplat.surface_cache.visibility import VisibilityPass

RAYS = 1_000_000  # about, of all sites: among many sites, more of them light a record
SIDES = (8, 20)  # the least and the greatest: side² rays a site
_MOST_RAYS = 4.0  # times as many of finer levels, at most, since each takes 20 bytes of the transport
_SURVEY = 4  # side² rays a site
_LIGHT_SAMPLES = 0.25  # of its rays: a site's shadow rays to emitters, at most
_BATCH_RAYS = 51_200  # rays traced at once, about
_BATCH, _MOST_BATCH = 128, 1024  # sites gathered at once: the least capacity, and the greatest


class SiteRays(Owner):
    """The gathers from sites in a `world`, by the settings that are set last; detail: of the surface cache."""

    def __init__(self, world: World, settings: Settings, detail: Detail) -> None:
        self.ctx, self.world, self.settings, self._detail = world.ctx, world, settings, detail
        self._visibility = VisibilityPass(self.ctx, world.material_defines)
        self._reduce = ReducePass(self.ctx, gradients=False, places=PLACES)
        self._survey_reduce = ReducePass(self.ctx, gradients=False)
        self._made = Workshop()

    def owned(self) -> tuple[Resource | None, ...]:
        """Return the resources that `release` frees."""
        return (self._visibility, self._reduce, self._survey_reduce, self._made)

    @property
    def _embree(self) -> bool:
        """True if Embree traces the sites' rays."""
        return ray_kind(self.ctx, self.settings) == "embree"

    def gather_for(self, sites: int, quick: bool = False) -> TraceGather:
        """Return the gather for so many sites, compiled for the scene's kinds of lights. quick: True for the fewest rays."""
        return self._gather("quick gather" if quick else "gather", self._side(0, 0) if quick else self._side(sites, RAYS))

    def _side(self, sites: int, rays: int) -> int:
        share = self._detail.rays
        side = np.sqrt(rays * min(self._detail.points, _MOST_RAYS) * share / max(sites, 1))
        return int(np.clip(side, *(round(limit * share**0.5) for limit in SIDES)))

    def survey_gather(self) -> TraceGather:
        """Return the gather of few rays from each site itself, with the places of their hits."""
        return self._gather("survey", _SURVEY, survey=True)

    def _gather(self, name: str, side: int, survey: bool = False) -> TraceGather:
        """Return rays of this side from the places of sites, with the sites that they meet. survey: from the sites themselves,
        with the places where they meet others."""
        lights, samples = light_defines(self.world.scene), min(self.settings.light_samples, int(_LIGHT_SAMPLES * side**2))
        embree, emitters = self._embree, samples > 0 and emitter_table(self.world) is not None
        return self._made.get(
            name,
            (side, lights, samples, embree, emitters),
            lambda: TraceGather(
                self.world,
                side,
                min(max(_BATCH_RAYS // side**2, _BATCH), _MOST_BATCH),
                hits=True,
                places=1 if survey else PLACES,
                light_samples=samples,
                survey=survey,
                embree=embree,
            ),
        )

    def light(
        self,
        gather: TraceGather,
        light: HitLight,
        records: RecordCache,
        numbers: np.ndarray,
        places: Callable[[np.ndarray], Sites],
    ) -> None:
        """Gather E_1 at the sites of these `numbers` in `records`, from their `places`, see Places.of."""
        gather_records(gather, self._reduce, light, records, numbers, self.settings.seed, where=places)

    def link(self, gather: TraceGather, transport: Transport, places: Places, numbers: np.ndarray) -> None:
        """Fill the rows `numbers` of the transport by the hits of the last gather's rays from these places."""
        transport.fill(numbers, self._shares(gather, places.of(numbers)), gather.hits(len(numbers)))

    def survey(self, gather: TraceGather, light: HitLight, records: RecordCache, survey: Survey, numbers: np.ndarray) -> None:
        """Store the ray hits of the sites of these `numbers` in the survey, and their harmonic mean distances in `records`."""
        gather_records(gather, self._survey_reduce, light, records, numbers, self.settings.seed)
        share = self._shares(gather, records.sites(numbers))
        survey.store(numbers, share, gather.hits(len(numbers)), gather.met(len(numbers)))

    def _shares(self, gather: TraceGather, sites: Sites) -> np.ndarray:
        """Return (N, R) cosθ·dω of the rays from these places, those of N sites, 0 for those below the surface."""
        assert sites.frame_rotation is not None
        frames = tangent_frames(sites.normal, sites.frame_rotation, self.settings.seed)
        upward = np.einsum("nij,nj->ni", frames, sites.geometric).reshape(-1, gather.places, 3)
        table, place_of = gather.table.reshape(-1, 4), places_of_texels(gather.cell, gather.places)
        share = np.empty((len(upward), len(table)))
        for place in range(gather.places):
            texels = place_of == place
            below = upward[:, place] @ table[texels, :3].T <= 0.0
            share[:, texels] = np.where(below, 0.0, table[texels, 3])
        return share

    def reach(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return (N,) the visible share of segments, see RayCaster.reach."""
        if self._embree:
            return self.world.caster.reach(starts, ends)
        return self._visibility(self.world.ray_uniforms, starts, ends)


class PlaceSearch:
    """Search for the ray origins of the sites `laid_out`, by a survey along few rays."""

    def __init__(self, rays: SiteRays, laid_out: LaidOut) -> None:
        self._rays, self._laid_out = rays, laid_out
        records = laid_out.records
        gather = rays.survey_gather()
        self._survey = Survey(records.sites(slice(0, records.count)), gather.share.size)
        self._drawing: Generator[None, None, Places] | None = None

    def advance(self, shadows: ShadowMaps, budget: Budget) -> Places | None:
        """Continue within the budget. Return the places once they are found."""
        rays, laid_out, survey = self._rays, self._laid_out, self._survey
        records, gather = laid_out.records, rays.survey_gather()
        light = HitLight(shadows, laid_out.table.uniforms | rays.world.triangles.corner_uniforms, virtual=False)
        left = np.arange(survey.done, records.count)
        for some in gather.batches(len(left), budget):
            rays.survey(gather, light, records, survey, left[some])
        if survey.done < records.count:
            return None
        if self._drawing is None:
            R, area, corners = records.read()["radius"], laid_out.area, rays.world.geometry.corners
            self._drawing = in_background(partial(survey.places, R, area, corners, rays.settings.seed), None)
        return budget.advance(self._drawing)
