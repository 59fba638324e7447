"""A sky with a map: the visible radiance, the map that lights the scene, and its suns."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from irrsplat.core.glsl import SKY_RAY_TEXELS
from irrsplat.core.vectors import Vector, vector
from irrsplat.sky.sphere import equirectangular, from_square, pyramid, square, trilinear
from irrsplat.sky.split import Sun

_MOST_TEXELS = 512  # along a side of the map for lighting: a texel is 0.4° wide, finer than the spacing of any gather's rays
_LEAST_TEXELS = 16
_POINTS = 4  # points along a side of a texel at which the map is sampled


@dataclass(frozen=True, eq=False)  # compared by identity, since arrays have no single result of ==
class Environment:
    """A sky from a map. Directions in its own axes have x east, y up and z south; the middle of a map is north.

    shown: (H, W, 3) float32 equirectangular radiance for the camera, top row first. light: the map without `suns`, which are
    among the scene's lights. frame: (3, 3) rows east, up and south in world space. about: in words. line: the words after `sky`
    in a `.scene`, if they name no file; else empty.
    """

    shown: np.ndarray
    light: np.ndarray
    suns: tuple[Sun, ...] = ()
    about: str = "a map"
    frame: np.ndarray = field(default_factory=lambda: np.eye(3))
    line: str = ""

    @cached_property
    def digest(self) -> bytes:
        """Hash of the visible sky."""
        whole = hashlib.sha256(repr((self.shown.shape, self.suns, (self.frame + 0.0).tolist())).encode())
        for part in (self.shown, self.light):
            whole.update(np.ascontiguousarray(part).tobytes())
        return whole.digest()

    @cached_property
    def seen_levels(self) -> list[np.ndarray]:
        """`shown` with its coarser levels."""
        return pyramid(self.shown)

    @cached_property
    def light_levels(self) -> list[np.ndarray]:
        """`light` in the equal-area square with its coarser levels, (N, N, 3) float32 each, row by row along v."""
        requested = np.sqrt(4.0 * np.pi) * 2.0 * len(self.light) / np.pi  # texels half as wide as the map's
        side = int(np.clip(2 ** np.ceil(np.log2(requested)), _LEAST_TEXELS, _MOST_TEXELS))
        source = pyramid(self.light, 4 * side)[-1]
        total = np.zeros((side, side, 3))
        for dy in range(_POINTS):
            for dx in range(_POINTS):
                x, y = ((np.arange(side) + (d + 0.5) / _POINTS) / side for d in (dx, dy))
                total += _texel(source, from_square(*np.meshgrid(x, y)))
        mean = total.mean((0, 1))
        return pyramid((total * np.divide(self.mean, mean, out=np.zeros(3), where=mean > 0.0)).astype(np.float32))

    @cached_property
    def mean(self) -> np.ndarray:
        """(3,) mean of `light` over the sphere."""
        height = len(self.light)
        weight = -0.5 * np.diff(np.cos(np.linspace(0.0, np.pi, height + 1)))
        return np.asarray(weight @ self.light.mean(1, dtype=float))

    def seen(self, directions: np.ndarray, solid: np.ndarray | float = 0.0) -> np.ndarray:
        """Return (…, 3) visible radiance in unit directions (…, 3) of world space, each `solid` steradians wide."""
        u, v = equirectangular(directions @ self.frame.T)
        texel = np.pi / len(self.shown)
        level = 0.5 * np.log2(np.maximum(np.broadcast_to(solid, u.shape), texel**2) / texel**2)
        return trilinear(self.seen_levels, level, u, v, wrap=True)

    def lit_by(self, directions: np.ndarray, solid: np.ndarray | float) -> np.ndarray:
        """Return (…, 3) radiance of the lighting map along rays in these directions, each of `solid` steradians."""
        u, v = square(directions @ self.frame.T)
        texel = SKY_RAY_TEXELS * 4.0 * np.pi / len(self.light_levels[0]) ** 2
        level = 0.5 * np.log2(np.maximum(np.broadcast_to(solid, u.shape), texel) / texel)
        return trilinear(self.light_levels, level, u, v, wrap=False)

    def toward(self, sun: Sun) -> Vector:
        """Return the (3,) unit direction towards a sun, world space."""
        return vector(self.frame.T @ np.asarray(sun.direction) + 0.0)


def frame_of(axes: np.ndarray, turn: float) -> np.ndarray:
    """Return (3, 3) rows east, up and south of a sky whose north is `turn` degrees clockwise, seen from above, of the world's
    back.

    axes: (3, 3) rows right, up and front of the world.
    """
    right, up, front = axes
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    return np.stack([c * right + s * front, up, c * front - s * right])


def _texel(image: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Return (…, 3) nearest texels of an equirectangular map."""
    u, v = equirectangular(directions)
    height, width = image.shape[:2]
    return np.asarray(image[np.minimum((v * height).astype(np.intp), height - 1), (u * width).astype(np.intp) % width])
