"""Tables in textures: items by number, row after row. Laid out as an array, or written, read and copied in part on the GPU."""

from __future__ import annotations

from collections.abc import Iterator

import moderngl
import numpy as np

from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.gpu.target import Target


def row_count(items: int) -> int:
    """The rows of a table of so many items, at least one."""
    return max(-(-items // TABLE_COLUMNS), 1)


def table_rows(items: np.ndarray) -> np.ndarray:
    """Items (N, T, 4) of T texels each laid out as a table, at least one row: (R, TABLE_COLUMNS·T, 4), zeros at the end."""
    count, texels = items.shape[:2]
    rows = row_count(count)
    table = np.zeros((rows * TABLE_COLUMNS, texels, 4), items.dtype)
    table[:count] = items
    return table.reshape(rows, TABLE_COLUMNS * texels, 4)


def chosen_rows(texels: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """The table of N items, each of the `texels` (M, 4) of its T `numbers` (N, T), as `table_rows` lays it out."""
    count, each = numbers.shape
    rows = row_count(count)
    table = np.zeros((rows * TABLE_COLUMNS * each, 4), texels.dtype)
    np.take(texels, numbers.ravel(), axis=0, out=table[: count * each], mode="clip")  # unlike "raise", without a copy
    return table.reshape(rows, TABLE_COLUMNS * each, 4)


# ---- runs of texels: number i is texel (i % width, i // width) -----------------------------------------------------------


def write(texture: moderngl.Texture, first: int, values: np.ndarray) -> None:
    """Put `values` (N, C) into the texture's texels from number `first` on."""
    values = np.ascontiguousarray(values, texture.dtype)
    for start, box in _boxes(first, len(values), texture.width):
        texture.write(values[start : start + box[2] * box[3]], viewport=box)


def read(ctx: moderngl.Context, texture: moderngl.Texture, first: int, last: int) -> np.ndarray:
    """The texels of a float texture from number `first` to before `last`, (last - first, C) float32; only their rows are read."""
    width, components = texture.width, texture.components
    if first == last:
        return np.zeros((0, components), "f4")
    low, high = first // width, -(-last // width)
    window = ctx.framebuffer([texture])
    data = window.read((0, low, width, high - low), components, dtype="f4")
    window.release()
    return np.frombuffer(data, "f4").reshape(-1, components)[first - low * width : last - low * width]


def copy(ctx: moderngl.Context, source: moderngl.Texture, target: moderngl.Texture) -> None:
    """Copy one texture into the first rows of another that is as wide and at least as high, on the GPU."""
    into, of = (Target(ctx, texture.size, textures=[texture]) for texture in (target, source))
    into.use()  # else a scissor of the last draw cuts off what is copied
    ctx.copy_framebuffer(into.gl, of.gl)
    for window in (into, of):
        window.release()


def _boxes(first: int, count: int, width: int) -> Iterator[tuple[int, tuple[int, int, int, int]]]:
    """The rectangles that `count` texels from `first` on make up: the rest of a row, whole rows, the start of a row.

    Each as (number of texels before it, (x, y, width, height)).
    """
    done = 0
    while done < count:
        y, x = divmod(first + done, width)
        across = min(width - x, count - done)
        down = (count - done) // width if across == width else 1
        yield done, (x, y, across, down)
        done += across * down
