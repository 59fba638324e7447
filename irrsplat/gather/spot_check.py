"""The spot check (docs/METHOD.md, 7.3): probes at positions all over a view, compared with the cached irradiance.

Inter-record variance cannot find errors between records that agree: in the dark between them, and under small objects without a
record. A probe of few rays measures the irradiance at such a position. Few rays have a large error, so that large differences
lead to probes with more and more rays before a record is requested.

Further checks probe between these positions, where the last check has found an error. Their records cover little more than a
pixel: the shadow of a handrail must not darken the wall around it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Sites, SplatBuffer
from irrsplat.core.vectors import octahedral_decode
from irrsplat.gather.stratified import LEAST_SIDE
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target
from irrsplat.scene.model import Camera, part_drawn

SIDES = (LEAST_SIDE, 8, 16, 32)  # gather sides of the first probes, and of those at places where the preceding ones differ
_SIGNIFICANT = (0.55, 0.3, 0.25, 0.25)  # difference that counts, see `Spots.difference`
_AT_CREASES = (0.0, 0.12, 0.15, 0.15)  # difference that counts at creases: all places there reach the second probes
_ROWS = 125  # rows of squares with one probed pixel each; below 1.5 times as many rows of pixels, all pixels are probed
_OWN = 0.75  # of the distance between probes of a further check: greatest radius of the records that it requests
_FLOOR = 0.1  # of the mean cached luminance: lower bound of the luminance in relative differences
MARGIN = 2  # pixels around each part of a view that its picture and the search for creases need


@dataclass(frozen=True, eq=False)
class Spots:
    """Probed positions of a view.

    sites: (N,), each with a frame rotation. cached: (N,) cached luminance of E, W/m². at_crease: (N,) True if a surface within a
    few pixels rises above the plane of the position. mean: mean of `cached` over the view, W/m².
    """

    sites: Sites
    cached: np.ndarray
    at_crease: np.ndarray
    mean: float = 0.0

    @staticmethod
    def joined(parts: Sequence[Spots]) -> Spots:
        """Return the places of all parts of a view, in an order independent of the division into parts."""
        joined = Sites.joined([part.sites for part in parts])
        cached, creases = (np.concatenate([getattr(part, name) for part in parts]) for name in ("cached", "at_crease"))
        assert joined.frame_rotation is not None
        order = np.argsort(joined.frame_rotation)
        mean = float(cached[order].mean(dtype=float)) if len(order) else 0.0
        return Spots(joined[order], cached[order], creases[order], mean)

    def __len__(self) -> int:
        return len(self.sites)

    def __getitem__(self, rows: np.ndarray | slice) -> Spots:
        return Spots(self.sites[rows], self.cached[rows], self.at_crease[rows], self.mean)

    def near(self, failed: Sequence[np.ndarray], size: tuple[int, int]) -> Spots:
        """Return the places of a further check that no check before has probed, in a view of `size`.

        They lie in the squares with errors at the last check, and in adjacent squares. failed: numbers of pixels with errors, by
        check.
        """
        width, side = size[0], _side(size[1])
        marked, around = np.zeros(np.floor_divide(size[::-1], side) + 3, bool), np.indices((3, 3)).reshape(2, -1, 1)
        for last, pixels in zip((True, *[False] * len(failed)), reversed(failed), strict=False):
            rows, columns = np.divmod(pixels, width)
            marked[rows // side + around[0], columns // side + around[1]] = last
        y, x = np.divmod(self.pixels, width)
        j, i = y // side, x // side
        first = (x == side * i + j % side) & (y == side * j + i % side)  # as pixel_of_square in shaders/lib/texel.glsl
        return self[marked[j + 1, i + 1] & ~first]

    @property
    def pixels(self) -> np.ndarray:
        """(N,) the numbers of the pixels, row by row."""
        assert self.sites.frame_rotation is not None
        return self.sites.frame_rotation

    def difference(self, found: np.ndarray) -> np.ndarray:
        """Return (N,) the differences of probes `found` (N,) W/m² from the cache, relative to the greater luminance Y of both.

        Above the mean, they are relative to √(Y·mean): the picture's RMSE weights bright places more, and the eye does not.
        At creases, which fill a cluttered room, they are relative to the mean at least.
        A brighter probe at a dark place counts as 0: closer to a sheet than a gather's offset, it may be on the other side.
        """
        dark = _FLOOR * self.mean
        floor = np.where(self.at_crease, self.mean, dark)
        Y = np.maximum(np.maximum(found, self.cached), np.maximum(floor, 1e-30))
        share = np.abs(found - self.cached) / np.sqrt(Y * np.minimum(Y, max(self.mean, 1e-30)))
        return np.where((found > self.cached) & (self.cached < dark), 0.0, share)


class SpotPass(Owner):
    """Pass that selects the probed positions in views: one pixel per square of pixels."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.program = self.own(Program(ctx, "indirect/spots", "lib/fullscreen", {"MARGIN": MARGIN}))
        self.targets = self.own(Workshop())

    def __call__(self, gbuffer: GBuffer, splats: SplatBuffer, camera: Camera, fine: bool = False, margin: int = 0) -> Spots:
        """Return the places of a view, or of the part that `camera` draws.

        Every pixel is splatted. A place has cached irradiance, and its surface reflects more than it emits. fine: True for
        squares of half the side, and records of limited radii. margin: pixels at the borders of a part without places.
        """
        part = part_drawn(camera, gbuffer.position.size)
        pixel_size = camera.screen / part.whole[1]
        side = max(1, _side(part.whole[1]) // (1 + fine))
        first, size = np.floor_divide(part.corner, side), (part.size[0] // side + 2, part.size[1] // side + 2)
        target = self.targets.get("target", size, lambda: Target(self.ctx, size, (4, 4, 4)))
        self.program(
            target,
            **gbuffer.surface_uniforms,
            **gbuffer.material_uniforms,
            sums=splats.sums,
            pixel_size=pixel_size,
            stride=side,
            corner=part.corner,
            whole=part.whole,
            first=tuple(first),
        )
        square = first + np.stack(np.meshgrid(*map(np.arange, size)), axis=-1)
        pixel = side * square + square[..., ::-1] % side  # in the whole picture, as pixel_of_square in shaders/lib/texel.glsl
        position, normal, rest = (target.read(i)[::-1] for i in range(3))
        low = np.maximum(np.add(part.corner, margin), 0)
        high = np.minimum(np.add(part.corner, part.size) - margin, part.whole)
        there = (position[..., 3] > 0.0) & ((pixel >= low) & (pixel < high)).all(-1)
        position, normal, rest, pixel = position[there], normal[there], rest[there], pixel[there]
        geometric = octahedral_decode(normal[:, 3], rest[:, 0])
        number = pixel[:, 1] * part.whole[0] + pixel[:, 0]
        place, triangle = position[:, :3].astype(float), rest[:, 2].astype(np.intp)
        screen = camera.measure_at(place, part.size)
        radius = _OWN * side * pixel_size * np.linalg.norm(place - camera.eye, axis=1) if fine else None
        sites = Sites(position[:, :3], normal[:, :3], geometric, triangle, number, screen, radius)
        return Spots.joined([Spots(sites, rest[:, 1].astype(float), rest[:, 3] > 0.0)])


def _side(rows: int) -> int:
    """Return the side of the squares in a picture of so many rows, pixels."""
    return max(1, round(rows / _ROWS))


@dataclass(frozen=True, eq=False)
class SpotCheck:
    """The progress of a spot check: an immutable value.

    spots: the positions of the present probes. found: (K,) luminances, W/m², at the first K of them. stage: index of the present
    probes in SIDES; after the last stage, the places that need a record.
    """

    spots: Spots
    found: np.ndarray = field(default_factory=lambda: np.zeros(0))
    stage: int = 0

    def after(self, more: np.ndarray) -> SpotCheck:
        """Return the check after further probes found (N,) W/m². Their last one begins the next stage, where they differ."""
        found = np.concatenate([self.found, more])
        if len(found) < len(self.spots):
            return replace(self, found=found)
        least = np.where(self.spots.at_crease, _AT_CREASES[self.stage], _SIGNIFICANT[self.stage])
        return SpotCheck(self.spots[self.spots.difference(found) > least], stage=self.stage + 1)
