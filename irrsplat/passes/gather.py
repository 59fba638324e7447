"""The gather: what many records see at once, drawn by one instanced draw into an atlas (Jones 2010, section 3.4)."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from irrsplat.buffers import Atlas, HitLight, ShadowMaps, Sites
from irrsplat.gpu.geometry import Geometry
from irrsplat.gpu.holder import Holder
from irrsplat.gpu.program import Program, State
from irrsplat.gpu.target import Target, float_texture, table_texture
from irrsplat.hemisphere import edge_table, faces, frames, hemisphere_table
from irrsplat.vantage import OFFSET, atlas_grid, eyes, frame_rows

_FLOATS = 28  # per instance


class GatherPass(Holder):
    """Draws what records see: hemicubes or planes of `side` texels, for a scene of the given `diagonal` in metres.

    lights: light_defines of the scene. capacity: how many records one call takes at most (default: what a 96 MiB atlas holds).
    surface: the light that it is called with has a surface cache, too.
    """

    _FORMAT = "4f 4f 4f 4f 3f 3f 3f 3f/i"
    _ATTRIBUTES = ("face_x", "face_y", "face_w", "face_cell", "face_eye", "face_right", "face_up", "face_ahead")

    def __init__(
        self,
        ctx: moderngl.Context,
        kind: str,
        side: int,
        diagonal: float,
        lights: Mapping[str, int],
        capacity: int | None = None,
        *,
        surface: bool = False,
    ) -> None:
        self.ctx = ctx
        self.side = max(4, side // 4 * 4)  # so that four by four blocks fill a face
        self.kind = kind
        self.fit(diagonal)
        self.faces, cells = faces(kind)
        self.cells = cells * (self.side // 2)
        table = hemisphere_table(kind, self.side)
        self.cell = (table.shape[1], table.shape[0])
        self.share = table[..., 3]  # cosθ·dω of every texel of a cell
        self.table = table_texture(ctx, table)
        self.edges = table_texture(ctx, edge_table(kind, self.side))
        self.program = Program(ctx, "gather", defines={**lights, "SURFACE": int(surface)})
        self.columns, self.capacity = atlas_grid(self.cell, capacity, int(ctx.info["GL_MAX_TEXTURE_SIZE"]))
        self.target: Target | None = None
        self.frames = float_texture(ctx, (self.capacity, 4))
        self.instances = ctx.buffer(reserve=self.capacity * len(self.faces) * _FLOATS * 4, dynamic=True)

    def fit(self, diagonal: float) -> None:
        """The scene's diagonal is of so many metres from now on."""
        self.offset = OFFSET * diagonal
        self.radii = (self.offset, diagonal)  # R_k in metres: nothing is nearer than the offset, a miss is a diagonal away

    def __call__(self, geometry: Geometry, light: ShadowMaps | HitLight, sites: Sites, numbers: np.ndarray, seed: int) -> Atlas:
        """What records at `sites` (at most `capacity`) see; `numbers` (N,) are theirs in the cache."""
        if self.target is None:
            rows = self.capacity // self.columns
            self.target = Target(self.ctx, (self.columns * self.cell[0], rows * self.cell[1]), (4, 4), depth=True)
        count = len(sites)
        frame = frames(sites.normal, numbers if sites.turn is None else sites.turn, seed)
        self.frames.write(frame_rows(frame, sites, numbers).tobytes(), viewport=(0, 0, count, 4))
        eye = eyes(sites, geometry.corners, self.offset)
        self.instances.write(self._instances(frame, eye).astype("f4").tobytes())
        used = (0, 0, self.target.size[0], -(-count // self.columns) * self.cell[1])
        self.target.use(scissor=used)
        self.target.gl.clear(viewport=used)
        self.program(
            self.target,
            geometry=geometry,
            instances=count * len(self.faces),
            instance_data=(self.instances, self._FORMAT, self._ATTRIBUTES),
            state=State(depth="<", clamp=True, clips=5),
            near=self.offset,
            atlas=self.target.size,
            **geometry.uniforms,
            **light.uniforms,
        )
        block = (self.side // 4, self.side // 4)
        radiance, planes = self.target.textures
        return Atlas(radiance, planes, self.table, self.edges, self.frames, count, self.columns, self.cell, block)

    def _instances(self, frame: np.ndarray, eye: np.ndarray) -> np.ndarray:
        """(N·F, 28): face_x, face_y, face_w with their translation, face_cell, face_eye, face_right, face_up and face_ahead."""
        count = len(eye)
        rows = np.einsum("fij,njk->nfik", self.faces, frame)
        moved = -np.einsum("nfik,nk->nfi", rows, eye)
        corner = np.stack([np.arange(count) % self.columns, np.arange(count) // self.columns], axis=-1) * self.cell
        half = self.cells[:, 2:] / 2.0
        cell = np.concatenate(np.broadcast_arrays(corner[:, None, :] + self.cells[:, :2] + half, half), axis=-1)
        # the direction of (x, y) is F⁻¹(x, y, 1), F = face·frame; x and y advance by 1/half a texel
        ways = np.einsum("fij,nik->nfjk", np.linalg.inv(self.faces), frame) / np.insert(half, 2, 1.0, axis=1)[:, :, None]
        parts = (
            np.concatenate([rows, moved[..., None]], axis=-1),
            cell,
            np.broadcast_to(eye[:, None, :], (count, len(self.faces), 3)),
            ways,
        )
        return np.concatenate([p.reshape(count * len(self.faces), -1) for p in parts], axis=-1)
