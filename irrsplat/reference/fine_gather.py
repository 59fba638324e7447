"""A reference without a path tracer: a fine gather at every tested pixel, without interpolation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from irrsplat.core.buffers import HitLight
from irrsplat.core.timing.clock import now
from irrsplat.gather.hemisphere import gather_records
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu.world import World
from irrsplat.indirect.paper_scan import SMOOTH_OFF, Seen
from irrsplat.lighting.shadow_maps import ShadowPass
from irrsplat.records.record_cache import RecordCache
from irrsplat.reference.truth import errors
from irrsplat.scene.model import Scene

SIDE = 128  # of a square of rays: 16 thousand directions
_LIGHT_SAMPLES = 1024  # shadow rays per pixel to emissive surfaces, which few hemisphere samples hit if they are small
_BATCH = 32  # pixels gathered at once


@dataclass(frozen=True)
class Truth:
    """Indirect irradiance E (N, 3) in W/m², one bounce, for mapped normals, at N pixels (N, 2): row from the top, column."""

    pixels: np.ndarray
    irradiance: np.ndarray

    def error(self, irradiance: np.ndarray) -> float | None:
        """Return the relative RMSE of a picture (H, W, 3), see `errors`; None without light."""
        return errors(irradiance[tuple(self.pixels.T)], self.irradiance)["rmse"]


def chosen(seen: Seen, scene: Scene, count: int) -> np.ndarray:
    """Return (N, 2) at most `count` random smooth pixels: row from the top, column."""
    candidates = np.argwhere(seen.smooth(SMOOTH_OFF * scene.diagonal))
    return np.random.default_rng(0).permutation(candidates)[:count]


def gather(world: World, seen: Seen, shadow_size: int, count: int = 500, seconds: float = 10.0) -> Truth:
    """Return the reference at `count` random smooth pixels of `seen`, or at as many as `seconds` allow."""
    ctx, scene = world.ctx, world.scene
    pixels = chosen(seen, scene, count)
    at = tuple(pixels.T)
    sites = replace(seen.sites(at), normal=seen.lit_normal[at])
    with (
        ShadowPass(ctx) as shadow,
        TraceGather(world, SIDE, capacity=_BATCH, light_samples=_LIGHT_SAMPLES) as gather,
        ReducePass(ctx, gradients=False) as reduce,
        RecordCache(ctx) as cache,
    ):
        light, start = HitLight(shadow(world, shadow_size)), now()
        while cache.count < len(sites) and now() - start < seconds:
            batch = sites[cache.count : cache.count + gather.capacity]
            gather_records(gather, reduce, light, cache, cache.append(batch) + np.arange(len(batch)), seed=0)
            ctx.finish()
        return Truth(pixels[: cache.count], cache.read()["irradiance"])
