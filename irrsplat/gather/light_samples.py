"""Light samples: shadow rays from records to points of emitters, whose light is added to what the reduction sums."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import moderngl
import numpy as np

from irrsplat.core.buffers import Atlas, LightSamples, TriangleOrder, Uniforms
from irrsplat.core.glsl import EYES_BESIDE, SHORT
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.target import Target, float_texture
from irrsplat.gpu.world import World
from irrsplat.lighting.emitter_table import EmitterTable, emitter_table

_RAYS = 64  # of a fragment in one draw: llvmpipe ends a shader's loops, without a word, after 65 536 rounds of them in all

Free = Callable[[np.ndarray, np.ndarray], np.ndarray]  # as LightSamples.free


class EmitterSearch:
    """How a gather of `world` looks for emitters: by `samples` light samples a record, 0 where there is nothing to look for.

    apart: not at all, since what they send out is sampled at the pixels; rays that hit them bring what they reflect. rays: the
    density of its rays as shaders/gather/ray_density.glsl has it. strata: whether they are cosine-stratified; else they are a
    hemicube's texels. embree: that tells which samples are seen, but where something is cut out, which only shaders know.
    """

    def __init__(self, world: World, samples: int, rays: float, strata: bool, apart: bool = False, embree: bool = False) -> None:
        self.world, self.rays, self.strata = world, rays, strata
        self.embree = embree and not world.material_defines["CUT_OUTS"]
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

    def light_samples(self, rows: np.ndarray) -> LightSamples | None:
        """What an Atlas of records with these `rows` (5, N, 4) of its frames says of them."""
        table = self._table if self.samples else None
        if table is None:
            return None
        uniforms = {**table.sample_uniforms(self.samples), **self.world.trace_uniforms, "rays": self.rays}
        free = self.world.caster.free if self.embree else None
        return LightSamples(self.samples, rows, uniforms, self.strata, self.world.material_defines, free)


class LightSamplePass(Owner):
    """Adds the light samples of an atlas to the sums of its blocks; `gradients`: to those of M, ∇E and the Hessian, too."""

    def __init__(self, ctx: moderngl.Context, gradients: bool) -> None:
        self.ctx, self.gradients = ctx, gradients
        self._programs: dict[tuple[object, ...], Program] = {}
        self._ends = Program(ctx, "gather/light_samples/ends", "lib/fullscreen")
        self._targets = Workshop()
        for strata in (False, True):
            self._program({"STRATA": int(strata), "SEEN": 0})

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (*self._programs.values(), self._ends, self._targets)

    def _program(self, defines: Mapping[str, int]) -> Program:
        """The program for rays of this kind and these materials."""
        defines = {"GRADIENTS": int(self.gradients), **defines}
        key = (*defines.items(),)
        if key not in self._programs:
            self._programs[key] = Program(self.ctx, "gather/light_samples/sum", "lib/fullscreen", defines)
        return self._programs[key]

    def __call__(self, target: Target, atlas: Atlas, blocks: tuple[int, int], used: tuple[int, int, int, int]) -> None:
        """Add to the sums in `target`, `blocks` of them a cell, in the rectangle `used`."""
        samples = atlas.light_samples
        if samples is None:
            return
        materials = {name: on for name, on in samples.materials.items() if on}
        known: Uniforms = {} if samples.free is None else {"seen": self._seen(atlas, samples, samples.free)}
        program = self._program({"STRATA": int(samples.strata), "SEEN": int(bool(known)), **materials})
        step = samples.count if known else _RAYS // self._eyes * blocks[0] * blocks[1]
        for first in range(0, samples.count, step):
            program(
                target,
                state=DrawState(blend="add"),
                scissor=used,
                frames=atlas.frames,
                blocks=blocks,
                columns=atlas.columns,
                span=(first, min(first + step, samples.count)),
                **samples.uniforms,
                **known,
            )

    @property
    def _eyes(self) -> int:
        """From how many places each sample is looked at."""
        return 1 + EYES_BESIDE if self.gradients else 1

    def _seen(self, atlas: Atlas, samples: LightSamples, free: Free) -> moderngl.Texture:
        """The texture `seen` of shaders/gather/light_samples/sum.frag."""
        across, rows, most = samples.count, atlas.count, atlas.frames.width
        # gathers of several sizes take turns, and each keeps its own
        ends = self._targets.get(f"ends of {across} {most}", (), lambda: Target(self.ctx, (across, most), (4,)))
        uniforms = {name: value for name, value in samples.uniforms.items() if name in self._ends.uniforms}
        self._ends(ends, scissor=(0, 0, across, rows), frames=atlas.frames, **uniforms)
        found = np.frombuffer(ends.gl.read((0, 0, across, rows), 4, dtype="f4"), "f4").reshape(rows, across, 4)
        seen = self._targets.get(f"seen of {across} {most}", (), lambda: float_texture(self.ctx, (across + 1, most), 1))
        bits = self._bits(samples.rows, found[..., :3], found[..., 3] > 0.0, free)
        seen.write(bits.astype("f4").tobytes(), viewport=(0, 0, across + 1, rows))
        return seen

    def _bits(self, rows: np.ndarray, away: np.ndarray, possible: np.ndarray, free: Free) -> np.ndarray:
        """(N, S + 1) int, as the texture `seen` has it: of records with these `rows` (5, N, 4), which of their eyes see each of S
        samples, `away` (N, S, 3) from the first, metres. No light comes where it is not `possible` (N, S)."""
        (count, across), eye = possible.shape, rows[4, :, :3]
        bits = np.zeros((count, across + 1), np.int32)
        record, sample = np.nonzero(possible)
        ends = eye[record] + away[record, sample] * np.float32(1.0 - SHORT)
        angle = np.arange(self._eyes - 1)[:, None, None] * (2.0 * np.pi / EYES_BESIDE)
        beside = eye + rows[4, :, 3:] * (np.cos(angle) * rows[0, :, :3] + np.sin(angle) * rows[1, :, :3]).astype("f4")
        # all lines at once: few of them are traced in hardly less time
        starts = np.concatenate([eye[record], beside[:, record].reshape(-1, 3), np.tile(eye, (len(beside), 1))])
        found = free(starts, np.concatenate([np.tile(ends, (self._eyes, 1)), beside.reshape(-1, 3)]))
        lines = self._eyes * len(record)
        order = np.arange(self._eyes)[:, None]
        bits[record, sample] = (found[:lines].reshape(self._eyes, -1) << order).sum(0)
        bits[:, across] = (found[lines:].reshape(-1, count) << order[1:]).sum(0)
        return bits
