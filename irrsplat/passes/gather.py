"""The gather: what many records see at once, drawn by one instanced draw into an atlas (Jones 2010, section 3.4).

`raster` sees the whole hemisphere as a hemicube, one full face and four half ones; `plane` is the paper's single plane.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import moderngl
import numpy as np

from irrsplat.buffers import Atlas, ShadowMaps, Sites
from irrsplat.gpu.geometry import Geometry
from irrsplat.gpu.program import Program, State
from irrsplat.gpu.target import Target, float_texture, table_texture

PLANE_FIELD = 150.0  # degrees, the paper's single plane
OFFSET = 1e-4  # of the scene's diagonal: how far a record looks from above its surface, and its near plane
_ATLAS_TEXELS = 3 << 20  # texels of an atlas at most, 64 MiB with its depth
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_SUPERSAMPLES = 8  # per side of a texel, for its share of the hemisphere

# A face as rows x, y, w in the record's frame (tangent, bitangent, normal): it sees |x|, |y| <= w.
# The half faces look sideways and use the upper half of their field alone: y = 2·normal - w runs from -w to w there.
# Each one's right border is the next one's left, and each one's upper border is one of the front face's.
_T, _B, _N = np.eye(3)
_HEMICUBE = np.array([[_T, _B, _N], *([x, 2 * _N - w, w] for x, w in ((_B, _T), (-_T, _B), (-_B, -_T), (_T, -_B)))])
_HEMICUBE_CELLS = np.array([[0, 0, 2, 2], [2, 0, 2, 1], [2, 1, 2, 1], [0, 2, 2, 1], [2, 2, 2, 1]])  # x y w h, half sides
_PLANE = np.array([[_T / np.tan(np.radians(PLANE_FIELD / 2)), _B / np.tan(np.radians(PLANE_FIELD / 2)), _N]])
_PLANE_CELLS = np.array([[0, 0, 2, 2]])


def faces(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """The faces (F, 3, 3) of the gather `kind` ("raster" or "plane"), and their places (F, 4) in a cell, x y w h in half sides."""
    return (_PLANE, _PLANE_CELLS) if kind == "plane" else (_HEMICUBE, _HEMICUBE_CELLS)


def _corners(kind: str, side: int, points: int = 1) -> list[tuple[tuple[slice, slice], np.ndarray, np.ndarray]]:
    """Per face: its place in the cell (rows, columns), the inverse of its matrix, and the directions F⁻¹(x, y, 1).

    The directions (h·points + 1, w·points + 1, 3) are those of the corners of every texel, cut into points² parts.
    """
    rows, cells = faces(kind)
    out = []
    for face, (x0, y0, w, h) in zip(rows, cells * (side // 2), strict=True):
        inverse = np.linalg.inv(face)
        x, y = (2.0 * np.arange(n * points + 1) / (n * points) - 1.0 for n in (w, h))
        grid = np.stack([*np.meshgrid(x, y), np.ones((len(y), len(x)))], axis=-1)
        out.append(((slice(y0, y0 + h), slice(x0, x0 + w)), inverse, grid @ inverse.T))
    return out


def hemisphere_table(kind: str, side: int) -> np.ndarray:
    """(H, W, 4) float64: each texel's mean direction in the record's frame, unit, and the cosθ·dω that it stands for.

    With d = F⁻¹(x, y, 1), dω = det(F⁻¹)·dx·dy/|d|³; ∫ω·dω over a texel is the sum over a grid of points in it, the direction
    is its own, and its third component is the cosθ·dω.
    """
    width, height = (int(n) for n in (faces(kind)[1][:, :2] + faces(kind)[1][:, 2:]).max(0) * (side // 2))
    table = np.zeros((height, width, 4))
    for place, inverse, fine in _corners(kind, side, _SUPERSAMPLES):
        h, w = (s.stop - s.start for s in place)
        middle = 0.25 * (fine[:-1, :-1] + fine[:-1, 1:] + fine[1:, :-1] + fine[1:, 1:])
        length = np.linalg.norm(middle, axis=-1, keepdims=True)
        solid = abs(np.linalg.det(inverse)) * 4.0 / (w * h) / length**3
        mean = (solid * middle / length).reshape(h, _SUPERSAMPLES, w, _SUPERSAMPLES, 3).mean((1, 3))
        table[place][..., :3] = mean / np.linalg.norm(mean, axis=-1, keepdims=True)
        table[place][..., 3] = mean[..., 2]
    return table


def edge_table(kind: str, side: int) -> np.ndarray:
    """(H, 2W, 4) float64: at (y, 2x + j), texel (x, y)'s edge to its right (j = 0) or upper (j = 1) neighbour, seams included.

    xyz: cosθ·(e₁ × e₂) of the edge's end directions, turned towards the neighbour: as the record moves by δ, what is seen
    across the edge at distance r slides by δ/r, so that ∇E = Σ (L_b - L_a)·xyz/min(r_a, r_b) (after Krivanek et al. 2005).
    w: the neighbour, row·4096 + column; the texel itself for none, at the horizon and at the border of a single plane.
    """
    table = hemisphere_table(kind, side)
    height, width = table.shape[:2]
    number = np.arange(height * width).reshape(height, width)
    ends, owners, slots = [], [], []
    for place, _, corner in _corners(kind, side):
        unit = corner / np.linalg.norm(corner, axis=-1, keepdims=True)
        for slot, (e1, e2) in enumerate(
            (
                (unit[:-1, 1:], unit[1:, 1:]),
                (unit[1:, :-1], unit[1:, 1:]),
                (unit[:-1, :-1], unit[1:, :-1]),
                (unit[:-1, :-1], unit[:-1, 1:]),
            )
        ):
            ends.append(np.stack([e1, e2], axis=-2).reshape(-1, 2, 3))
            owners.append(number[place].ravel())
            slots.append(np.full(owners[-1].size, slot))
    both, owner, slot = np.concatenate(ends), np.concatenate(owners), np.concatenate(slots)
    # an edge's middle names it: the two texels that share it find each other there
    middle = np.round((both[:, 0] + both[:, 1]) * 1e5).astype(np.int64)
    _, name = np.unique(middle, axis=0, return_inverse=True)
    order = np.argsort(name.ravel(), kind="stable")
    name, same = name.ravel()[order], np.zeros(len(order), bool)
    same[1:] = name[1:] == name[:-1]
    partner = np.full(len(owner), -1)
    partner[order[same]] = owner[order[np.flatnonzero(same) - 1]]
    partner[order[np.flatnonzero(same) - 1]] = owner[order[same]]

    directions = table[..., :3].reshape(-1, 3)
    across = np.cross(both[:, 0], both[:, 1]) * (both[:, 0] + both[:, 1])[:, 2:] / 2.0
    ahead = directions[partner] - directions[owner]
    across *= np.sign((across * ahead).sum(-1, keepdims=True))
    place = number // width * 4096 + number % width
    out = np.zeros((height * width, 2, 4))
    out[..., 3] = place.reshape(-1, 1)
    mine = (slot < 2) & (partner >= 0)
    out[owner[mine], slot[mine]] = np.concatenate([across, place.ravel()[partner][:, None]], axis=-1)[mine]
    return out.reshape(height, 2 * width, 4)


def frames(normal: np.ndarray, number: np.ndarray, seed: int) -> np.ndarray:
    """(N, 3, 3) rows tangent, bitangent, normal of unit normals (N, 3), turned by an angle that `number` (N,) and seed decide.

    The turn trades aliasing that all records share for noise between them. The base frame is that of Duff et al. 2017,
    "Building an Orthonormal Basis, Revisited".
    """
    x, y, z = normal.T.astype(float)
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    tangent = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    bitangent = np.stack([b, sign + y * y * a, -y], axis=-1)
    angle = (2.0 * np.pi * np.modf((number + 1.0) * _GOLDEN + seed * math.sqrt(2.0))[0])[:, None]
    return np.stack(
        [
            np.cos(angle) * tangent + np.sin(angle) * bitangent,
            np.cos(angle) * bitangent - np.sin(angle) * tangent,
            normal.astype(float),
        ],
        axis=1,
    )


_FLOATS = 28  # per instance


class GatherPass:
    """Draws what records see: hemicubes or planes of `side` texels, for a scene of the given `diagonal` in metres.

    lights: light_defines of the scene. capacity: how many records one call takes at most (default: what a 64 MiB atlas holds).
    """

    _FORMAT = "4f 4f 4f 4f 3f 3f 3f 3f/i"
    _ATTRIBUTES = ("face_x", "face_y", "face_w", "face_cell", "face_eye", "face_right", "face_up", "face_ahead")

    def __init__(
        self, ctx: moderngl.Context, kind: str, side: int, diagonal: float, lights: Mapping[str, int], capacity: int | None = None
    ) -> None:
        self.ctx = ctx
        self.side = max(4, side // 4 * 4)  # so that four by four blocks fill a face
        self.kind = kind
        self.offset = OFFSET * diagonal
        self.radii = (self.offset, diagonal)  # R_k in metres: nothing is nearer than the offset, a miss is a diagonal away
        self.faces, cells = faces(kind)
        self.cells = cells * (self.side // 2)
        table = hemisphere_table(kind, self.side)
        self.cell = (table.shape[1], table.shape[0])
        self.table = table_texture(ctx, table)
        self.edges = table_texture(ctx, edge_table(kind, self.side))
        self.program = Program(ctx, "gather", defines=lights)
        limit = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
        texels = self.cell[0] * self.cell[1]
        wanted = capacity or max(1, _ATLAS_TEXELS // texels)
        self.columns = max(1, min(math.isqrt(wanted), limit // self.cell[0]))
        self.capacity = self.columns * max(1, min(wanted // self.columns, limit // self.cell[1]))
        self.target: Target | None = None
        self.frames = float_texture(ctx, (self.capacity, 4))
        self.instances = ctx.buffer(reserve=self.capacity * len(self.faces) * _FLOATS * 4, dynamic=True)

    def __call__(self, geometry: Geometry, shadows: ShadowMaps, sites: Sites, first: int, seed: int) -> Atlas:
        """What records at `sites` (at most `capacity`) see, the first of them being number `first` of the cache."""
        if self.target is None:
            rows = self.capacity // self.columns
            self.target = Target(self.ctx, (self.columns * self.cell[0], rows * self.cell[1]), (4,), depth=True)
        count = len(sites)
        frame = frames(sites.normal, first + np.arange(count), seed)
        self._write_frames(frame, sites)
        self.instances.write(self._instances(frame, sites).astype("f4").tobytes())
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
            **shadows.uniforms,
        )
        block = (self.side // 4, self.side // 4)
        return Atlas(self.target.textures[0], self.table, self.edges, self.frames, count, self.columns, self.cell, block)

    def _write_frames(self, frame: np.ndarray, sites: Sites) -> None:
        rows = np.zeros((4, len(sites), 4), "f4")
        rows[:3, :, :3] = frame.swapaxes(0, 1)
        rows[3, :, :3] = np.einsum("nij,nj->ni", frame, sites.geometric)
        self.frames.write(rows.tobytes(), viewport=(0, 0, len(sites), 4))

    def _instances(self, frame: np.ndarray, sites: Sites) -> np.ndarray:
        """(N·F, 28): face_x, face_y, face_w with their translation, face_cell, face_eye, face_right, face_up and face_ahead."""
        count = len(sites)
        eye = sites.position.astype(float) + self.offset * sites.geometric
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
