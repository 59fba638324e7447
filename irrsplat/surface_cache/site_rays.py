"""Rays from the sites of a surface cache: what light comes to them, which other sites they meet, and what they see."""

from __future__ import annotations

import numpy as np

from irrsplat.core.buffers import HitLight, Sites
from irrsplat.gather.autotune import ray_kind
from irrsplat.gather.look import gather_records
from irrsplat.gather.record_frame import tangent_frames
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.world import World
from irrsplat.lighting.emitter_table import emitter_table
from irrsplat.lighting.light_table import light_defines
from irrsplat.records.record_cache import RecordCache
from irrsplat.settings import Settings
from irrsplat.surface_cache.transport import Transport
from irrsplat.surface_cache.visibility import VisibilityPass, seen_by_embree

RAYS = 10 << 18  # of all sites together, about: where these are many, what lights a record is the mean of more of them
SIDES = (8, 16)  # the least and the greatest: side² rays a site
_LIGHT_SAMPLES = 0.25  # of its rays: a site's shadow rays to emitters, at most
_BATCH = 128  # sites gathered at once, at most


class SiteRays(Owner):
    """The gathers from sites in a `world`, by the settings that are set last."""

    def __init__(self, world: World, settings: Settings) -> None:
        self.ctx, self.world, self.settings = world.ctx, world, settings
        self._visibility = VisibilityPass(self.ctx, world.material_defines)
        self._reduce = ReducePass(self.ctx, gradients=False)
        self._made = Workshop()

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self._visibility, self._reduce, self._made)

    @property
    def _embree(self) -> bool:
        """Whether Embree traces its rays."""
        return ray_kind(self.ctx, self.settings) == "embree"

    def gather_for(self, sites: int, quick: bool = False) -> TraceGather:
        """Rays from so many sites, compiled for the kinds of lights that there are. quick: as few as may be."""
        return self._gather("quick gather" if quick else "gather", SIDES[0] if quick else self._side(sites, RAYS), links=True)

    def linking_gather(self, sites: int) -> TraceGather:
        """The same with up to twice as many rays in all, for the transport between refined sites."""
        return self._gather("linking gather", self._side(sites, 2 * RAYS), links=True)

    @staticmethod
    def _side(sites: int, rays: int) -> int:
        return int(np.clip(np.sqrt(rays / max(sites, 1)), *SIDES))

    def finer_gather(self, sites: int) -> TraceGather:
        """Twice as many rays in either direction from so many sites, which ask for nothing but the light that they meet."""
        return self._gather("finer gather", 2 * self.gather_for(sites).side, links=False)

    def _gather(self, name: str, side: int, links: bool) -> TraceGather:
        """Rays of this side; links: which sites they meet is told, too."""
        lights, samples = light_defines(self.world.scene), min(self.settings.light_samples, int(_LIGHT_SAMPLES * side**2))
        embree, emitters = self._embree, samples > 0 and emitter_table(self.world) is not None
        return self._made.get(
            name,
            (side, lights, samples, embree, emitters),
            lambda: TraceGather(self.world, side, _BATCH, surface=links, hits=links, light_samples=samples, embree=embree),
        )

    def light(self, gather: TraceGather, light: HitLight, records: RecordCache, numbers: np.ndarray) -> None:
        """Gather E_1 at the sites of these `numbers` in `records`."""
        gather_records(gather, self._reduce, light, records, numbers, self.settings.seed)

    def link(self, gather: TraceGather, transport: Transport, sites: Sites, numbers: np.ndarray) -> None:
        """Fill the rows `numbers` of the transport by what the rays of the last gather met, from these sites."""
        transport.fill(numbers, self._shares(gather, sites, numbers), gather.hits(len(numbers)))

    def _shares(self, gather: TraceGather, sites: Sites, numbers: np.ndarray) -> np.ndarray:
        """(N, R) cosθ·dω of the rays of sites, 0 for those below the surface."""
        frames = tangent_frames(sites.normal, sites.frame_rotations(numbers), self.settings.seed)
        below = np.einsum("nij,nj->ni", frames, sites.geometric) @ gather.directions.T <= 0.0
        return np.where(below, 0.0, gather.share.ravel())

    def see(self, lines: np.ndarray) -> np.ndarray:
        """(N,) which of these sight lines (N, 3, 3) are free; what is cut out, only shaders know."""
        if self._embree and not self.world.material_defines["CUT_OUTS"]:
            return seen_by_embree(self.world.caster, lines)
        return self._visibility(self.world.ray_uniforms, lines)
