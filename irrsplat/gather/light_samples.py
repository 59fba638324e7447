"""Next-event estimation of records: shadow rays to points on emitters, which the reduction adds to its sums."""

from __future__ import annotations

from typing import Any

import numpy as np

from irrsplat.core.buffers import HitLight, LightSamples, Uniforms
from irrsplat.gpu.world import World
from irrsplat.lighting.emitter_table import emitter_table
from irrsplat.lighting.virtual_lights import virtual_lights

SAMPLE_SHARE = 0.25  # of the rays: greatest number of virtual point lights, and of a site's samples of emitters


class LightSearch:
    """Next-event estimation of a gather of `world`, for small bright sources.

    samples: number of shadow rays per record to emitters, and greatest number to virtual lights
    (irrsplat/lighting/virtual_lights.py); 0: none. rays: number of cosine-stratified rays per record, divided by π. embree:
    True if Embree traces the shadow rays.
    """

    def __init__(self, world: World, samples: int, rays: float, embree: bool = False) -> None:
        self.world, self.rays, self.embree = world, rays, embree
        self._emitter_samples = samples if samples > 0 and emitter_table(world) is not None else 0
        # more virtual point lights do not reduce the noise of the rays
        self._virtual_samples = min(samples, max(int(SAMPLE_SHARE * np.pi * rays), 1))
        # True if virtual point lights are possible at any place of the world's lights: a shader define
        self._may_be_virtual = samples > 0 and bool(world.scene.lights)

    @property
    def defines(self) -> dict[str, int]:
        """Defines of the gather's shaders; both 0 for a scene without emitters and lights."""
        return {"EMITTERS": int(self._emitter_samples > 0), "VIRTUAL_LIGHTS": int(self._may_be_virtual)}

    def __call__(self, rows: np.ndarray, light: HitLight) -> tuple[Uniforms, tuple[LightSamples, ...]]:
        """Return the uniforms of rays, and the shadow rays, for an Atlas of records with these `rows` (5, N, 4) of its frames.

        The uniforms are those of shaders/lighting/emitters_hit.glsl, of virtual_lights/hit.glsl, and of ray_density.glsl. light:
        the light at hits.
        """
        world, lights = self.world, self.world.scene.lights
        rays: dict[str, Any] = {}
        sources: list[tuple[bool, int, Uniforms]] = []  # True for virtual lights
        emitters = emitter_table(world) if self._emitter_samples else None
        if emitters is not None:
            rays |= emitters.ray_uniforms(self._emitter_samples)
            sources.append((False, self._emitter_samples, emitters.sample_uniforms(self._emitter_samples)))
        if self._may_be_virtual:
            virtual = virtual_lights(world, self._virtual_samples, self.rays) if light.virtual else None
            none = np.zeros((len(lights), 4))
            rays["virtual_lights"] = none if virtual is None else virtual.reach
            if any(light.directional for light in lights):
                rays["virtual_windows"] = none if virtual is None else virtual.windows
            if virtual is not None:
                sources.append((True, virtual.count, virtual.sample_uniforms(light.shadows)))
        density = {"rays": self.rays} if rays else {}
        common = {**world.seen_uniforms(self.embree), **density} if sources else {}
        free = world.caster.free if sources and self.embree else None
        samples = (
            LightSamples(is_virtual, count, rows, {**common, **uniforms}, world.material_defines, free)
            for is_virtual, count, uniforms in sources
        )
        return {**rays, **density}, tuple(samples)
