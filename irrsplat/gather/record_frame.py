"""Code that all gathers share: eye position and tangent frame of a record, and the layout of cells in an atlas."""

from __future__ import annotations

import math

import numpy as np

from irrsplat.core.buffers import Sites
from irrsplat.core.glsl import GOLDEN, SQUARE_STEPS
from irrsplat.core.vectors import cross
from irrsplat.scene.model import Scene

OFFSET = 1e-4, 2.5e-3  # of the scene's diagonal, metres: greatest height of a record's eye above its surface
_LEAST = 1e-6  # of the diagonal: least height, ten times the rounding of float32
_ON_SCREEN = 5e-4  # of the image height, half a pixel: greatest height, so that eyes lie in no small object on a large ground
PLACES = 8  # eye positions of a gather that has several
FEW_RAYS = 1 << 16  # rays of one batch of gathers along few rays, at most: a larger atlas takes long to make
_TEXELS = 1 << 20  # of an atlas at most: two RGBA32F textures of 16 MiB, and 4 MiB for a depth buffer


def offset_of(scene: Scene) -> float:
    """Return the greatest height of an eye above its surface, metres: equal on a large ground and in the house on this ground."""
    return max(min(OFFSET[0] * scene.diagonal, OFFSET[1]), _LEAST * scene.diagonal)


def eye_heights(sites: Sites, scene: Scene) -> np.ndarray:
    """Return (N,) metres: the heights of the sites' eyes above their surfaces."""
    offset, screen = offset_of(scene), sites.screen_heights.astype(float)
    return np.where(screen > 0.0, np.clip(_ON_SCREEN * screen, _LEAST * scene.diagonal, offset), offset)


def eye_positions(sites: Sites, corners: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Return (N, 3), the eye positions: `heights` (N,) metres above the surface, and at least as far within the triangle.

    A site on the very edge of a wall therefore sees the wall. corners: (F, 3, 3) of the scene's triangles. A site far enough from
    the edges stays in place: on a large triangle, a move towards the middle might cross a sheet that stands there.
    """
    above: np.ndarray = sites.position + heights[:, None] * sites.geometric.astype(float)
    if sites.triangle is None:
        return above
    # coordinates in rows: numpy is slow along rows of three numbers
    place, triangle = sites.position.T.astype(float), corners[sites.triangle].transpose(1, 2, 0).astype(float, order="C")
    sides = np.roll(triangle, -1, axis=0) - triangle
    across = np.linalg.norm(cross(place - triangle, sides), axis=1)
    apart = across / np.maximum(np.linalg.norm(sides, axis=1), 1e-30)  # distance from each edge
    inward = triangle.mean(0) - place
    length = np.linalg.norm(inward, axis=0)
    share = np.clip(heights - apart.min(0), 0.0, 0.5 * length) / np.maximum(length, 1e-30)
    return np.asarray(above + (inward * share).T)


def tangent_frames(normal: np.ndarray, number: np.ndarray, seed: int) -> np.ndarray:
    """Return (N, 3, 3) rows tangent, bitangent, normal for unit normals (N, 3), rotated by an angle from `number` (N,) and seed.

    The rotation trades aliasing that all records share for noise between them. The base frame is that of Duff et al. 2017,
    "Building an Orthonormal Basis, Revisited".
    """
    x, y, z = normal.T.astype(float)
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    tangent = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    bitangent = np.stack([b, sign + y * y * a, -y], axis=-1)
    angle = (2.0 * np.pi * np.modf((number + 1.0) * GOLDEN + seed * math.sqrt(2.0))[0])[:, None]
    return np.stack(
        [
            np.cos(angle) * tangent + np.sin(angle) * bitangent,
            np.cos(angle) * bitangent - np.sin(angle) * tangent,
            normal.astype(float),
        ],
        axis=1,
    )


def sample_offsets(number: np.ndarray, seed: int) -> np.ndarray:
    """Return (N, 2) in 0..1: shifts of the next-event sample pattern, from `number` (N,) and seed.

    Numbers that follow each other share the unit square evenly (Roberts 2018, "The Unreasonable Effectiveness of Quasirandom
    Sequences").
    """
    return np.asarray(np.modf((number[:, None] + 1.0) * np.array(SQUARE_STEPS) + seed * np.sqrt([2.0, 3.0]))[0])


def places_of_texels(cell: tuple[int, int], places: int) -> np.ndarray:
    """Return (R,), the index of the eye position of each texel of a cell (width, height), row by row, as in
    shaders/gather/places.glsl."""
    x, y = np.meshgrid(np.arange(cell[0]), np.arange(cell[1]))
    return ((x + 2 * y) % places).ravel()


def rows_of_places(numbers: np.ndarray, places: int) -> np.ndarray:
    """Return (N·places,) the rows of the places of records of these numbers (N,), in a list with all places of each record."""
    return (places * numbers[:, None] + np.arange(places)).ravel()


def atlas_grid(cell: tuple[int, int], requested: int | None, limit: int) -> tuple[int, int]:
    """Return the cells per row of an atlas and its number of cells: as many as requested, or fewer if 32 MiB hold fewer.

    cell: width and height in texels. requested: None for no limit. limit: greatest side of a texture, in texels.
    """
    most = min(max(1, _TEXELS // (cell[0] * cell[1])), limit)
    count = min(requested or most, most)
    columns = max(1, min(math.isqrt(count), limit // cell[0]))
    return columns, columns * max(1, min(count // columns, limit // cell[1]))
