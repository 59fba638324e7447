"""The paper's gather: each record draws one plane of 150° into its cell of an atlas (Jones 2010, section 3.4)."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from irrsplat.core.buffers import Atlas, HitLight, Sites
from irrsplat.core.glsl import NEIGHBOUR_STRIDE
from irrsplat.gather.hemisphere import Gather
from irrsplat.gather.record_frame import OFFSET, atlas_grid
from irrsplat.gpu.program import DrawState, Program
from irrsplat.gpu.target import Target
from irrsplat.gpu.world import World
from irrsplat.lighting.light_table import light_defines

FIELD = 150.0  # degrees, the field of view of the paper's plane
_EXTENT = float(np.tan(np.radians(FIELD / 2.0)))  # of the plane at distance 1, from its middle
_SUPERSAMPLES = 8  # points along a texel's side by which its share of the hemisphere is integrated


class PlaneGather(Gather):
    """A draw of the world's triangles in the planes of many records, of `side` texels each, without next-event estimation.

    capacity: records in one call at most (default: a 32 MiB atlas). surface: True if the light of a call includes a
    surface cache.
    """

    kind = "plane"

    def __init__(self, world: World, side: int, capacity: int | None = None, *, surface: bool = False) -> None:
        side, ctx = max(4, side // 4 * 4), world.ctx  # so that four by four blocks fill a cell
        columns, capacity = atlas_grid((side, side), capacity, int(ctx.info["GL_MAX_TEXTURE_SIZE"]))
        super().__init__(world, plane_table(side), capacity)
        defines = {**light_defines(world.scene), **world.material_defines, "SURFACE": int(surface)}
        self.program = self.own(Program(ctx, "gather/plane", defines=defines))
        self.target = self.own(Target(ctx, (columns * side, capacity // columns * side), (4, 4), depth=True))
        self.atlas = self._empty_atlas(self.target, columns, plane_edges(side))

    @property
    def offset(self) -> float:
        """Height of a record's eye above its surface, metres; a nearer near plane would cost depth precision."""
        return OFFSET[0] * self.world.scene.diagonal

    def __call__(self, light: HitLight, sites: Sites, numbers: np.ndarray, seed: int) -> Atlas:
        atlas, count = self.atlas, len(sites)
        rows = self._frame_rows(sites, numbers, seed, np.full(count, self.offset))
        atlas.frames.write(rows.tobytes(), viewport=(0, 0, count, 5))
        used = (0, 0, self.target.size[0], -(-count // atlas.columns) * atlas.cell[1])
        self.target.use(scissor=used)
        self.target.gl.clear(viewport=used)
        self.program(
            self.target,
            geometry=self.world.geometry,
            part="lit",
            instances=count,
            state=DrawState(depth="<", depth_clamp=True, clip_planes=5),
            frames=atlas.frames,
            columns=atlas.columns,
            side=float(atlas.cell[0]),
            extent=_EXTENT,
            atlas=self.target.size,
            near=self.offset,
            **(self.world.gather_uniforms | light.uniforms),
        )
        return replace(atlas, count=count)


def _directions(points: int) -> np.ndarray:
    """Return (points + 1, points + 1, 3), the directions of a grid's corners on the plane, with a normal part of 1."""
    steps = _EXTENT * (2.0 * np.arange(points + 1) / points - 1.0)
    return np.stack([*np.meshgrid(steps, steps), np.ones((points + 1, points + 1))], axis=-1)


@lru_cache(maxsize=8)
def plane_table(side: int) -> np.ndarray:
    """Return (side, side, 4) float64, each texel's mean direction in the record's frame, unit, and its cosθ·dω. Read only.

    With d = (x, y, 1), dω = dx·dy/|d|³. A grid of points sums ∫ω·dω over a texel: its direction is the texel's, and its
    component along the normal is the cosθ·dω.
    """
    fine = _directions(side * _SUPERSAMPLES)
    middle = 0.25 * (fine[:-1, :-1] + fine[:-1, 1:] + fine[1:, :-1] + fine[1:, 1:])
    solid = (2.0 * _EXTENT / side) ** 2 * middle / np.linalg.norm(middle, axis=-1, keepdims=True) ** 4
    mean = solid.reshape(side, _SUPERSAMPLES, side, _SUPERSAMPLES, 3).mean((1, 3))
    return np.concatenate([mean / np.linalg.norm(mean, axis=-1, keepdims=True), mean[..., 2:]], axis=-1)


@lru_cache(maxsize=8)
def plane_edges(side: int) -> np.ndarray:
    """Return (side, 2·side, 4) float64: at (y, 2x + j), texel (x, y)'s edge to its right (j = 0) or upper (j = 1) neighbour.

    xyz: cosθ·(e₁ × e₂) of the directions of the edge's ends, pointing towards the neighbour: as the record moves by δ, what is
    seen across the edge at distance r slides by δ/r, so that ∇E = Σ (L_b - L_a)·xyz/min(r_a, r_b) (after Krivanek et al. 2005).
    w: the neighbour, row·NEIGHBOUR_STRIDE + column; the texel itself at the plane's border, where there is none.
    """
    unit = _directions(side)
    unit /= np.linalg.norm(unit, axis=-1, keepdims=True)
    y, x = np.indices((side, side))
    number = NEIGHBOUR_STRIDE * y + x
    out = np.zeros((side, side, 2, 4))
    out[..., 3] = number[..., None]
    for j, (a, b) in enumerate(((unit[1:, 1:], unit[:-1, 1:]), (unit[1:, :-1], unit[1:, 1:]))):
        inner = (slice(None), slice(-1), j) if j == 0 else (slice(-1), slice(None), j)
        across = np.cross(a, b) * (a + b)[..., 2:] / 2.0
        out[inner] = np.concatenate([across, (number + (1, NEIGHBOUR_STRIDE)[j])[..., None]], axis=-1)[inner[:2]]
    return out.reshape(side, 2 * side, 4)
