"""Next-event estimation of records: shadow rays to points on emitters, added to the sums of the reduction."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import moderngl
import numpy as np

from irrsplat.core.buffers import Atlas, HitLight, LightSamples, Uniforms
from irrsplat.core.glsl import EYES_BESIDE, SHORT
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target, float_texture, uneven
from irrsplat.gpu.world import World
from irrsplat.lighting.emitter_table import EmitterTable, emitter_table
from irrsplat.lighting.virtual_lights import VirtualLights, virtual_lights

_RAYS = 64  # of a fragment in one draw: llvmpipe silently ends a shader's loops after 65 536 iterations in all
SAMPLE_SHARE = 0.25  # of the rays: greatest number of virtual point lights, and of a site's samples of emitters

Free = Callable[[np.ndarray, np.ndarray], np.ndarray]  # as LightSamples.free


class LightSearch:
    """Next-event estimation of a gather of `world`, for small bright sources.

    samples: number of shadow rays per record to emitters, and greatest number to virtual lights
    (irrsplat/lighting/virtual_lights.py); 0: none. rays: number of cosine-stratified rays per record, divided by π. embree:
    True if Embree traces the shadow rays.
    """

    def __init__(self, world: World, samples: int, rays: float, embree: bool = False) -> None:
        self.world, self.rays = world, rays
        self.embree = embree
        self._emitter_samples = samples if samples > 0 and emitter_table(world) is not None else 0
        # more virtual point lights do not reduce the noise of the rays
        self._virtual_samples = min(samples, max(int(SAMPLE_SHARE * np.pi * rays), 1))
        # True if virtual point lights are possible at any place of the world's lights: a shader define
        self._may_be_virtual = samples > 0 and bool(world.scene.lights)

    @property
    def _emitters(self) -> EmitterTable | None:
        """The present emitters of the world; None where rays need no weights for them."""
        return emitter_table(self.world) if self._emitter_samples else None

    def _virtual(self, light: HitLight) -> VirtualLights | None:
        """Return the present virtual point lights of the world; None for none."""
        requested = self._may_be_virtual and light.virtual
        return virtual_lights(self.world, self._virtual_samples, self.rays) if requested else None

    @property
    def defines(self) -> dict[str, int]:
        """Defines of the gather's shaders; both 0 for a scene without emitters and lights."""
        return {"EMITTERS": int(self._emitter_samples > 0), "VIRTUAL_LIGHTS": int(self._may_be_virtual)}

    def ray_uniforms(self, light: HitLight) -> Uniforms:
        """Return the uniforms of shaders/lighting/emitters_hit.glsl, of virtual_lights/hit.glsl, and of ray_density.glsl."""
        emitters, virtual, found = self._emitters, self._virtual(light), dict[str, Any]()
        if emitters is not None:
            found |= emitters.ray_uniforms(self._emitter_samples)
        if self._may_be_virtual:
            none = np.zeros((len(self.world.scene.lights), 4))
            found["virtual_lights"] = none if virtual is None else virtual.reach
            if any(light.directional for light in self.world.scene.lights):
                found["virtual_windows"] = none if virtual is None else virtual.windows
        return {**found, "rays": self.rays} if found else found

    def light_samples(self, rows: np.ndarray, light: HitLight) -> tuple[LightSamples, ...]:
        """Return the shadow-ray samples for an Atlas of records with these `rows` (5, N, 4) of its frames, lit by `light`."""
        emitters, virtual = self._emitters, self._virtual(light)
        sources: list[tuple[bool, int, Uniforms]] = []  # True for virtual lights
        if emitters is not None:
            sources.append((False, self._emitter_samples, emitters.sample_uniforms(self._emitter_samples)))
        if virtual is not None:
            sources.append((True, virtual.count, virtual.sample_uniforms(light.shadows)))
        free = self.world.caster.free if sources and self.embree else None
        common: Uniforms = {**self.world.seen_uniforms(self.embree), "rays": self.rays} if sources else {}
        return tuple(
            LightSamples(is_virtual, count, rows, {**common, **uniforms}, self.world.material_defines, free)
            for is_virtual, count, uniforms in sources
        )


class LightSamplePass(Owner):
    """Pass that adds next-event estimation to the sums of an atlas's blocks.

    gradients: True if it also adds to the sums of M, ∇E and the Hessian. places: number of eye positions of a record.
    """

    def __init__(self, ctx: moderngl.Context, gradients: bool, places: int = 1) -> None:
        self.ctx, self.gradients, self.places = ctx, gradients, places
        self._programs = self.own(Workshop())
        self._ends = [self.own(Program(ctx, "gather/light_samples/ends", "lib/fullscreen", {"VIRTUAL": of})) for of in (0, 1)]
        self._targets = self.own(Workshop())
        for virtual in (0, 1):
            self._program({"VIRTUAL": virtual, "SEEN": 0})

    def _program(self, defines: Mapping[str, int]) -> Program:
        """Return the program for this kind of samples and these materials."""
        defines = {"GRADIENTS": int(self.gradients), **defines}
        make = partial(Program, self.ctx, "gather/light_samples/sum", "lib/fullscreen", defines)
        return self._programs.get(f"{defines}", (), make)

    def __call__(self, target: Target, atlas: Atlas, blocks: tuple[int, int], used: tuple[int, int, int, int]) -> None:
        """Add the samples to the sums in `target`, `blocks` of them a cell, in the rectangle `used`."""
        for samples in atlas.light_samples:
            materials = {name: on for name, on in samples.materials.items() if on}
            known: Uniforms = {} if samples.free is None else {"seen": self._seen(atlas, samples, samples.free)}
            program = self._program({"VIRTUAL": int(samples.virtual), "SEEN": int(bool(known)), **materials})
            step = samples.count if known else _RAYS // self._eyes * blocks[0] * blocks[1]
            for first in range(0, samples.count, step):
                program(
                    target,
                    state=DrawState(blend="add"),
                    scissor=used,
                    frames=atlas.frames,
                    blocks=blocks,
                    columns=atlas.columns,
                    places=self.places,
                    samples=samples.count,
                    span=(first, min(first + step, samples.count)),
                    **program.declared(samples.uniforms),
                    **known,
                )

    @property
    def _eyes(self) -> int:
        """Number of eyes that test the visibility of each sample."""
        return 1 + EYES_BESIDE if self.gradients else 1

    def _seen(self, atlas: Atlas, samples: LightSamples, free: Free) -> moderngl.Texture:
        """Return the texture `seen` of shaders/gather/light_samples/sum.frag."""
        across, rows = samples.count, atlas.count
        # one texture for each gather size and power of two of samples: the number of virtual point lights changes often
        size = uneven(1 << across.bit_length()), atlas.frames.width
        ends = self._targets.get(f"ends of {size}", (), lambda: Target(self.ctx, size, (4,)))
        program = self._ends[int(samples.virtual)]
        program(ends, scissor=(0, 0, across, rows), frames=atlas.frames, places=self.places, **program.declared(samples.uniforms))
        found = np.frombuffer(ends.gl.read((0, 0, across, rows), 4, dtype="f4"), "f4").reshape(rows, across, 4)
        seen = self._targets.get(f"seen of {size}", (), lambda: float_texture(self.ctx, size, 1))
        bits = self._bits(samples.rows, found, free)
        seen.write(bits.astype("f4").tobytes(), viewport=(0, 0, across + 1, rows))
        return seen

    def _bits(self, rows: np.ndarray, away: np.ndarray, free: Free) -> np.ndarray:
        """Return (N, S + 1) int, the content of the texture `seen`: a bit for each eye of a record that sees each of S samples.

        rows: (5, N·places, 4) of the records. away: (N, S, 4) samples relative to the first eye, metres; w: 0 without light.
        """
        (count, across, _), eye = away.shape, rows[4, :, :3]
        bits = np.zeros((count, across + 1), np.int32)
        chosen = np.flatnonzero(away[..., 3] > 0.0)
        record, sample = np.divmod(chosen, across)
        start = eye.take(record * self.places + sample % self.places, axis=0)  # copies rows faster than an index does
        ends = start + away.reshape(-1, away.shape[2]).take(chosen, axis=0)[:, :3] * np.float32(1.0 - SHORT)
        angle = np.arange(self._eyes - 1)[:, None, None] * (2.0 * np.pi / EYES_BESIDE)
        beside = eye + rows[4, :, 3:] * (np.cos(angle) * rows[0, :, :3] + np.sin(angle) * rows[1, :, :3]).astype("f4")
        # all lines in one call: the cost of a call exceeds that of few lines
        starts = np.concatenate([start, beside.take(record, axis=1).reshape(-1, 3), np.tile(eye, (len(beside), 1))])
        found = free(starts, np.concatenate([np.tile(ends, (self._eyes, 1)), beside.reshape(-1, 3)]))
        lines = self._eyes * len(record)
        order = np.arange(self._eyes)[:, None]
        bits[record, sample] = (found[:lines].reshape(self._eyes, -1) << order).sum(0)
        bits[:, across] = (found[lines:].reshape(-1, count) << order[1:]).sum(0)
        return bits
