"""Examination: finds pixels that request a record, by missing coverage or by inter-record variance (Jones 2010, section 2.3).

The screen is divided into tiles of a hundredth of its height. The GPU finds the pixel of least weight in each tile, and returns
them as one small table. `choose` selects the sites of a round from this table: coarse to fine, on a chessboard.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Sites, SplatBuffer, Uniforms
from irrsplat.core.vectors import octahedral_decode
from irrsplat.gather.spot_check import Spots
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.gpu.target import Target
from irrsplat.scene.model import Camera, Part, measure
from irrsplat.settings import Settings

_FEW = 64  # tiles that request a record: so few get one each at once, without going from coarse to fine
_TILES = 100  # tiles along the picture's height (see `measure`)


def tile_side(size: tuple[int, int], pixel_stride: int) -> int:
    """Return the side of a tile in pixels that have sums, in a picture of `size` (width, height).

    pixel_stride: of the pixels with sums. A tile is about equally wide on screen for every stride.
    """
    return max(2, max(2, int(measure(size)) // _TILES) // pixel_stride)


def tile_count(size: tuple[int, int], pixel_stride: int) -> tuple[int, int]:
    """Return the number of tiles of a picture, (across, up)."""
    side = tile_side(size, pixel_stride)
    width, height = (math.ceil(math.ceil(length / pixel_stride) / side) for length in size)
    return width, height


@dataclass(frozen=True)
class Examination:
    """The result of a round's examination, per tile (h, w).

    requests, seen: numbers of pixels that request a record, and that show a surface. position, normal (h, w, 3): of the pixel
    of least weight, a site for a record. geometric (h, w, 3): its geometric normal. triangle, weight (h, w): number of its
    triangle, and its Σw.
    """

    requests: np.ndarray
    seen: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    geometric: np.ndarray
    triangle: np.ndarray
    weight: np.ndarray

    @property
    def missing(self) -> float:
        """The under-covered share of the surface pixels, 0..1."""
        return float(self.requests.sum(dtype=float) / max(self.seen.sum(dtype=float), 1.0))

    def at(self, tiles: tuple[np.ndarray, np.ndarray]) -> Sites:
        """Return the sites of the given tiles (rows, columns)."""
        return Sites(self.position[tiles], self.normal[tiles], self.geometric[tiles], self.triangle[tiles].astype(np.intp))


@dataclass(frozen=True, eq=False)
class Screen:
    """A view by a `camera` for the examination: the `size` (width, height) of its picture, with sums at every `pixel_stride`-th
    pixel.

    sums: an object that differs if the sums differ. examine: returns the examination by settings. spots: finds the positions
    for a spot check, if all pixels have sums; True for those of a further check. gbuffer, splats: those of a view without tiles.
    """

    camera: Camera
    size: tuple[int, int]
    pixel_stride: int
    sums: object
    examine: Callable[[Settings], Examination]
    spots: Callable[[bool], Spots]
    gbuffer: GBuffer | None = None
    splats: SplatBuffer | None = None

    def requested(self, sites: Sites) -> Sites:
        """Return the sites as requested by this view."""
        return replace(sites, screen=self.camera.measure_at(sites.position, self.size))


class ExaminePass(Owner):
    """A pass that finds the pixels of a view that request a record."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        # by whether the view is refined
        self.programs = [self.own(Program(ctx, "indirect/examine", "lib/fullscreen", {"REFINED": refined})) for refined in (0, 1)]
        self.targets = self.own(Workshop())

    def __call__(self, gbuffer: GBuffer, splats: SplatBuffer, settings: Settings, part: Part | None = None) -> Examination:
        """Return every tile's count of pixels that request a record, by `tolerance` and `spread`, and its pixel of least weight.

        part: the part of the picture that the buffers hold, which begins at a tile's corner; None for the whole picture.
        """
        size, stride = gbuffer.position.size, splats.pixel_stride
        part = part or Part(size, (0, 0), size)
        side = tile_side(part.whole, stride)
        # first pixel of the picture and pixel after the last, in pixels of the sums
        begin = [-(at // stride) for at in part.corner]
        end = tuple(-(-n // stride) + at for n, at in zip(part.whole, begin, strict=True))
        tiles = -(-splats.weight.width // side), -(-splats.weight.height // side)
        target = self.targets.get("target", tiles, lambda: Target(self.ctx, tiles, (4, 4, 4)))
        refined: Uniforms = {} if splats.reach is None else {"reach": splats.reach}
        self.programs[int(splats.reach is not None)](
            target,
            pixel_stride=splats.pixel_stride,
            side=side,
            first_tile=tuple(-first // side for first in begin),
            begin=tuple(begin),
            end=end,
            **gbuffer.surface_uniforms,
            **gbuffer.material_uniforms,
            weight=splats.weight,
            sums=splats.sums,
            **refined,
            spread=settings.spread,
            luminance_floor=splats.luminance_floor,
            step_size=_stride(side**2),
            tolerance=settings.threshold,
            seed=settings.seed,
        )
        position, normal, rest = (target.read(i) for i in range(3))
        geometric = octahedral_decode(normal[..., 3], rest[..., 0])
        triangle, weight = rest[..., 3], rest[..., 1]
        return Examination(position[..., 3], rest[..., 2], position[..., :3], normal[..., :3], geometric, triangle, weight)


def _stride(count: int) -> int:
    """Return a number coprime to `count`, near its golden section: such steps visit all places, and successive places lie
    apart."""
    requested = max(1, round(0.618 * count))
    return next(n for n in range(requested, requested + count + 1) if math.gcd(n, count) == 1)


def chessboard(step: int, reach: float, requests: int) -> tuple[int, int]:
    """Return the width of squares of tiles that get one record each in step 0, 1, 2, … of a view, and their colour.

    The squares form a chessboard; those of one colour, 0 or 1, are in use. Colour -1 stands for both, in the last rounds, when
    each site has records around it. The squares shrink from the farthest reach of a record (`reach`, in tiles) to two tiles, with
    two steps for each width; then come those of two tiles of both colours, or single tiles where few request a record. A view
    with few requests from the start, for example after a small move of the camera, begins with these.
    requests: the number of tiles that request a record.
    """
    levels = 0 if requests < _FEW else max(int(math.log2(max(reach, 1.0))), 0)
    if step < 2 * levels:
        return 2 ** (levels - step // 2), step % 2
    return 1 if requests < _FEW else 2, -1


def choose(requests: np.ndarray, side: int, colour: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the (rows, columns) of the chosen tiles: a random tile with requests > 0 in each used square, see `chessboard`.

    The tiles come in random order, so that the first few are spread over the screen.
    """
    height, width = requests.shape
    rows, columns = np.nonzero(requests > 0)
    squares = (rows // side) * -(-width // side) + columns // side
    if colour >= 0:
        mine = (rows // side + columns // side) % 2 == colour
        rows, columns, squares = rows[mine], columns[mine], squares[mine]
    order = np.random.default_rng((seed, side, colour + 1)).permutation(height * width)[rows * width + columns]
    pick = np.lexsort((order, squares))
    _, first = np.unique(squares[pick], return_index=True)
    chosen = pick[first][np.argsort(order[pick[first]])]
    return rows[chosen], columns[chosen]
