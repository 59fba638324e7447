"""A scene's surfaces cut into small triangular cells, so that a value at their corners can be looked up anywhere on them.

A triangle's edges are cut into n equal steps, and the triangle into n² cells like it. So a large wall has many cells, and a small
triangle is one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from irrsplat.core.vectors import triangle_normals
from irrsplat.core.vertex_layout import vertex_column

_MAX_CELLS = 1 << 17  # beyond one for every triangle
_SMALL = 0.2  # of the spacing: a triangle whose edges are shorter has one point for all of its corners


@dataclass(frozen=True)
class Tessellation:
    """The cells of F triangles.

    table: (F, 2) float32 for the shader: a triangle's number of steps n along an edge, and the number of its first cell.
    corners: (C, 3) numbers of the points that are a cell's corners, in the order of its weights in
    shaders/surface_cache/lookup.glsl. No two cells share a point; a very small cell has one point for all three corners.
    position: (P, 3) of the points, moved by `inset` metres into their cells, so that a point on the edge of a wall sees the wall.
    normal: (P, 3) shading normals and geometric: (P, 3) those of the triangles, unit, both on the side that the winding tells.
    face: (P,) the triangles' numbers. area: (P,) m², the share of its cell that each stands for.
    """

    table: np.ndarray
    corners: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    geometric: np.ndarray
    face: np.ndarray
    area: np.ndarray

    @property
    def cells(self) -> int:
        """The number of cells."""
        return len(self.corners)

    @property
    def alone(self) -> np.ndarray:
        """The numbers of the points that are all three corners of their cell."""
        corners: np.ndarray = self.corners[self.corners[:, 0] == self.corners[:, 1], 0]
        return corners


def tessellate(vertices: np.ndarray, faces: np.ndarray, spacing: float | np.ndarray, inset: float) -> Tessellation:
    """The tessellation whose steps are at most `spacing` metres long, one number or (F,), or longer where that would make more
    than _MAX_CELLS cells.

    vertices: (V, WIDTH), rows as core/vertex_layout.py has them; faces: (F, 3), as scene.flatten.flatten gives them.
    """
    p, normals = (vertex_column(vertices, name)[faces].astype(float) for name in ("position", "normal"))
    edges = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    lengths = (np.einsum("fx,fx->f", e, e) for e in (*edges, edges[1] - edges[0]))
    longest = np.sqrt(reduce(np.maximum, lengths))
    n = steps(longest, spacing)
    first = np.cumsum(n * n) - n * n
    table = np.stack([n, first], axis=1).astype(np.float32)

    unit, size = triangle_normals(p)
    geometric = np.ascontiguousarray(unit.T)
    face = np.repeat(np.arange(len(faces)), n * n)
    tiny = longest <= _SMALL * spacing
    small = tiny[face]
    ends = np.cumsum(np.where(small, 1, 3))  # where each cell's points end
    corners = ends[:, None] - np.where(small[:, None], 1, [3, 2, 1])
    count = int(ends[-1]) if len(ends) else 0
    position, shading, facing = np.empty((3, count, 3), np.float32)
    made = Tessellation(table, corners, position, shading, facing, np.empty(count, np.intp), np.empty(count))
    _place_small(made, p, normals, np.flatnonzero(tiny), corners[small, 0], (geometric, size))
    cells = np.flatnonzero(~small)
    of, at = face[cells], corners[cells]
    i, j = _corners(cells - first[of], n[of])
    u, v = i / n[of][:, None], j / n[of][:, None]  # of the edges, (C, 3)
    place = p[of, None, 0] + u[..., None] * edges[0][of, None] + v[..., None] * edges[1][of, None]
    inward = place.mean(1, keepdims=True) - place
    length = np.linalg.norm(inward, axis=-1, keepdims=True)
    position[at] = place + inward * np.minimum(inset / np.maximum(length, 1e-300), 0.5)
    normal = np.einsum("ckj,cjx->ckx", np.stack([1.0 - u - v, u, v], axis=-1), normals[of])
    normal *= np.sign((normal * geometric[of, None]).sum(-1, keepdims=True))
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    shading[at] = np.where(length > 0.0, normal / np.maximum(length, 1e-300), geometric[of, None])
    facing[at], made.face[at] = geometric[of, None], of[:, None]
    made.area[at] = 1.0 / 3.0 * (size / (n * n))[of, None]
    return made


def _place_small(
    made: Tessellation,
    p: np.ndarray,
    normals: np.ndarray,
    faces: np.ndarray,
    at: np.ndarray,
    plane: tuple[np.ndarray, np.ndarray],
) -> None:
    """Fill in the points `at` (N,) of very small `faces` (N,), one each, which are most of a fine mesh.

    p, normals: (F, 3, 3) of all triangles' corners. plane: (F, 3) their unit normals and (F,) their areas.
    """
    facing, area = plane[0][faces], plane[1][faces]
    place, normal = (np.take(of[:, 0] + of[:, 1] + of[:, 2], faces, axis=0) / 3.0 for of in (p, normals))
    made.position[at] = place
    length = np.sqrt(np.einsum("nx,nx->n", normal, normal))
    length *= np.sign(np.einsum("nx,nx->n", normal, facing))
    known = length != 0.0
    made.normal[at] = np.where(known[:, None], normal / np.where(known, length, 1.0)[:, None], facing)
    made.geometric[at], made.face[at], made.area[at] = facing, faces, area


def steps(longest: np.ndarray, spacing: float | np.ndarray) -> np.ndarray:
    """(F,) the steps n of triangles by their longest edges (F,) in metres."""
    while True:
        n = np.maximum(np.ceil(np.minimum(longest / spacing - 1e-6, 1e6)), 1.0).astype(np.intp)
        if (n * n).sum() <= len(n) + _MAX_CELLS:
            return n
        spacing = 1.25 * spacing


def _corners(cell: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(C, 3) each, steps along the two edges from a triangle's first corner to the corners of its cells, numbered row by row.

    Row j has 2(n - j) - 1 cells, and n² - (n - j)² are before it. The even ones of a row have (i, j) as a corner and lie as the
    triangle does; the odd ones are turned by 180°, between (i + 1, j + 1) and its neighbours.
    """
    j = (n - np.ceil(np.sqrt(n * n - cell))).astype(np.intp)  # squares are exact
    i, odd = np.divmod(cell - j * (2 * n - j), 2)
    return (
        np.stack([i + odd, i + 1 - odd, i + odd], axis=1),
        np.stack([j + odd, j + odd, j + 1 - odd], axis=1),
    )
