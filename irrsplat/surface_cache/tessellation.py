"""Tessellation of a scene's surfaces into small triangular cells, for interpolation between values at their corners.

The edges of a triangle are cut into n equal steps, and the triangle into n² cells of its shape. A large wall therefore has many
cells, and a small triangle has one. Light is steep close to lights: a triangle near a light is first cut into parts, and each
part into cells. A sliver is cut into strips across its long edges, because its n² cells would be far longer than wide.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from irrsplat.core.vectors import squares_from_boxes, triangle_areas, triangle_normals
from irrsplat.core.vertex_layout import vertex_column

_MAX_CELLS = 1 << 17  # beyond one for every triangle
_SMALL = 0.2  # of the spacing: a triangle whose edges are shorter has one point for all of its corners
_SLIVER = 16  # least number of strips of a sliver, each as wide as the spacing or the sliver's shortest edge, the longer one
_FINEST = 4  # greatest number of times that steps close to lights are halved
_ROOMS = 3.0  # of the size of surroundings: distance up to which area counts in full; beyond, steps grow by its square
_SHORTER = 4.0  # times as short: steps around an eye for which sites are chosen again
_LEAST_COUNT = 1e-6  # of a triangle's area; around places that lie in a surface, all triangles have it
_MAX_PIECES = 32  # parts along an edge of a triangle that extends beyond the surroundings, at most


@dataclass(frozen=True)
class Grading:
    """Lengths of steps by their place: the spacing in the surroundings of lights and cameras, longer beyond.

    places: (N, 3) metres, of cameras and then of lights. rooms: (N,) metres, the extents of their surroundings. eyes: the number
    of cameras, around which parts of a triangle have steps of their own.
    """

    places: np.ndarray
    rooms: np.ndarray
    eyes: int = 1

    def factors(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the factors (F,) on the steps of triangles `p` (F, 3, 3), and the number of parts (F,) along their edges.

        A triangle with longer steps has parts if it is longer than half of the reach of a camera, and than its distance.
        """
        area = triangle_areas(p)
        counts, pieces = np.zeros(len(p)), np.ones(len(p))
        columns = np.ascontiguousarray(p.transpose(1, 2, 0))  # of the first, the second and the third corners
        low, high = (reduce(extreme, columns) for extreme in (np.minimum, np.maximum))
        reaches = (_ROOMS * self.rooms).astype(np.float32)
        for number, (place, reach) in enumerate(zip(self.places.astype(np.float32), reaches, strict=True)):
            away, full = squares_from_boxes(low, high, place), 0.25 * reach**2
            counts += np.minimum(area, full) * np.minimum(reach**2 / np.maximum(away, 1e-30), 1.0) ** 2
            large = np.flatnonzero(area > full) if number < self.eyes and reach > 0.0 else np.zeros(0, np.intp)
            parts = _edges(p[large]).max(0) / np.maximum(np.sqrt(away[large]), 0.5 * reach)
            pieces[large] = np.maximum(pieces[large], parts)
        counts = np.clip(counts, _LEAST_COUNT * area, area) if len(self.places) else area
        wider = np.sqrt(np.maximum(area, 1e-300) / np.maximum(counts, 1e-300))
        pieces = np.where(wider < 2.0, 1.0, np.minimum(pieces, _MAX_PIECES))
        pieces *= min(1.0, np.sqrt(_MAX_CELLS / 4 / max(float((pieces[pieces > 1.0] ** 2).sum()), 1.0)))
        return wider, np.maximum(pieces, 1.0).astype(np.intp)

    def of_parts(self, p: np.ndarray) -> np.ndarray:
        """Return the factors (P,) on the steps of parts `p` (P, 3, 3) of triangles."""
        return Grading(self.places[: self.eyes], self.rooms[: self.eyes]).factors(p)[0]

    def suits(self, eye: np.ndarray, room: float, diagonal: float) -> bool:
        """True if a grading for `eye` (3,) would not shorten the steps there to a quarter. room: metres, of its surroundings.

        The spacing of a grading is about proportional to the surroundings of its first place, as far as they are in the scene.
        diagonal: of the scene, metres.
        """
        away = ((self.places - eye) ** 2).sum(1)
        density = np.minimum((_ROOMS * self.rooms) ** 2 / np.maximum(away, 1e-30), 1.0) ** 2
        steps = min(self.rooms[0] if self.eyes else np.inf, diagonal / _ROOMS)
        return bool(_SHORTER * room * np.sqrt(min(float(density.sum()), 1.0)) >= steps)

    def graded(self, p: np.ndarray) -> tuple[Graded, float]:
        """Return the steps of triangles `p` (F, 3, 3), and their area by the density of their cells, m²."""
        wider, pieces = self.factors(p)
        uneven = pieces > 1
        parts = _parts(p[uneven], pieces[uneven], np.full(uneven.sum(), -1), pieces[uneven] ** 2)
        cells = (p[~uneven], wider[~uneven]), (parts, self.of_parts(parts))
        counts = [triangle_areas(of) / factor**2 for of, factor in cells]
        return Graded(self, wider, pieces), float(np.concatenate(counts).sum())


@dataclass(frozen=True)
class Graded:
    """Steps of F triangles. wider: (F,) factors on the spacing. pieces: (F,) parts along an edge; `grading` has their steps."""

    grading: Grading
    wider: np.ndarray
    pieces: np.ndarray

    def __getitem__(self, some: np.ndarray) -> Graded:
        """Return the steps of a selection of the triangles."""
        return Graded(self.grading, self.wider[some], self.pieces[some])


@dataclass(frozen=True)
class Tessellation:
    """The cells of F triangles.

    table: (T, 2) float32 for the shader: the number n of steps along an edge of a triangle, and the number of its first cell. A
    triangle of parts has -n, or -n - (k + 1)/4 if n strips cross the edges at its corner k, and the row of its first part. The
    rows of all parts follow those of the F triangles. corners: (C, 3) numbers of the points at a cell's corners, in the order
    of the weights in shaders/surface_cache/lookup.glsl. Cells of a triangle share points; a very small triangle has one point
    for all three corners. position: (P, 3) of the points, moved by up to `inset` metres into their triangle, so that the wall
    is visible from a point on its edge. normal, geometric: (P, 3) unit shading normals and unit normals of the triangles, on
    the front by the winding. face: (P,) numbers of the triangles. area: (P,) a third of the cells at each point, m². level:
    (P,) number of times that the steps around each point are halved. wider: (P,) factors on the spacing before that.
    """

    table: np.ndarray
    corners: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    geometric: np.ndarray
    face: np.ndarray
    area: np.ndarray
    level: np.ndarray
    wider: np.ndarray


def tessellate(
    vertices: np.ndarray,
    faces: np.ndarray,
    spacing: float,
    inset: float,
    lights: np.ndarray | None = None,
    lit: np.ndarray | bool = True,
    graded: Graded | None = None,
) -> Tessellation:
    """Return the tessellation with steps of at most `spacing` metres, or longer beyond _MAX_CELLS cells.

    vertices: (V, WIDTH), rows of core/vertex_layout.py; faces: (F, 3), see `flatten`. lights: (K, 4) places and sizes
    in metres of lights. A step near one is at most as long as the distance and the size together. lit: (F,) False for triangles
    whose steps do not depend on lights. graded: longer steps of triangles.
    """
    p, normals = (vertex_column(vertices, name)[faces] for name in ("position", "normal"))
    graded = graded or Graded(Grading(np.zeros((0, 3)), np.zeros(0)), np.ones(len(p)), np.ones(len(p), np.intp))
    uneven, step = graded.pieces > 1, spacing * graded.wider
    edges = _edges(p)
    longest = edges.max(0)
    width = np.maximum(np.maximum(edges.min(0), step), 1e-30)
    strips = steps(longest, width, strips=True)
    sliver, wide = strips >= _SLIVER, longest > 1.001 * strips * width  # wide: where there would be too many strips
    n = np.where(uneven, graded.pieces, steps(np.where(sliver, 0.0, longest), step))
    near = np.zeros(len(p), bool)
    close = np.flatnonzero(lit & (longest > _SMALL * step))
    near[close] = _halvings(p[close], step[close], lights) > 0
    cut = np.flatnonzero(near | sliver | uneven)
    apex = np.where(sliver[cut], (edges[:, cut].argmin(0) + 2) % 3, -1)
    along = np.where(apex < 0, n[cut], strips[cut])
    parts = np.where(apex < 0, along**2, 2 * along - 1)
    row = np.concatenate([np.arange(len(p)), np.repeat(cut, parts)])  # the triangle of each row of the table
    table = np.zeros((len(row), 2), np.float32)
    table[cut] = np.stack([-along - 0.25 * (apex + 1), len(p) + np.cumsum(parts) - parts], axis=1)
    level, wider = np.zeros(len(row), np.intp), graded.wider[row]
    if len(cut):
        p, normals = (np.concatenate([of, _parts(of[cut], along, apex, parts)]) for of in (p, normals))
        step = step[row]
        other = len(faces) + np.flatnonzero(uneven[row[len(faces) :]])
        wider[other] = graded.grading.of_parts(p[other])
        step[other] = spacing * wider[other]
        level[len(faces) :] = near[row[len(faces) :]] * _halvings(p[len(faces) :], step[len(faces) :], lights)
        longest, step = _edges(p).max(0), step * 0.5**level
        whole = len(faces) + np.flatnonzero(np.repeat(wide[cut] & (apex >= 0), parts))  # parts of one cell
        longest[whole] = np.minimum(longest[whole], step[whole])
        n = steps(np.where(table[:, 0] < 0.0, 0.0, longest), step)
        n[cut] = 0  # their parts have all cells
    unit, size = triangle_normals(p)
    geometric = unit.T.astype(np.float32)

    tiny = longest <= _SMALL * step
    counts = np.where(tiny, 1, (n + 1) * (n + 2) // 2) * (n > 0)
    begin, first = (np.cumsum(of) - of for of in (counts, n * n))
    face, face_of_cell = (np.repeat(np.arange(len(p)), of) for of in (counts, n * n))
    weights, area = np.full((len(face), 3), 1.0 / 3.0, np.float32), size[face]
    large = np.flatnonzero(~tiny[face])
    of = face[large]
    i, j = _grid(large - begin[of], n[of])
    weights[large] = np.stack([n[of] - i - j, i, j], axis=1).astype(np.float32) / n[of][:, None].astype(np.float32)
    position, normal = (np.einsum("pk,pkx->px", weights, corner[face]) for corner in (_inset(p, inset), normals))
    cells_at = np.array([6, 3, 1])[(i == 0).astype(np.intp) + (j == 0) + (i + j == n[of])]  # inside, on an edge, at a corner
    area[large] *= cells_at / (3.0 * n[of] ** 2)

    corners = np.repeat(begin[face_of_cell][:, None], 3, axis=1)
    large = np.flatnonzero(~tiny[face_of_cell])
    of = face_of_cell[large]
    i, j = _corners(large - first[of], n[of])
    corners[large] += j * (2 * n[of][:, None] + 3 - j) // 2 + i

    facing = geometric[face]
    length = np.sqrt(np.einsum("px,px->p", normal, normal))
    length *= np.sign(np.einsum("px,px->p", normal, facing))
    known = length != 0.0
    normal = np.where(known[:, None], normal / np.where(known, length, 1.0)[:, None], facing)
    table[n > 0] = np.stack([n, first], axis=1)[n > 0]
    return Tessellation(table, corners, position, normal, facing, row[face], area, level[face], wider[face])


def _edges(p: np.ndarray) -> np.ndarray:
    """Return (3, F) the edges of triangles `p` (F, 3, 3): from each corner to the next."""
    return np.sqrt([np.einsum("fx,fx->f", e, e) for e in (p[:, (k + 1) % 3] - p[:, k] for k in range(3))])


def _halvings(p: np.ndarray, spacing: np.ndarray, lights: np.ndarray | None) -> np.ndarray:
    """Return (F,) how many times the `spacing` (F,) of triangles `p` (F, 3, 3) is halved near the `lights` (K, 4)."""
    low, high = (np.ascontiguousarray(reduce(extreme, p.swapaxes(0, 1)).T) for extreme in (np.minimum, np.maximum))
    step = spacing.copy()
    for *place, size in () if lights is None else lights:
        np.minimum(step, np.sqrt(squares_from_boxes(low, high, place)) + size, out=step)
    return np.asarray(np.minimum(np.ceil(np.log2(spacing / np.maximum(step, 1e-30))), _FINEST).astype(np.intp))


def _parts(corners: np.ndarray, n: np.ndarray, apex: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return (P, 3, 3) the columns at the corners of the parts of each triangle, by those at its `corners` (F, 3, 3).

    counts: (F,) the number of parts, n² (F,), or 2n - 1 of a sliver that is cut into n strips. apex: (F,) the corner of a sliver
    between its long edges, which the strips cross; -1 for other triangles.
    """
    of = np.repeat(np.arange(len(n)), counts)
    part = np.arange(len(of)) - np.repeat(np.cumsum(counts) - counts, counts)
    i, j = _corners(part, n[of])
    strip = np.flatnonzero(apex[of] >= 0)
    first, odd = (part[strip] + 1) // 2, part[strip] % 2  # the odd part of a strip has an edge on the side of the apex
    i[strip] = np.stack([first, np.where(odd, 0, first + 1), np.zeros_like(first)], axis=1)
    j[strip] = np.stack([np.zeros_like(first), np.where(odd, first + 1, 0), np.where(odd, first, first + 1)], axis=1)
    share = np.stack([n[of][:, None] - i - j, i, j], axis=-1) / n[of][:, None, None]
    turned = (np.arange(3) - np.maximum(apex, 0)[of, None]) % 3
    share = np.take_along_axis(share, turned[:, None], axis=-1)
    return np.asarray(np.einsum("pck,pkx->pcx", share.astype(np.float32), corners[of]))


def _inset(p: np.ndarray, inset: float) -> np.ndarray:
    """Return (N, 3, 3) the corners `p` of triangles, moved by `inset` metres towards their mean, at most half of the way."""
    a, b, c = p.swapaxes(0, 1)
    inward = ((a + b + c) / np.float32(3.0))[:, None] - p
    x, y, z = np.moveaxis(inward, -1, 0)  # numpy is slow along axes of length 3
    length = np.sqrt(x * x + y * y + z * z)[..., None]
    return np.asarray(p + inward * np.minimum(inset / np.maximum(length, 1e-30), 0.5))


def steps(longest: np.ndarray, step: np.ndarray, strips: bool = False) -> np.ndarray:
    """Return (F,) the numbers of steps along longest edges (F,), by steps of these lengths (F,), in metres.

    Steps are longer where triangles would have more than _MAX_CELLS cells, or slivers more such parts of strips.
    """
    while True:
        n = np.maximum(np.ceil(np.minimum(longest / step - 1e-6, 1e6)), 1.0)
        if (2.0 * n * (n >= _SLIVER) if strips else n * n - 1.0).sum() <= _MAX_CELLS:
            return np.asarray(n.astype(np.intp))
        step = 1.25 * step


def _corners(cell: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (C, 3) each, steps along the two edges from a triangle's first corner to the corners of its cells, numbered row by
    row.

    Row j has 2(n - j) - 1 cells, and n² - (n - j)² are before it. The even ones of a row have (i, j) as a corner and lie as the
    triangle does; the odd ones are turned by 180°, between (i + 1, j + 1) and its neighbours.
    """
    j = (n - np.ceil(np.sqrt(n * n - cell))).astype(np.intp)  # squares are exact
    i, odd = np.divmod(cell - j * (2 * n - j), 2)
    return (
        np.stack([i + odd, i + 1 - odd, i + odd], axis=1),
        np.stack([j + odd, j + odd, j + 1 - odd], axis=1),
    )


def _grid(point: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (P,) each, steps along the two edges to the points of triangles, numbered row by row: row j has n - j + 1 points."""
    left = (n + 1) * (n + 2) // 2 - 1 - point  # points after this point
    after = ((np.sqrt(8 * left + 1) - 1.0) / 2.0).astype(np.intp)  # rows after the point's row; squares are exact
    return after - (left - after * (after + 1) // 2), n - after
