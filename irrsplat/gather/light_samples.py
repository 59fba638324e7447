"""Light samples: shadow rays from records to points of emitters, whose light is added to what the reduction sums."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl

from irrsplat.core.buffers import Atlas, LightSamples, TriangleOrder, Uniforms
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import Target
from irrsplat.gpu.world import World
from irrsplat.lighting.emitter_table import EmitterTable, emitter_table


class EmitterSearch:
    """How a gather of `world` looks for emitters: by `samples` light samples a record, 0 where there is nothing to look for.

    apart: not at all, since what they send out is sampled at the pixels; rays that hit them bring what they reflect. rays: the
    density of its rays as shaders/gather/ray_density.glsl has it. strata: whether they are cosine-stratified; else they are a
    hemicube's texels.
    """

    def __init__(self, world: World, samples: int, rays: float, strata: bool, apart: bool = False) -> None:
        self.world, self.rays, self.strata = world, rays, strata
        known = (samples > 0 or apart) and emitter_table(world) is not None
        self.apart = apart and known
        self.samples = samples if known and not apart else 0

    @property
    def _table(self) -> EmitterTable | None:
        """The table of the world as it is now; None where no ray has to know of it."""
        return emitter_table(self.world) if self.samples or self.apart else None

    @property
    def defines(self) -> dict[str, int]:
        """What the gather's shaders are compiled for; nothing is compiled where there are no emitters."""
        known = self.samples > 0 or self.apart
        return {"EMITTERS": int(known), "STRATA": int(self.strata), **({"EMITTERS_APART": 1} if self.apart else {})}

    def ray_uniforms(self, order: TriangleOrder) -> Uniforms:
        """The uniforms of shaders/lighting/emitters_hit.glsl for a gather that numbers triangles in this order, and of
        ray_density.glsl where its rays are strata."""
        table = self._table
        if table is None:
            return {}
        return {**table.ray_uniforms(order, self.samples), **({"rays": self.rays} if self.strata else {})}

    @property
    def light_samples(self) -> LightSamples | None:
        """What an Atlas says of them."""
        table = self._table if self.samples else None
        if table is None:
            return None
        uniforms = {**table.sample_uniforms(self.samples), **self.world.trace_uniforms, "rays": self.rays}
        return LightSamples(uniforms, self.strata, self.world.material_defines)


class LightSamplePass(Owner):
    """Adds the light samples of an atlas to the sums of its blocks; `gradients`: to those of M, ∇E and the Hessian, too."""

    def __init__(self, ctx: moderngl.Context, gradients: bool) -> None:
        self.ctx, self.gradients = ctx, gradients
        self._programs: dict[tuple[object, ...], Program] = {}
        for strata in (False, True):
            self._program(strata, {})

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return tuple(self._programs.values())

    def _program(self, strata: bool, materials: Mapping[str, int]) -> Program:
        """The program for rays of this kind and these materials."""
        defines = {"GRADIENTS": int(self.gradients), "STRATA": int(strata), **{name: on for name, on in materials.items() if on}}
        key = (*defines.items(),)
        if key not in self._programs:
            self._programs[key] = Program(self.ctx, "gather/light_samples", "lib/fullscreen", defines)
        return self._programs[key]

    def __call__(self, target: Target, atlas: Atlas, blocks: tuple[int, int], used: tuple[int, int, int, int]) -> None:
        """Add to the sums in `target`, `blocks` of them a cell, in the rectangle `used`."""
        if atlas.light_samples is None:
            return
        self._program(atlas.light_samples.strata, atlas.light_samples.materials)(
            target,
            state=DrawState(blend="add"),
            scissor=used,
            frames=atlas.frames,
            blocks=blocks,
            columns=atlas.columns,
            **atlas.light_samples.uniforms,
        )
