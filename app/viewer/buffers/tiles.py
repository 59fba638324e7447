"""Tiles of equal size in a window: shadow maps, and the cells of the gather atlas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.app.viewer.show.screen import Region

GAP = 2.0  # pixels between tiles


@dataclass(frozen=True)
class Tiling:
    """Tiles in rows from the upper left corner (left, top; pixels from the lower left): how many a row, pixels per texel."""

    per_row: int
    pixels_per_texel: float
    left: float
    top: float


def tiling(count: int, tile: tuple[float, float], area: Region) -> Tiling:
    """The tiling that shows `count` tiles of `tile` texels largest in an area of a window."""
    x, y, *size = area
    per_row = np.arange(1, max(count, 1) + 1)
    rows = -(-max(count, 1) // per_row)
    pixels = np.minimum((size[0] - GAP * (per_row - 1)) / (per_row * tile[0]), (size[1] - GAP * (rows - 1)) / (rows * tile[1]))
    best = int(np.argmax(pixels))
    scale = max(float(pixels[best]), 1.0 / max(tile))
    width, height = (n[best] * (c * scale + GAP) - GAP for n, c in ((per_row, tile[0]), (rows, tile[1])))
    return Tiling(int(per_row[best]), scale, x + (size[0] - width) / 2.0, y + size[1] - (size[1] - height) / 2.0)


def common(a: Region, b: Region | None) -> Region | None:
    """Return the overlap of two regions; None if there is none. b: None for everywhere."""
    if b is None:
        return a
    low = max(a[0], b[0]), max(a[1], b[1])
    high = min(a[0] + a[2], b[0] + b[2]), min(a[1] + a[3], b[1] + b[3])
    return (*low, high[0] - low[0], high[1] - low[1]) if high[0] > low[0] and high[1] > low[1] else None
