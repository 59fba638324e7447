"""The reduction: irradiance and harmonic mean distance of a batch of records from their atlas, on the GPU.

E = Σ L·cosθ·dω (Larsen and Christensen 2004), R = Σ cosθ·dω / Σ (cosθ·dω / r). Next-event estimation adds to the sums.
"""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import moderngl
import numpy as np

from irrsplat.core.buffers import Atlas, LightSamples, Records, Uniforms
from irrsplat.core.glsl import EYES_BESIDE, SHORT
from irrsplat.core.record_layout import GATHERED
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Region, Target, float_texture, uneven
from irrsplat.lighting.sky import sky_defines
from irrsplat.settings import WIDE

_SUMS = "sums", "share", *(f"sums_{what}_{channel}" for what, channel in product("mg", "rgb"))  # as in reduce_blocks.frag
_RAYS = 64  # of a fragment in one draw: llvmpipe silently ends a shader's loops after 65 536 iterations in all


class ReducePass(Owner):
    """Pass that sums the cells of an atlas: first each block, then the shadow rays to lights, then all blocks of a record.

    gradients: True if it also computes M, ∇E and the Hessian, which need a single eye position. places: number of eye positions
    of a record.
    """

    def __init__(self, ctx: moderngl.Context, gradients: bool, places: int = 1) -> None:
        self.ctx, self.gradients, self.places = ctx, gradients, places
        self._programs, self._targets = self.own(Workshop()), self.own(Workshop())
        for one, other in product((0, 1), (0, 1)):
            self._program("reduce_blocks", SKY_MAP=one, SKY_SHARE=other)
        for on in (0, 1):
            self._program("reduce_total", CLOSE_LIGHT=on)
            self._program("light_samples/sum", VIRTUAL=on, SEEN=0)
            self._program("light_samples/ends", VIRTUAL=on)

    def _program(self, name: str, **defines: object) -> Program:
        """Return the program of the shader shaders/gather/`name`.frag."""
        vertex = None if name == "reduce_total" else "lib/fullscreen"
        defines = {"GRADIENTS": int(self.gradients), "WIDE": WIDE, **defines}
        return self._programs.get(f"{name} {defines}", (), lambda: Program(self.ctx, f"gather/{name}", vertex, defines))

    def __call__(self, atlas: Atlas, records: Records, sky: Uniforms, radii: tuple[float, float]) -> None:
        """Write E, R, M and ∇E of the atlas's records into `records`, each at its number; R is kept within `radii`.

        sky: the uniforms of shaders/lighting/sky.glsl.
        """
        size = uneven(atlas.radiance.width // atlas.block[0]), uneven(atlas.radiance.height // atlas.block[1])
        components = (4,) * (8 if self.gradients else 2)
        target = self._targets.get(f"sums of {size}", (), lambda: Target(self.ctx, size, components))
        per_cell = atlas.cell[0] // atlas.block[0], atlas.cell[1] // atlas.block[1]
        across, down = min(atlas.count, atlas.columns), -(-atlas.count // atlas.columns)
        used = (0, 0, across * per_cell[0], down * per_cell[1])
        frames: Uniforms = {"frames": atlas.frames, "columns": atlas.columns, "places": self.places}
        common = {**frames, "blocks": per_cell}
        looks: Uniforms = {} if atlas.sky_share is None else {"sky_share": atlas.sky_share}
        self._program("reduce_blocks", SKY_MAP=sky_defines(sky)["SKY_MAP"], SKY_SHARE=int(bool(looks)))(
            target,
            scissor=used,
            radiance=atlas.radiance,
            table=atlas.table,
            rays=atlas.rays or atlas.table,
            planes=atlas.planes,
            edges=atlas.edges,
            cell=atlas.cell,
            block=atlas.block,
            **frames,
            **sky,
            **looks,
        )
        for samples in atlas.light_samples:
            self._add(samples, target, atlas, used, common)
        sums: dict[str, Any] = dict(zip(_SUMS, target.textures, strict=False))
        textures = [records.textures[name] for name in GATHERED]
        self._program("reduce_total", CLOSE_LIGHT=int(atlas.close_light is not None))(
            self._targets.get("records", textures, lambda: Target(self.ctx, records.size, textures=textures)),
            vertices=atlas.count,
            mode=moderngl.POINTS,
            **sums,
            table=records.size,
            radii=radii,
            **common,
            **(atlas.close_light or {}),
        )

    # ---- next-event estimation ---------------------------------------------------------------------------------------

    def _add(self, samples: LightSamples, target: Target, atlas: Atlas, used: Region, common: Uniforms) -> None:
        """Add the `samples` to the sums in `target`, in the rectangle `used`. common: the uniforms of all steps."""
        materials = {name: on for name, on in samples.materials.items() if on}
        known: Uniforms = {} if samples.free is None else {"seen": self._seen(atlas, samples)}
        program = self._program("light_samples/sum", VIRTUAL=int(samples.virtual), SEEN=int(bool(known)), **materials)
        step = samples.count if known else _RAYS // self._eyes * math.prod(common["blocks"])
        for first in range(0, samples.count, step):
            program(
                target,
                state=DrawState(blend="add"),
                scissor=used,
                samples=samples.count,
                span=(first, min(first + step, samples.count)),
                **common,
                **program.declared(samples.uniforms),
                **known,
            )

    @property
    def _eyes(self) -> int:
        """Number of eyes that test the visibility of each sample."""
        return 1 + EYES_BESIDE if self.gradients else 1

    def _seen(self, atlas: Atlas, samples: LightSamples) -> moderngl.Texture:
        """Return the texture `seen` of shaders/gather/light_samples/sum.frag."""
        across, rows = samples.count, atlas.count
        # one texture for each gather size and power of two of samples: the number of virtual point lights changes often
        size = uneven(1 << across.bit_length()), atlas.frames.width
        ends = self._targets.get(f"ends of {size}", (), lambda: Target(self.ctx, size, (4,)))
        program = self._program("light_samples/ends", VIRTUAL=int(samples.virtual))
        program(ends, scissor=(0, 0, across, rows), frames=atlas.frames, places=self.places, **program.declared(samples.uniforms))
        found = np.frombuffer(ends.gl.read((0, 0, across, rows), 4, dtype="f4"), "f4").reshape(rows, across, 4)
        seen = self._targets.get(f"seen of {size}", (), lambda: float_texture(self.ctx, size, 1))
        bits = self._bits(samples, found)
        seen.write(bits.astype("f4").tobytes(), viewport=(0, 0, across + 1, rows))
        return seen

    def _bits(self, samples: LightSamples, away: np.ndarray) -> np.ndarray:
        """Return (N, S + 1) int, the content of the texture `seen`: a bit for each eye of a record that sees each of S samples.

        away: (N, S, 4) samples relative to the first eye, metres; w: 0 without light.
        """
        rows, free, (count, across, _) = samples.rows, samples.free, away.shape
        assert free is not None
        eye = rows[4, :, :3]
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
