"""The spot check: a rough look from places all over a view, each held against what the records say there.

Records tell by their own disagreement where more are wanted. They agree with each other, and are wrong, in the dark between and
under small things that none of them lies at. A look along few rays tells that from each place itself; where it is far off,
others along more and more rays decide whether a record is wanted, since few rays err by much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import moderngl
import numpy as np

from irrsplat.core.buffers import GBuffer, Sites, SplatBuffer
from irrsplat.core.vectors import octahedral_decode
from irrsplat.gather.squares import Squares
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.target import Target
from irrsplat.scene.model import Camera, part_drawn

_APART = 0.018  # of the image height: at most about as far do records lie apart that one check brings
LOOKS = (4, 16, 32)  # sides of the gathers of the first looks, and of those from where the ones before contradict the records
_DOUBT = (0.55, 0.25, 0.25)  # of the greater of both luminances: what is off by more contradicts them
_ROWS = 125  # of squares, of which one pixel each is looked from; of fewer than 1.5 times as many all are
_FLOOR = 0.1  # of the mean of what records say: what is darker counts as if it were that
_CELLS = 4.0  # of how far pixels lie apart: at most as wide are the cells of places looked at
_COARSER = 3  # doublings of a place's width within which it counts as looked at from further away, too
_MOST = 2_000_000  # places that are remembered


@dataclass(frozen=True, eq=False)
class Spots:
    """Places of a view. sites: (N,), with rotations of their frames of their own. said: (N,) W/m² the luminance of E there, as
    records have it. distance: (N,) metres that pixels looked at lie apart there, on screen. rows: of the picture's height in
    these. floor: W/m², below which `said` counts as if it were that."""

    sites: Sites
    said: np.ndarray
    distance: np.ndarray
    rows: float
    floor: float = 0.0

    @staticmethod
    def joined(parts: Sequence[Spots]) -> Spots:
        """The places of all parts of a view, in an order that does not depend on how it is cut."""
        joined = Sites.joined([part.sites for part in parts])
        said, distance = (np.concatenate([getattr(part, name) for part in parts]) for name in ("said", "distance"))
        assert joined.frame_rotation is not None
        order = np.argsort(joined.frame_rotation)
        floor = _FLOOR * float(said[order].mean(dtype=float)) if len(order) else 0.0
        return Spots(joined[order], said[order], distance[order], parts[0].rows, floor)

    def __len__(self) -> int:
        return len(self.sites)

    def __getitem__(self, rows: np.ndarray) -> Spots:
        return Spots(self.sites[rows], self.said[rows], self.distance[rows], self.rows, self.floor)

    def off(self, found: np.ndarray) -> np.ndarray:
        """(N,) how far looks that `found` (N,) W/m² contradict the records, of the greater of both. Where records say that it is
        dark, brighter looks count for nothing: less than a gather's offset from a sheet, they may be of its other side."""
        share = np.abs(found - self.said) / np.maximum(np.maximum(found, self.said), max(self.floor, 1e-30))
        return np.where((found > self.said) & (self.said < self.floor), 0.0, share)

    def worst(self, off: np.ndarray) -> np.ndarray:
        """The numbers of those places that are most `off` (N,) among the ones close to them."""
        order = np.argsort(-off, kind="stable")
        cells = _cells(self.sites[order], _APART * self.rows * self.distance[order])
        found: np.ndarray = order[np.sort(np.unique(cells, return_index=True)[1])]
        return found


class SpotPass(Owner):
    """Finds the places of views of `size` (width, height) that are checked: one pixel of each small square."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.ctx, self.size = ctx, size
        self.program = Program(ctx, "indirect/spots", "lib/fullscreen")
        self.targets = Workshop()

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.program, self.targets)

    def __call__(self, gbuffer: GBuffer, splats: SplatBuffer, camera: Camera) -> Spots:
        """Those of a view, or of the part of it that `camera` draws, every pixel of which is splatted, where records say
        something and the surface reflects more than it emits."""
        squares = Squares.of(part_drawn(camera, self.size), _ROWS)
        (width, height), size = squares.size, squares.most(self.size)
        target = self.targets.get("target", size, lambda: Target(self.ctx, size, (4, 4, 4)))
        self.program(
            target,
            position=gbuffer.position,
            normal=gbuffer.normal,
            albedo=gbuffer.albedo,
            emission=gbuffer.emission,
            sums=splats.sums,
            **squares.uniforms,
        )
        position, normal, rest = (target.read(i)[::-1][:height, :width] for i in range(3))
        there = (position[..., 3] > 0.0) & squares.inside
        position, normal, rest, pixel = position[there], normal[there], rest[there], squares.pixels[there]
        geometric = octahedral_decode(normal[:, 3], rest[:, 0])
        number = pixel[:, 1] * squares.part.whole[0] + pixel[:, 0]
        sites = Sites(position[:, :3], normal[:, :3], geometric, rest[:, 2].astype(np.intp), number)
        rows = squares.part.whole[1] / squares.side
        away = np.linalg.norm(position[:, :3].astype(float) - np.asarray(camera.eye, float), axis=1)
        return Spots.joined([Spots(sites, rest[:, 1].astype(float), camera.measure(self.size) / rows * away, rows)])


@dataclass(frozen=True, eq=False)
class SpotCheck:
    """The progress of the check of a view: one value, replaced whole.

    whole: the places at its begin. spots: the places of the present looks. found: (K,) W/m² luminances at the first K of `spots`.
    stage: the number of the present looks in LOOKS.
    """

    whole: Spots
    spots: Spots
    found: np.ndarray = field(default_factory=lambda: np.zeros(0))
    stage: int = 0

    @property
    def contradicting(self) -> Spots:
        """The places where these looks disagree with the records; before the last looks, only the worst of close ones."""
        off = self.spots.off(self.found)
        there = off > _DOUBT[self.stage]
        left = self.spots[there]
        return left[left.worst(off[there])] if self.stage == len(LOOKS) - 2 else left


@dataclass(eq=False)
class PlacesChecked:
    """The places of earlier looks, so that no check repeats a look: cells of space, two to four times as wide as the distance of
    pixels, since another view's pixels lie between these. A loss of records makes them void.

    cells: (K,) ascending. records: the number of records when the places were noted, with the records that they brought.
    """

    cells: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    records: int = 0

    def forget(self) -> None:
        """Forget all places."""
        self.cells, self.records = np.zeros(0, np.int64), 0

    def forget_if_fewer(self, records: int) -> None:
        """Forget all places if so few `records` remain that some were lost."""
        if records < self.records:
            self.forget()

    def left(self, spots: Spots) -> Spots:
        """Those that no check has looked from, as closely or more so."""
        return spots[~np.isin(_cells(spots.sites, _CELLS * spots.distance), self.cells)]

    def note(self, spots: Spots, records: int) -> None:
        """These are looked from now; records: how many there are once those are gathered that this brings. Of more than can be
        remembered, the others are forgotten."""
        self.records = records
        wide = [_cells(spots.sites, _CELLS * spots.distance * 2.0**doublings) for doublings in range(_COARSER + 1)]
        cells = np.unique(np.concatenate([self.cells, *wide]))
        self.cells = cells if len(cells) <= _MOST else np.unique(np.concatenate(wide))


def _cells(sites: Sites, width: np.ndarray) -> np.ndarray:
    """(N,) int64: a number for the cell that each site lies in, as wide in metres as the next power of 2 below `width` (N,), and
    for the one of six sides that its surface faces."""
    level = np.floor(np.log2(np.maximum(width, 1e-30))).astype(np.int64)
    at = np.floor(sites.position.astype(float) / np.exp2(level.astype(float))[:, None]).astype(np.int64).astype(np.uint64)
    axis = np.abs(sites.geometric).argmax(1)
    side = 2 * axis + (np.take_along_axis(sites.geometric, axis[:, None], 1)[:, 0] < 0.0)
    number = np.zeros(len(sites), np.uint64)
    for column in (level.astype(np.uint64), side.astype(np.uint64), *at.T):
        number += column + np.uint64(0x9E3779B97F4A7C15)  # mixed as in SplitMix64 (Steele et al. 2014)
        for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
            number = (number ^ (number >> np.uint64(shift))) * np.uint64(factor)
        number ^= number >> np.uint64(31)
    return number.view(np.int64)
