"""The hemisphere that a record sees, cut into texels: the faces, what each texel stands for, and the edges between texels.

A "raster" gather sees all of it by a hemicube, one full face and four half ones; a "plane" gather by the paper's single plane.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from irrsplat.core.glsl import NEIGHBOUR_STRIDE

PLANE_FIELD = 150.0  # degrees, the paper's single plane
_SUPERSAMPLES = 8  # points along a texel's side by which its share of the hemisphere is integrated

# A face as rows x, y, w in the record's frame (tangent, bitangent, normal): it sees the directions with |x|, |y| <= w.
# The half faces look sideways and use only the upper half of their field: y = 2·normal - w runs from -w to w there.
# The right border of each is the left one of the next, and the upper border of each is a border of the front face.
_T, _B, _N = np.eye(3)
_HEMICUBE = np.array([[_T, _B, _N], *([x, 2 * _N - w, w] for x, w in ((_B, _T), (-_T, _B), (-_B, -_T), (_T, -_B)))])
_HEMICUBE_CELLS = np.array([[0, 0, 2, 2], [2, 0, 2, 1], [2, 1, 2, 1], [0, 2, 2, 1], [2, 2, 2, 1]])  # x y w h, half sides
_PLANE = np.array([[_T / np.tan(np.radians(PLANE_FIELD / 2)), _B / np.tan(np.radians(PLANE_FIELD / 2)), _N]])
_PLANE_CELLS = np.array([[0, 0, 2, 2]])


def faces(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """The faces (F, 3, 3) of the gather `kind`, "raster" or "plane", and their rectangles (F, 4) in a cell, x y w h in half
    sides."""
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


@lru_cache(maxsize=8)
def hemisphere_table(kind: str, side: int) -> np.ndarray:
    """(H, W, 4) float64: each texel's mean direction in the record's frame, unit, and the cosθ·dω that it stands for.

    With d = F⁻¹(x, y, 1), dω = det(F⁻¹)·dx·dy/|d|³; ∫ω·dω over a texel is summed over a grid of points in it: its direction
    is the texel's, and its component along the normal is the cosθ·dω. Nobody may write to it: it is kept.
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


@lru_cache(maxsize=8)
def edge_table(kind: str, side: int) -> np.ndarray:
    """(H, 2W, 4) float64: at (y, 2x + j), texel (x, y)'s edge to its right (j = 0) or upper (j = 1) neighbour, seams included.

    xyz: cosθ·(e₁ × e₂) of the directions of the edge's ends, pointing towards the neighbour: as the record moves by δ, what is
    seen across the edge at distance r slides by δ/r, so that ∇E = Σ (L_b - L_a)·xyz/min(r_a, r_b) (after Krivanek et al. 2005).
    w: the neighbour, row·NEIGHBOUR_STRIDE + column; the texel itself where there is none, at the horizon and at the border of
    a single plane.
    """
    table = hemisphere_table(kind, side)
    height, width = table.shape[:2]
    number = np.arange(height * width).reshape(height, width)
    ends: list[np.ndarray] = []
    owners: list[np.ndarray] = []
    slots: list[np.ndarray] = []
    for place, _, corner in _corners(kind, side):
        unit = corner / np.linalg.norm(corner, axis=-1, keepdims=True)
        a, b, c, d = unit[:-1, :-1], unit[:-1, 1:], unit[1:, :-1], unit[1:, 1:]
        for j, edge in enumerate(((b, d), (c, d), (a, c), (a, b))):  # right, upper, left, lower
            ends.append(np.stack(edge, axis=-2).reshape(-1, 2, 3))
            owners.append(number[place].ravel())
            slots.append(np.full(owners[-1].size, j))
    both, owner, slot = np.concatenate(ends), np.concatenate(owners), np.concatenate(slots)
    # an edge is identified by its middle, by which the two texels that share it find each other
    middle = np.round((both[:, 0] + both[:, 1]) * 1e5).astype(np.int64)
    _, name = np.unique(middle, axis=0, return_inverse=True)
    order = np.argsort(name.ravel(), kind="stable")
    name, same = name.ravel()[order], np.zeros(len(order), bool)
    same[1:] = name[1:] == name[:-1]
    twin = np.full(len(owner), -1)  # the same edge, seen from its other side
    twin[order[same]] = order[np.flatnonzero(same) - 1]
    twin[order[np.flatnonzero(same) - 1]] = order[same]
    partner = owner[twin]

    directions = table[..., :3].reshape(-1, 3)
    across = np.cross(both[:, 0], both[:, 1]) * (both[:, 0] + both[:, 1])[:, 2:] / 2.0
    ahead = directions[partner] - directions[owner]
    across *= np.sign((across * ahead).sum(-1, keepdims=True))
    packed = (number // width * NEIGHBOUR_STRIDE + number % width).ravel()
    out = np.zeros((height * width, 2, 4))
    out[..., 3] = packed[:, None]
    # right and upper edges suffice; a seam that is a right or upper edge of both texels is stored with one of them
    mine = (twin >= 0) & (slot < 2) & ((slot[twin] >= 2) | (owner < partner))
    out[owner[mine], slot[mine]] = np.concatenate([across, packed[partner][:, None]], axis=-1)[mine]
    return out.reshape(height, 2 * width, 4)
