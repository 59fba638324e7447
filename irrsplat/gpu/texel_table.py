"""Numbered texels: a run of them in a texture, of which number i is texel (i % width, i // width), written or read alone."""

from __future__ import annotations

from collections.abc import Iterator

import moderngl
import numpy as np


def write(texture: moderngl.Texture, first: int, values: np.ndarray) -> None:
    """Put `values` (N, C) into the float texture's texels from number `first` on."""
    values = np.ascontiguousarray(values, "f4")
    for start, box in _boxes(first, len(values), texture.width):
        part = values[start : start + box[2] * box[3]]
        texture.write(part.tobytes(), viewport=box)


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
    """Copy all of one texture's rows into the first rows of another that is as wide and no less high, on the GPU."""
    windows = [ctx.framebuffer([texture]) for texture in (target, source)]
    ctx.copy_framebuffer(*windows)
    for window in windows:
        window.release()


def _boxes(first: int, count: int, width: int) -> Iterator[tuple[int, tuple[int, int, int, int]]]:
    """The rectangles (x, y, width, height) that `count` texels from `first` on make up, each after the number of those before
    it: the rest of a row, whole rows, and the begin of one."""
    done = 0
    while done < count:
        y, x = divmod(first + done, width)
        across = min(width - x, count - done)
        down = (count - done) // width if across == width else 1
        yield done, (x, y, across, down)
        done += across * down
