"""Gaps: places of a view with something close above their surface that faces it, found by rays.

Records in the open reach into a gap lower than the height at which a record may lie in front of a pixel. They know nothing of it,
and agree with each other, so that no pixel in it would ask for a record. One that lies there contradicts them, and they draw
back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from irrsplat.core.buffers import GBuffer, Sites
from irrsplat.core.errors import InputError
from irrsplat.core.timing.beside import started
from irrsplat.core.vectors import octahedral_decode
from irrsplat.gather.record_frame import offset_of
from irrsplat.gather.squares import Squares
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.gpu.target import Target, pixels
from irrsplat.gpu.time_budget import Budget, Pace
from irrsplat.gpu.world import World
from irrsplat.scene.model import Camera, part_drawn
from irrsplat.settings import IN_FRONT, Settings

_APART = 0.0125  # of the image height: about how far sites lie apart
_NEAR = 2.0  # times the gap's height: where a record lies so near, and no higher than half of it, no other is wanted
_NEIGHBOURS = 4  # records that are looked at about each place
_RAYS = 9  # of a pixel
_FINE = 250  # rows of squares, of which one pixel each is looked at
_REACH = 8.0  # percent of the image height: the greatest reach where the settings have no limit


def _nearest() -> Any:
    """The class of trees of points that find those nearest to others."""
    from scipy.spatial import cKDTree

    return cKDTree


@dataclass(frozen=True)
class Gaps:
    """The pixels of a view that lie in gaps, as `sites` for records. height: (N,) of the gaps, metres. apart: (N,) metres, how
    far records are to lie apart there."""

    sites: Sites
    height: np.ndarray
    apart: np.ndarray

    @staticmethod
    def joined(parts: Sequence[Gaps]) -> Gaps:
        """The gaps of all parts of a view."""
        height, apart = (np.concatenate([getattr(part, name) for part in parts]) for name in ("height", "apart"))
        return Gaps(Sites.joined([part.sites for part in parts]), height, apart)

    def without(self, records: np.ndarray) -> Sites:
        """Sites for gaps in which none of the `records` (N, 3), metres, lies near: one in each cube as wide as they lie apart.

        The order of the pixels makes no difference.
        """
        sites, bare = self.sites, np.ones(len(self.sites), bool)
        if len(sites) and len(records):
            count = min(_NEIGHBOURS, len(records))
            number = _nearest()(records).query(sites.position, count)[1].reshape(len(sites), count)
            away = records[number] - sites.position[:, None]
            above, height = np.einsum("nkx,nx->nk", away, sites.geometric), self.height[:, None]
            bare = ~((np.linalg.norm(away, axis=-1) < _NEAR * height) & (np.abs(above) < 0.5 * height)).any(1)
        sites, apart = sites[bare], self.apart[bare]
        if not len(sites):
            return sites
        sites = sites[np.lexsort((*sites.normal.T, *sites.position.T))]
        cubes = np.floor(sites.position / apart.max()).astype(np.int64)
        return sites[np.unique(cubes, axis=0, return_index=True)[1]]


@dataclass(frozen=True)
class Search:
    """How far a search for the gaps of a view has come: `rows` of its squares are looked at. gaps: what was found, None before
    all are, and where there are none to look for."""

    rows: int
    complete: bool
    gaps: Gaps | None = None


NOTHING_TO_FIND = Search(0, True)


class GapPass(Owner):
    """Looks for gaps in views of `size` (width, height)."""

    def __init__(self, world: World, size: tuple[int, int]) -> None:
        self.world, self.size = world, size
        self.program = Program(world.ctx, "indirect/gaps", "lib/fullscreen", world.material_defines)
        self.targets = Workshop()
        self._pace = Pace(world.ctx)  # of rows
        started(_nearest)  # its import takes half a second, and the search many ticks

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.program, self.targets)

    def __call__(self, gbuffer: GBuffer, camera: Camera, settings: Settings, start: int, budget: Budget) -> Search:
        """Look for the gaps of a view, or of the part of it that `camera` draws, from row `start` on, as far as the budget goes.
        Of a large picture one pixel of each small square is looked at, as sites in gaps lie some pixels apart anyway.

        The rows before it have to be of the last call. Where a scene has too many triangles for rays, there is nothing to find.
        """
        try:
            rays = self.world.ray_uniforms
        except InputError:
            return NOTHING_TO_FIND
        squares = Squares.of(part_drawn(camera, self.size), _FINE)
        (width, height), size = squares.size, squares.most(self.size)
        target = self.targets.get("target", size, lambda: Target(self.world.ctx, size, (1,)))
        for rows in self._pace.batches(height - start, height, budget, width * _RAYS):
            self.program(
                target,
                scissor=(0, start, width, rows),
                position=gbuffer.position,
                normal=gbuffer.normal,
                albedo=gbuffer.albedo,
                **squares.uniforms,
                eye=camera.eye,
                height=IN_FRONT / settings.a * (settings.radius_max or _REACH) / 100.0 * camera.measure(self.size),
                near=offset_of(self.world.scene),
                **rays,
            )
            start += rows
        complete = start == height
        return Search(start, complete, self._found(target, gbuffer, camera, squares) if complete else None)

    def _found(self, target: Target, gbuffer: GBuffer, camera: Camera, squares: Squares) -> Gaps:
        """The gaps, once all rows are looked at."""
        width, height = squares.size
        found = target.read()[::-1, :, 0][:height, :width]
        which = np.nonzero((found > 0.0) & squares.inside)
        x, y = (squares.pixels[which] - squares.part.corner).T
        at, gap = (self.size[1] - 1 - y, x), found[which]
        textures = gbuffer.position, gbuffer.normal, gbuffer.albedo, gbuffer.emission
        none = np.zeros((0, 4), "f4")  # reading a large picture's buffers back takes longer than the search
        position, normal, albedo, emission = (pixels(texture)[at] if len(gap) else none for texture in textures)
        geometric, triangle = octahedral_decode(normal[:, 3], albedo[:, 3]), emission[:, 3].astype(np.intp)
        distance = np.linalg.norm(position[:, :3] - np.asarray(camera.eye, "f4"), axis=1)
        sites = Sites(position[:, :3], normal[:, :3], geometric, triangle)
        return Gaps(sites, gap, _APART * camera.measure(self.size) * distance)
