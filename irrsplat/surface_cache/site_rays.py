"""Rays from the sites of a surface cache: their incident light, the sites that they hit, and visibility."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import moderngl
import numpy as np

from irrsplat.core.buffers import HitLight, ShadowMaps, Uniforms
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gather.hemisphere import gather_records
from irrsplat.gather.kinds import ray_kind
from irrsplat.gather.light_samples import SAMPLE_SHARE
from irrsplat.gather.record_frame import FEW_RAYS, PLACES
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.stratified import LEAST_SIDE
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target, float_texture
from irrsplat.gpu.texel_table import table_rows
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.world import World
from irrsplat.lighting.emitter_table import emitter_table
from irrsplat.lighting.light_table import light_defines
from irrsplat.lighting.site_light import SiteLightPass
from irrsplat.settings import Settings
from irrsplat.surface_cache.site_layout import SEGMENTS, Detail
from irrsplat.surface_cache.surface_sites import SurfaceSites

RAYS = 1_000_000  # about, of all sites of a full level: among many sites, more of them light a record
SIDES = (8, 20)  # the least and the greatest: side² rays a site


class SiteRays(Owner):
    """The gathers from sites in a `world`, by the settings that are set last; detail: of the surface cache."""

    def __init__(self, world: World, settings: Settings, detail: Detail) -> None:
        self.world, self.settings, self._detail = world, settings, detail
        self._visibility = self.own(VisibilityPass(world.ctx, world.material_defines))
        self._reduce = {places: self.own(ReducePass(world.ctx, gradients=False, places=places)) for places in (1, PLACES)}
        self._made = self.own(Workshop())

    @property
    def _embree(self) -> bool:
        """True if Embree traces the sites' rays."""
        return ray_kind(self.world.ctx, self.settings) == "embree"

    def gather(self, share: float, survey: bool = False) -> TraceGather:
        """Return the rays from the places of a site, with the sites that they meet, compiled for the scene's kinds of lights.

        share: of the rays of all sites; 0 for the fewest rays. survey: few rays from the site itself, with the places where they
        meet other sites.
        """
        least, most = (round(limit * self._detail.rays**0.5) for limit in SIDES)
        rays = RAYS * self._detail.points * self._detail.rays * share
        side = LEAST_SIDE if survey else int(np.clip(np.sqrt(rays), least, most))
        lights, samples = light_defines(self.world.scene), min(self.settings.light_samples, int(SAMPLE_SHARE * side**2))
        embree, emitters, places = self._embree, samples > 0 and emitter_table(self.world) is not None, 1 if survey else PLACES
        return self._made.get(
            f"gather {share > 0.0} {survey}",
            (side, lights, samples, embree, emitters),
            lambda: TraceGather(
                self.world, side, FEW_RAYS // side**2, hits=True, places=places, light_samples=samples, embree=embree
            ),
        )

    def gathered(
        self,
        gather: TraceGather,
        sites: SurfaceSites,
        numbers: np.ndarray,
        shadows: ShadowMaps,
        budget: Budget,
    ) -> Iterator[np.ndarray]:
        """Gather E_1 at the sites of these `numbers` within the budget. Yield the numbers of each batch once records hold it."""
        # neither a survey nor coarse light waits for the tree of the rays of virtual point lights
        virtual = sites.places is not None and (self._detail.level >= 0 or self.world.has_tree)
        light = HitLight(shadows, sites.uniforms(self.world), virtual)
        reduce, records, seed = self._reduce[gather.places], sites.records, self.settings.seed
        for some in gather.batches(len(numbers), budget):
            gather_records(gather, reduce, light, records, numbers[some], seed, where=sites.origins)
            yield numbers[some]

    def direct_light(self, sites: SurfaceSites, shadows: ShadowMaps) -> np.ndarray:
        """Return (S, 3) the direct irradiance of lights at the sites, W/m², a mean over a disc of each site's area."""
        lights, records = light_defines(self.world.scene), sites.records
        inputs = lights, records.count
        light_pass = self._made.get("direct", inputs, lambda: SiteLightPass(self.world.ctx, lights, max(records.count, 1)))
        E, _ = light_pass(shadows, records.sites(slice(0, records.count)), sites.area)
        return E

    def reach(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return (N,) the visible share of segments, see RayCaster.reach.

        Among trees, nine tenths of the time are for cut-out triangles: with Embree, rays of a coarse level pass these.
        """
        if self._embree:
            return self.world.caster.reach(starts, ends, cut_outs=self._detail.level >= 0)
        return self._visibility(self.world.ray_uniforms, starts, ends)


class VisibilityPass(Owner):
    """Pass that finds the visible shares of up to SEGMENTS segments, by rays through the tree in a shader.

    materials: World.material_defines (default: no holes).
    """

    def __init__(self, ctx: moderngl.Context, materials: Mapping[str, int] | None = None) -> None:
        rows = SEGMENTS // TABLE_COLUMNS
        self.program = self.own(Program(ctx, "surface_cache/visibility", "lib/fullscreen", materials or {}))
        self.lines = self.own(float_texture(ctx, (2 * TABLE_COLUMNS, rows)))
        self.target = self.own(Target(ctx, (TABLE_COLUMNS, rows), (1,)))

    def __call__(self, rays: Uniforms, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return (N,) the visible share of the segments from `starts` to `ends`, (N, 3) metres each, see RayCaster.reach.

        rays: the uniforms of shaders/lib/rays/bvh.glsl, see World.ray_uniforms.
        """
        rows = table_rows(np.pad(np.stack([starts, ends], axis=1), ((0, 0), (0, 0), (0, 1))).astype("f4"))
        self.lines.write(rows.tobytes(), viewport=(0, 0, 2 * TABLE_COLUMNS, len(rows)))
        self.program(self.target, scissor=(0, 0, TABLE_COLUMNS, len(rows)), lines=self.lines, **rays)
        return np.frombuffer(self.target.textures[0].read(), "f4")[: len(starts)]
