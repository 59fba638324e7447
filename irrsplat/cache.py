"""The persistent record cache: where records are kept in world space, so that they outlive camera moves."""

from __future__ import annotations

import moderngl
import numpy as np

from irrsplat.buffers import Records, Sites
from irrsplat.gpu.target import float_texture

_COLUMNS = 1024
_TEXTURES = 9  # position, normal, irradiance and radius, then the six of Records.vectors
_ROWS = 4  # at first; doubled whenever they are full


class RecordCache:
    """Records in the order in which they were asked for: p and n are known here too, E and R on the GPU alone."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.count = 0
        self._position = np.zeros((_ROWS * _COLUMNS, 4), "f4")
        self._normal = np.zeros_like(self._position)
        self._textures = [float_texture(ctx, (_COLUMNS, _ROWS)) for _ in range(_TEXTURES)]

    @property
    def records(self) -> Records:
        """The textures as they stand; valid until the next `append`."""
        position, normal, irradiance, *vectors = self._textures
        return Records(position, normal, irradiance, tuple(vectors), self.count, _COLUMNS)

    def append(self, sites: Sites, values: np.ndarray | None = None) -> int:
        """Add records at `sites`; returns the first one's number.

        values: (N, 4) float32 E in W/m² and R_k in metres; without it the reduction has yet to write them on the GPU.
        """
        first, self.count = self.count, self.count + len(sites)
        self._reserve(self.count)
        self._position[first : self.count, :3] = sites.position
        self._normal[first : self.count, :3] = sites.normal
        low, high = first // _COLUMNS, -(-self.count // _COLUMNS)
        for texture, rows in zip(self._textures, (self._position, self._normal), strict=False):
            part = rows[low * _COLUMNS : high * _COLUMNS]
            texture.write(part.tobytes(), viewport=(0, low, _COLUMNS, high - low))
        if values is not None:
            self._put(2, first, values)
            for i in range(3):  # a record without directions: M = E·n_k, no gradient
                self._put(3 + i, first, np.pad(sites.normal * values[:, i : i + 1], ((0, 0), (0, 1))))
                self._put(6 + i, first, np.zeros_like(values))
        return first

    def _put(self, texture: int, first: int, values: np.ndarray) -> None:
        whole = np.frombuffer(self._textures[texture].read(), "f4").reshape(-1, 4).copy()
        whole[first : first + len(values)] = values
        self._textures[texture].write(whole.tobytes())

    def _reserve(self, count: int) -> None:
        rows = len(self._position) // _COLUMNS
        if count <= rows * _COLUMNS:
            return
        while count > rows * _COLUMNS:
            rows *= 2
        grow = ((0, rows * _COLUMNS - len(self._position)), (0, 0))
        self._position, self._normal = np.pad(self._position, grow), np.pad(self._normal, grow)
        old, self._textures = self._textures, [float_texture(self.ctx, (_COLUMNS, rows)) for _ in range(_TEXTURES)]
        for texture, was in zip(self._textures, old, strict=True):
            texture.write(was.read(), viewport=(0, 0, *was.size))
            was.release()

    def read(self) -> dict[str, np.ndarray]:
        """The records as numpy arrays: `position`, `normal`, `irradiance` (N, 3) and `radius` (N,), float32."""
        last = np.frombuffer(self._textures[2].read(), "f4").reshape(-1, 4)[: self.count]
        return {
            "position": self._position[: self.count, :3].copy(),
            "normal": self._normal[: self.count, :3].copy(),
            "irradiance": last[:, :3].copy(),
            "radius": last[:, 3].copy(),
        }

    def truncate(self, count: int) -> None:
        """Forget every record from number `count` on; 0 forgets all."""
        self.count = min(count, self.count)

    def release(self) -> None:
        """Free the textures."""
        for texture in self._textures:
            texture.release()
