"""What both gathers share: where a record looks from, its frame as the shaders read it, and how cells fill an atlas."""

from __future__ import annotations

import math

import numpy as np

from irrsplat.buffers import Sites

OFFSET = 1e-4  # of the scene's diagonal: how far a record looks from above its surface
_TEXELS = 3 << 20  # of an atlas at most, 48 MiB, or 64 with a depth buffer


def eyes(sites: Sites, centroids: np.ndarray, offset: float) -> np.ndarray:
    """(N, 3): `offset` metres above the surface, and as far into its triangle: a site on the very edge of a wall sees the wall.

    centroids: (F, 3) of the scene's triangles.
    """
    above = sites.position + offset * sites.geometric.astype(float)
    if sites.triangle is None:
        return above
    inward = centroids[sites.triangle] - sites.position
    length = np.linalg.norm(inward, axis=1, keepdims=True)
    return above + inward * np.minimum(offset / np.maximum(length, 1e-30), 0.5)


def frame_rows(frame: np.ndarray, sites: Sites, numbers: np.ndarray) -> np.ndarray:
    """(4, N, 4) float32, the rows of Atlas.frames: tangent, bitangent and normal (N, 3, 3), the geometric normal in that frame
    and, last, the records' numbers (N,) in the cache."""
    rows = np.zeros((4, len(sites), 4), "f4")
    rows[:3, :, :3] = frame.swapaxes(0, 1)
    rows[3, :, :3] = np.einsum("nij,nj->ni", frame, sites.geometric)
    rows[3, :, 3] = numbers
    return rows


def atlas_grid(cell: tuple[int, int], wanted: int | None, limit: int) -> tuple[int, int]:
    """Cells per row of an atlas, and how many it holds: those `wanted` (None: as many as are worth it), where they fit.

    cell: its width and height in texels. limit: texels that a side of a texture may have.
    """
    count = min(wanted or max(1, _TEXELS // (cell[0] * cell[1])), limit)
    columns = max(1, min(math.isqrt(count), limit // cell[0]))
    return columns, columns * max(1, min(count // columns, limit // cell[1]))
