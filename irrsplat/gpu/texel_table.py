"""Tables in textures: items by number, row after row, laid out as arrays, or written and read in part."""

from __future__ import annotations

import math
from collections.abc import Iterator

import moderngl
import numpy as np

from irrsplat.core.glsl import TABLE_COLUMNS


def row_count(items: int) -> int:
    """Return the number of rows of a table of `items`, at least one."""
    return max(-(-items // TABLE_COLUMNS), 1)


def table_rows(items: np.ndarray) -> np.ndarray:
    """Return items (N, T, 4) of T texels, or (N, W) of W numbers, as a table (R, TABLE_COLUMNS·T, 4), padded with zeros.

    The table has at least one row, and zeros fill an item's last texel.
    """
    numbers = items.reshape(len(items), math.prod(items.shape[1:]))
    count, width = numbers.shape
    rows, texels = row_count(count), -(-width // 4)
    table = np.zeros((rows * TABLE_COLUMNS, 4 * texels), items.dtype)
    table[:count, :width] = numbers
    return table.reshape(rows, TABLE_COLUMNS * texels, 4)


def chosen_rows(texels: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Return the table, in the layout of `table_rows`, of N items that consist of the `texels` (M, 4) of `numbers` (N, T)."""
    count, each = numbers.shape
    rows = row_count(count)
    table = np.zeros((rows * TABLE_COLUMNS * each, 4), texels.dtype)
    np.take(texels, numbers.ravel(), axis=0, out=table[: count * each], mode="clip")  # unlike "raise", without a copy
    return table.reshape(rows, TABLE_COLUMNS * each, 4)


# ---- runs of texels: number i is texel (i % width, i // width) -----------------------------------------------------------


def write(texture: moderngl.Texture, first: int, values: np.ndarray) -> None:
    """Write `values` (N, C) into the texture's texels from number `first` on."""
    values = np.ascontiguousarray(values, texture.dtype)
    for start, box in _boxes(first, len(values), texture.width):
        texture.write(values[start : start + box[2] * box[3]], viewport=box)


def read(ctx: moderngl.Context, texture: moderngl.Texture, first: int, last: int) -> np.ndarray:
    """Return the texels `first` to `last` - 1 of a float texture, (last - first, C) float32; reads only their rows."""
    width, components = texture.width, texture.components
    if first == last:
        return np.zeros((0, components), "f4")
    low, high = first // width, -(-last // width)
    window = ctx.framebuffer([texture])
    data = window.read((0, low, width, high - low), components, dtype="f4")
    window.release()
    return np.frombuffer(data, "f4").reshape(-1, components)[first - low * width : last - low * width]


def _boxes(first: int, count: int, width: int) -> Iterator[tuple[int, tuple[int, int, int, int]]]:
    """Yield the rectangles of `count` texels from `first` on: the rest of a row, whole rows, the start of a row.

    Each as (number of texels before it, (x, y, width, height)).
    """
    done = 0
    while done < count:
        y, x = divmod(first + done, width)
        across = min(width - x, count - done)
        down = (count - done) // width if across == width else 1
        yield done, (x, y, across, down)
        done += across * down
