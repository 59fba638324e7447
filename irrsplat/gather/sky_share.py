"""Visible share of the sky in each stratum (docs/METHOD.md, 3.4): visibility rays estimate it if neighbouring strata differ.

Otherwise, the ray of a stratum represents the whole stratum. Few rays of a record pass through a window, so that their number
is noisy. The sky's radiance depends only on the direction, so that visibility rays need no light at their hits.
"""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.core.buffers import Atlas, Uniforms
from irrsplat.gather.stratified import closer_rays, reach
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import Region, Target, table_texture
from irrsplat.gpu.world import World

_RAYS = 8  # of a stratum
_NEAR = 2  # elevations and azimuths to either side, at least, that count as neighbours of a stratum
_ACROSS = 8  # rows and columns of strata, spread over a record's cell, that measure the openness of the place
_OPEN = 0.125  # share of these: above it, a record's own rays estimate the sky well enough


class SkyShares(Owner):
    """Computation of the visible shares of the sky for a gather of `side`² rays per record into `atlas`.

    embree: True if Embree traces the visibility rays, False if shaders do.
    """

    def __init__(self, world: World, side: int, atlas: Atlas, embree: bool) -> None:
        self.world, self.atlas = world, atlas
        n, m = atlas.cell
        self._rays, self._reach = closer_rays(side, _RAYS), reach(side, _NEAR)
        self._step = max(1, n // _ACROSS), max(1, m // _ACROSS)
        self._target: Target | None = None
        self._table: moderngl.Texture | None = None
        self._program: Program | None = None
        if not embree:
            wide = np.broadcast_to(self._reach[:, None, None], (m, n * _RAYS, 1))
            self._table = self.own(table_texture(world.ctx, np.concatenate([self._rays.reshape(m, -1, 3), wide], axis=-1)))
            defines = {**world.material_defines, "RAYS": _RAYS, "NEAR": _NEAR}
            self._program = self.own(Program(world.ctx, "gather/sky_share", "lib/fullscreen", defines))

    def __call__(self, rows: np.ndarray, hits: np.ndarray | None, areas: tuple[Region, ...]) -> moderngl.Texture | None:
        """Return the texture of shares, Atlas.sky_share, for an atlas that is used in these `areas`; None for a black sky.

        rows: (5, N, 4) of Atlas.frames. hits: (N, R) the triangles hit by Embree's rays, -1: none; None without Embree.
        """
        scene, atlas = self.world.scene, self.atlas
        if not (any(scene.sky) or any(scene.sky_gradient) or scene.environment):
            return None
        if self._target is None:
            self._target = self.own(Target(self.world.ctx, atlas.radiance.size, (1,)))
        if self._program is None:
            assert hits is not None
            self._write(self._target.textures[0], self._counted(rows, (hits < 0).reshape(len(hits), *atlas.cell[::-1])))
        else:
            given: Uniforms = {
                "radiance": atlas.radiance,
                "frames": atlas.frames,
                "closer_rays": self._table,
                "cell": atlas.cell,
                "step": self._step,
            }
            given |= {"columns": atlas.columns, "most": _OPEN, **self.world.ray_uniforms}
            for area in areas:
                self._program(self._target, scissor=area, **self._program.declared(given))
        return self._target.textures[0]

    def _write(self, texture: moderngl.Texture, shares: np.ndarray) -> None:
        """Write the shares (N, M, A) of N records into cells of the texture."""
        (n, m), columns = self.atlas.cell, self.atlas.columns
        lines = -(-len(shares) // columns)
        cells = np.zeros((lines * columns, m, n), np.float32)
        cells[: len(shares)] = shares
        picture = cells.reshape(lines, columns, m, n).swapaxes(1, 2)
        texture.write(picture.tobytes(), viewport=(0, 0, columns * n, lines * m))

    def _counted(self, rows: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Return (N, M, A) the shares by Embree, for records with rays that meet the sky where `free` (N, M, A) is True."""
        shares, (across, up) = free.astype(np.float32), self._step
        few = np.flatnonzero(free.any((1, 2)) & (free[:, ::up, ::across].mean((1, 2)) <= _OPEN))
        some, stratum = np.divmod(np.flatnonzero(self._mixed(free[few])), free[0].size)
        record = few[some]
        frames, eyes = rows[:3, :, :3].swapaxes(0, 1), rows[4, :, :3]
        eye = eyes.take(np.repeat(record, _RAYS), axis=0)  # copies rows faster than an index does
        rays = self._rays.reshape(-1, _RAYS, 3).astype(np.float32)
        away = (rays.take(stratum, axis=0) @ frames.take(record, axis=0)).reshape(-1, 3)
        seen = self.world.caster.free(eye, eye + away * np.float32(2.0 * self.world.scene.diagonal))  # beyond the scene
        shares.reshape(len(shares), -1)[record, stratum] = seen.reshape(-1, _RAYS).mean(1)
        return shares

    def _mixed(self, free: np.ndarray) -> np.ndarray:
        """Return (N, M, A) True where some but not all neighbouring strata meet the sky; to avoid bias, without the stratum."""
        widest, n = int(self._reach.max()), free.shape[2]
        ring = np.concatenate([free[..., n - widest :], free, free[..., :widest]], axis=-1)
        before = np.pad(np.cumsum(ring, axis=-1, dtype=np.int16), ((0, 0), (0, 0), (1, 0)))
        middle, wide = widest + np.arange(n), self._reach[:, None]
        row = np.arange(len(wide))[:, None]
        rows = before[:, row, middle + wide + 1] - before[:, row, middle - wide], 2 * wide[None] + 1
        padded = (np.pad(of, ((0, 0), (_NEAR, _NEAR), (0, 0))) for of in rows)
        sees, strata = (sum(of[:, k : k + len(wide)] for k in range(2 * _NEAR + 1)) for of in padded)
        return np.asarray((sees > free) & (sees - free < strata - 1))
