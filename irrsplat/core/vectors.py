"""Vector arithmetic: reproducible products, normalisation without overflow, triangle normals and areas, octahedral coordinates
(Cigolle et al. 2014), origins near distant geometry, even directions, and pairs in blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from irrsplat.core.errors import IrrsplatError

Vector = tuple[float, float, float]

_BLOCK = 1 << 15  # triangles at once: some megabytes
_FAR = 4.0  # diagonals from 0 0 0 beyond which float32 is too coarse: shadow rays start 2⁻²⁰ of the diagonal above their surface


def vector(values: npt.ArrayLike) -> Vector:
    """Return three values as a tuple."""
    x, y, z = np.asarray(values, float).tolist()
    return x, y, z


def near_origin(low: np.ndarray, high: np.ndarray) -> Vector:
    """Return a point near the middle of the box `low` to `high`, (3,) each, if it is many diagonals from 0 0 0; else 0 0 0.

    The point is a multiple of a power of two greater than the box. Scenes moved by multiples of it keep the same relative
    numbers, and differences of float32 numbers from it are exact.
    """
    middle, diagonal = 0.5 * (np.asarray(low, float) + high), float(np.linalg.norm(np.subtract(high, low)))
    if not np.isfinite(middle).all() or np.abs(middle).max() <= _FAR * diagonal:
        return 0.0, 0.0, 0.0
    step = 2.0 ** np.ceil(np.log2(diagonal) + 1.0) if diagonal > 0.0 else 1.0
    return vector(np.round(middle / step) * step + 0.0)  # + 0: no -0


def box(points: np.ndarray) -> np.ndarray:
    """Return (2, 3) the least and the greatest coordinates of points (N, 3), of which there is at least one.

    By columns, which takes a twentieth of the time of a reduction along the long axis.
    """
    return np.array([[column.min() for column in points.T], [column.max() for column in points.T]])


def corners(ends: np.ndarray) -> np.ndarray:
    """Return (8, 3) the corners of a box with these least and greatest coordinates (2, 3)."""
    return np.array(np.meshgrid(*ends.T)).reshape(3, -1).T


def as_float32(positions: np.ndarray) -> np.ndarray:
    """Return positions (N, 3) in float32, relative to a near point if they are far from 0 0 0, so that equal positions stay
    equal."""
    if not len(positions):
        return positions.astype(np.float32)
    origin = near_origin(*box(positions))
    return (positions - origin if any(origin) else positions).astype(np.float32)


def check_finite(what: str, values: np.ndarray, place: Callable[[tuple[int, ...]], str]) -> None:
    """Raise IrrsplatError if a value of `values` is not finite; `place` returns the words for an index."""
    if not np.isfinite(values).all():
        bad = np.argwhere(~np.isfinite(values))
        where = place(tuple(bad[0].tolist()))
        raise IrrsplatError(f"{what} is not finite at {where} ({len(bad)} of {values.size} numbers); please report this scene")


def times(vectors: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return (N, 3): each row of vectors (N, 3) times the transpose of matrix (3, 3), or of the row's own matrix in (N, 3, 3).

    Each row's result is independent of the other rows to the last bit, which `@` (BLAS) does not guarantee.
    """
    return np.asarray(vectors[:, :1] * matrix[..., 0] + vectors[:, 1:2] * matrix[..., 1] + vectors[:, 2:] * matrix[..., 2])


def unit(vectors: np.ndarray) -> np.ndarray:
    """Return each row scaled to length 1; rows of zeros stay zeros."""
    largest = np.abs(vectors).max(axis=1, keepdims=True, initial=0.0)
    scaled = vectors / np.where(largest > 0.0, largest, 1.0)  # prevents underflow of tiny squares
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    return scaled / np.where(length > 0.0, length, 1.0)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return (N, 3, …) cross products of a and b (N, 3, …) along their second axis, with less overhead than `np.cross`."""
    product = np.empty(a.shape, np.result_type(a, b))
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        product[:, i] = a[:, j] * b[:, k] - a[:, k] * b[:, j]
    return product


def triangle_normals(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (3, F) float64 normals of triangles (F, 3, 3) by their winding, unit or 0, and (F,) their areas.

    By columns, since numpy is slow along axes of length 3, and in blocks that stay in the processor's cache.
    """
    normals, areas = np.empty((3, len(corners))), np.empty(len(corners))
    for first in range(0, len(corners), _BLOCK):
        some = slice(first, first + _BLOCK)
        a, b, c = (corners[some, k].T.astype(float, order="C") for k in range(3))
        b -= a
        c -= a
        normal = np.stack([b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]])
        twice = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        normals[:, some], areas[some] = normal / np.maximum(twice, 1e-300), 0.5 * twice
    return normals, areas


def squares_from_boxes(low: np.ndarray, high: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return (N,) the squared distances of a `place` (3,) from the boxes with the corners `low` and `high`, (3, N) each."""
    sides = zip(low, high, place, strict=True)
    return np.asarray(sum(np.maximum(np.maximum(least - x, x - most), 0.0) ** 2 for least, most, x in sides))


def triangle_areas(corners: np.ndarray) -> np.ndarray:
    """Return (F,) areas of triangles with corners (F, 3, 3)."""
    return triangle_normals(corners)[1]


def octahedral_encode(directions: np.ndarray) -> np.ndarray:
    """Return (2, N) octahedral coordinates of unit vectors (N, 3), as in shaders/lib/normals.glsl."""
    x, y, z = directions.T / np.abs(directions).sum(1)
    folded = (1.0 - np.abs([y, x])) * np.where(np.array([x, y]) >= 0.0, 1.0, -1.0)
    return np.where(z >= 0.0, [x, y], folded)


def octahedral_decode(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the unit vectors (..., 3) of octahedral coordinates x and y, as in shaders/lib/normals.glsl."""
    z = 1.0 - np.abs(x) - np.abs(y)
    fold = np.maximum(-z, 0.0)
    v = np.stack([x - np.copysign(fold, x), y - np.copysign(fold, y), z], axis=-1)
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-30))


def sphere(count: int) -> np.ndarray:
    """Return (count, 3) unit vectors evenly spread over the sphere: a Fibonacci lattice."""
    i = np.arange(count)
    height, angle = 1.0 - (2.0 * i + 1.0) / count, i * np.pi * (3.0 - np.sqrt(5.0))
    level = np.sqrt(1.0 - height * height)
    return np.stack([level * np.cos(angle), level * np.sin(angle), height], axis=1)


def morton_codes(coordinates: np.ndarray) -> np.ndarray:
    """Return (N,) int64 Morton codes: interleaved bits of coordinates (3, N) in 0 … 1023, truncated. Near points mostly have near
    codes."""
    code = np.zeros(coordinates.shape[1], np.int64)
    for axis, number in enumerate(coordinates.astype(np.int64)):
        for shift, mask in ((16, 0xFF0000FF), (8, 0x0F00F00F), (4, 0xC30C30C3), (2, 0x49249249)):
            number = (number | number << shift) & mask
        code |= number << axis
    return code


def along_a_way(points: np.ndarray) -> np.ndarray:
    """Return (N,) int64 positions of points (N, 3) along a Morton curve through their bounding box."""
    low = points.min(0, initial=np.inf)
    extent = max(float((points.max(0, initial=-np.inf) - low).max()), 1e-30)
    return morton_codes(((points - low) * (1023.0 / extent)).T)


def pairs(first: np.ndarray, count: np.ndarray, most: int) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
    """Yield blocks of rows with about `most` pairs, and the pairs: row `i` and each of the count[i] numbers from first[i] on."""
    ends, start = np.cumsum(count), 0
    while start < len(count):
        done = int(ends[start - 1]) if start else 0
        rows = slice(start, max(start + 1, int(np.searchsorted(ends, done + most, "right"))))
        row = np.repeat(np.arange(rows.start, rows.stop), count[rows])
        yield rows, row, np.arange(len(row)) + np.repeat(first[rows] - (ends[rows] - count[rows] - done), count[rows])
        start = rows.stop
