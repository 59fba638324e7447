"""All images of a scene as one table of texels, and texture colours at points, at full resolution.

Written independently of the shaders, as their reference. `color_at` runs on NumPy's arrays and on a path tracer's lanes; a
backend holds the differences.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from irrsplat.core.color import linear_from_srgb
from irrsplat.scene.model import Texture

Values: TypeAlias = Any  # an array with one entry per point; its class depends on the backend

_WRAPS = {"repeat": 0.0, "mirror": 1.0, "clamp": 2.0}
_NUMBERS = 12  # per texture: width, height, wrap u and v, nearest, the set of coordinates, and six of the transform
_FARTHEST = 1e9  # texture coordinates beyond, and NaN, count as 0


class Backend(NamedTuple):
    """Operations on the arrays of one library.

    array: of NumPy's values. gather: entries of a table at indices. select: one of two values by a condition. floor: the greatest
    whole numbers up to floats. whole: whole floats as indices.
    """

    array: Callable[[np.ndarray], Values]
    gather: Callable[[Values, Values], Values]
    select: Callable[[Values, Values, Values], Values]
    floor: Callable[[Values], Values]
    whole: Callable[[Values], Values]


NUMPY = Backend(  # in float64
    array=lambda values: values if values.dtype.kind == "u" else values.astype(np.float64),
    gather=lambda table, index: table[index],
    select=np.where,
    floor=np.floor,
    whole=lambda x: x.astype(np.int64),
)


@dataclass(frozen=True)
class TextureTable:
    """Textures by number, in the order given to `of`.

    texels: (N,) of all images, each once, row by row: red in the lowest byte, alpha in the highest. first: (T,) number of a
    texture's first texel. numbers: (T · _NUMBERS,). decode: (256,) linear values of sRGB-encoded bytes.
    """

    backend: Backend
    texels: Values
    first: Values
    numbers: Values
    decode: Values

    @staticmethod
    def of(textures: Iterable[Texture], backend: Backend) -> TextureTable:
        """Return the table of these textures, numbered in order."""
        textures = list(textures)
        images = dict.fromkeys(t.image for t in textures)
        sizes = [image.pixels.shape[0] * image.pixels.shape[1] for image in images]
        starts = dict(zip(images, np.cumsum([0, *sizes]).tolist(), strict=False))
        words = [np.ascontiguousarray(image.pixels).view("<u4").ravel() for image in images]
        rows = [
            (t.image.pixels.shape[1], t.image.pixels.shape[0], *(_WRAPS[w] for w in t.wrap), t.nearest, t.uv_set, *t.transform)
            for t in textures
        ]
        return TextureTable(
            backend,
            backend.array(np.concatenate([np.zeros(0, np.uint32), *words])),
            backend.array(np.array([starts[t.image] for t in textures], np.uint32)),
            backend.array(np.array(rows, np.float32).ravel()),
            backend.array(linear_from_srgb(np.arange(256) / 255.0).astype(np.float32)),
        )

    def place(self, number: Values, uvs: tuple[Values, ...]) -> tuple[Values, Values]:
        """Return image coordinates, from (0, 0) at the top left to (1, 1) at the bottom right, for surface coordinates (u, v, u,
        v)."""
        select, (second, a, b, c, d, e, f) = self.backend.select, (self._number(number, k) for k in range(5, _NUMBERS))
        u, v = (select(second > 0.5, uvs[2 + k], uvs[k]) for k in range(2))
        u, v = (select((x > -_FARTHEST) & (x < _FARTHEST), x, 0.0 * a) for x in (u, v))
        return a * u + b * v + c, d * u + e * v + f

    def color_at(self, number: Values, uvs: tuple[Values, ...], linear: bool = False) -> tuple[Values, Values, Values, Values]:
        """Return red, green, blue and alpha of textures by `number` at texture coordinates (u, v, u, v), bilinear between texels.

        Colours are decoded before interpolation; linear: stored values, 0..1, as in a normal map.
        """
        backend, select = self.backend, self.backend.select
        width, height, wrap_u, wrap_v, nearest = (self._number(number, k) for k in range(5))
        first = backend.gather(self.first, number)
        axes = []
        for coordinate, size, wrap in zip(self.place(number, uvs), (width, height), (wrap_u, wrap_v), strict=True):
            x = select(
                wrap > 1.5, coordinate, coordinate - 2.0 * backend.floor(0.5 * coordinate)
            )  # no effect on the colour; keeps float32 precise
            x = x * size - select(nearest > 0.5, 0.0 * size, 0.5)
            low = backend.floor(x)
            share = select(nearest > 0.5, 0.0 * size, x - low)
            axes.append([(self._wrapped(low, size, wrap), 1.0 - share), (self._wrapped(low + 1.0, size, wrap), share)])
        total: list[Values] = [0.0, 0.0, 0.0, 0.0]
        for row, y in axes[1]:
            for column, x in axes[0]:
                texel = first + backend.whole(row) * backend.whole(width) + backend.whole(column)
                word = backend.gather(self.texels, texel)
                stored = [(word >> shift) & 255 for shift in (0, 8, 16, 24)]
                values = [b * (1.0 / 255.0) if linear or k == 3 else backend.gather(self.decode, b) for k, b in enumerate(stored)]
                total = [sum_ + x * y * value for sum_, value in zip(total, values, strict=True)]
        return total[0], total[1], total[2], total[3]

    def _number(self, number: Values, k: int) -> Values:
        return self.backend.gather(self.numbers, number * _NUMBERS + k)

    def _wrapped(self, i: Values, size: Values, wrap: Values) -> Values:
        """Return the texel at the whole number i of a row of `size` texels continued by `wrap`."""
        backend, select = self.backend, self.backend.select
        mirrored = (wrap > 0.5) & (wrap < 1.5)
        period = select(mirrored, 2.0 * size, size)
        inside = i - period * backend.floor(i / period)
        inside = select(mirrored & (inside > size - 0.5), 2.0 * size - 1.0 - inside, inside)
        inside = select(wrap > 1.5, i, inside)
        inside = select(inside > 0.0, inside, 0.0 * size)
        return select(inside < size - 1.0, inside, size - 1.0)
