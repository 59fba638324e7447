"""More sites where light changes: cells whose corners differ most are cut into four, and their corners get sites of their own."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from irrsplat.core.buffers import Sites
from irrsplat.core.timing.beside import beside
from irrsplat.core.vectors import triangle_areas
from irrsplat.core.vertex_layout import PARTS, WIDTH
from irrsplat.surface_cache import clustering
from irrsplat.surface_cache.site_layout import DARK_VALUE, FIRST_SITE, MAX_REFINED_SITES, VOXEL, Clusters, SiteChooser, SiteLayout
from irrsplat.surface_cache.tessellation import Tessellation, cell_corners, tessellate

_HALVES = 2  # steps along the side of a cell that is cut
_SAME = 0.25  # of the new spacing: how near to a site a corner is served by it
_ALIKE = 0.95  # cosine between the normals of both
_OF_CELL, _IN_VOXEL = 1.8, 0.7  # further sites of a cell that is cut, and of the first one in a voxel that is too small for that
_LEVELS = 5  # how often a cell is cut at most
_SPLIT = 0.5  # work done


@dataclass(frozen=True)
class Leaves:
    """The K sides of cells that are not cut. row, side: (K,) where SiteLayout.cells has them. corners, normals: (K, 3, 3).
    face: (K,) their triangles. level: (K,) how often they were cut."""

    row: np.ndarray
    side: np.ndarray
    corners: np.ndarray
    normals: np.ndarray
    face: np.ndarray
    level: np.ndarray

    def __len__(self) -> int:
        return len(self.row)

    def __getitem__(self, rows: np.ndarray) -> Leaves:
        return Leaves(*(values[rows] for values in vars(self).values()))

    def and_more(self, others: Leaves) -> Leaves:
        """These, then the others."""
        return Leaves(*(np.concatenate(pair) for pair in zip(vars(self).values(), vars(others).values(), strict=True)))


def leaves_of(tessellation: Tessellation) -> Leaves:
    """All sides of all cells."""
    count, corners = tessellation.cells, cell_corners(tessellation)
    normals, face = tessellation.normal[tessellation.corners], tessellation.face[tessellation.corners[:, 0]]
    row, side = np.tile(np.arange(count), 2), np.repeat([0, 1], count)
    corners, normals, face = (np.concatenate([values] * 2) for values in (corners, normals, face))
    return Leaves(row, side, corners, normals, face, np.zeros(2 * count, np.intp))


@dataclass(frozen=True)
class SplitLayout:
    """A layout, and the sides of its cells that may be cut (further)."""

    layout: SiteLayout
    leaves: Leaves


def uncut(layout: SiteLayout) -> SplitLayout:
    """A layout of which no cell is cut."""
    return SplitLayout(layout, leaves_of(layout.tessellation))


def unevenness(values: np.ndarray, E: np.ndarray) -> np.ndarray:
    """(K,) W/m²: how much light changes around the sides of cells at whose corners are these `values` (K, 3), by E (S, 3).

    Of each site it is the greatest difference from a site that shares a cell with it; of a cell's side the greatest of its
    corners'.
    """
    found = np.zeros(len(E))
    for one, other in ((0, 1), (1, 2), (2, 0)):
        a, b = values[:, one], values[:, other]
        both = (a >= FIRST_SITE) & (b >= FIRST_SITE)
        a, b = a[both], b[both]
        apart = np.abs(E[a] - E[b]).max(1)
        np.maximum.at(found, a, apart)
        np.maximum.at(found, b, apart)
    of_values: np.ndarray = np.where(values >= FIRST_SITE, found[np.maximum(values, 0)], 0.0).max(1)
    return of_values


@dataclass(frozen=True)
class SiteSplitter:
    """Cuts the cells of a layout that `chooser` has made where the light E (S, 3) changes most, for about `more` further
    sites."""

    chooser: SiteChooser
    E: np.ndarray
    more: int

    def split(self, given: SplitLayout) -> Generator[float, None, SplitLayout]:
        """The layout with further sites, whose numbers follow those that there are."""
        asking = yield from beside(partial(self._asking, given), _SPLIT)
        for level in range(_LEVELS):
            chosen = asking[given.leaves.level[asking] == level]
            if len(chosen):
                given = yield from self._cut(given, chosen, 0.5 ** (level + 1) * given.layout.spacing)
        area = _areas(given)
        return replace(given, layout=replace(given.layout, area=area))

    def _asking(self, given: SplitLayout) -> np.ndarray:
        """(N,) the leaves to be cut: those where light changes most, times their area's share."""
        leaves, layout = given.leaves, given.layout
        values = layout.cells[leaves.row, leaves.side, :3].astype(np.intp)
        share = 0.25 ** leaves.level.astype(float)
        changes = np.where(leaves.level < _LEVELS, unevenness(values, self.E) * share, 0.0)
        order = np.argsort(-changes, kind="stable")[: np.count_nonzero(changes > 0.0)]
        count = int(np.searchsorted(np.cumsum(self._further(given, order)), self.more))
        order = order[:count]
        return np.sort(order)

    @staticmethod
    def _further(given: SplitLayout, order: np.ndarray) -> np.ndarray:
        """(N,) about how many further sites come of cutting each of these leaves (N,), one after the other."""
        leaves = given.leaves[order]
        spacing = given.layout.spacing * 0.5 ** (1.0 + leaves.level)
        edges = leaves.corners - np.roll(leaves.corners, 1, axis=1)
        longest = np.sqrt((edges * edges).sum(-1).max(1, initial=0.0))
        middle = (leaves.corners.mean(1) / (VOXEL * spacing)[:, None]).astype(np.int64)
        _, first = np.unique(np.column_stack([middle, leaves.side, leaves.level]), axis=0, return_index=True)
        further = np.zeros(len(order))
        further[first] = _IN_VOXEL
        further[longest > spacing] = _OF_CELL
        return further

    def _cut(self, given: SplitLayout, chosen: np.ndarray, spacing: float) -> Generator[float, None, SplitLayout]:
        """The layout with these leaves cut, or their corners' sites chosen anew, at this spacing."""
        chooser, layout, leaves = self.chooser, given.layout, given.leaves[chosen]
        vertices = np.zeros((3 * len(leaves), WIDTH), np.float32)
        vertices[:, PARTS["position"]], vertices[:, PARTS["normal"]] = (
            leaves.corners.reshape(-1, 3),
            leaves.normals.reshape(-1, 3),
        )
        # lookups go by halves; where steps were longer than was asked for, there would be more
        tessellation = tessellate(vertices, np.arange(3 * len(leaves)).reshape(-1, 3), spacing, chooser.offset, most=_HALVES)
        members = clustering.both_sides(tessellation, chooser.offset)
        keys, face = clustering.voxel_keys(members, VOXEL * spacing), np.tile(leaves.face[tessellation.face], 2)
        points = len(tessellation.face)
        clusters = Clusters(
            tessellation, members, keys, spacing, np.tile(tessellation.area, 2), face, np.arange(2 * points).reshape(2, -1)
        )
        value = chooser.known_values(clusters)
        side = np.repeat([0, 1], points)
        value[side != np.tile(leaves.side[tessellation.face], 2)] = DARK_VALUE  # the sides that are not to be cut
        yield from self._known(clusters, value, layout.sites)
        at = yield from chooser.assign(clusters, value, len(layout.sites), MAX_REFINED_SITES)
        rows = yield from chooser.cells(clusters, value)
        return _joined(given, chosen, clusters, at, rows)

    def _known(self, clusters: Clusters, value: np.ndarray, sites: Sites) -> Generator[float, None, None]:
        """Fill `value` (M,) for the members that sites of the layout serve: such as lie very near, face alike, and see them."""
        from scipy.spatial import KDTree

        members, left = clusters.members, np.flatnonzero(value < 0)
        if not len(left) or len(sites) <= FIRST_SITE:
            return
        tree = KDTree(sites.position[FIRST_SITE:])
        _, found = tree.query(members.position[left], distance_upper_bound=_SAME * clusters.spacing)
        near = found < tree.n
        left, found = left[near], found[near] + FIRST_SITE
        alike = (members.normal[left] * sites.normal[found]).sum(1) > _ALIKE
        left, found = left[alike], found[alike]
        eye = sites.position[found] + self.chooser.offset * sites.geometric[found]
        lines = np.stack([members.eye[left], 0.5 * (members.eye[left] + eye), eye], axis=1).astype(np.float32)
        seen = yield from self.chooser.free(lines, _SPLIT)
        value[left[seen]] = found[seen]


def _joined(given: SplitLayout, chosen: np.ndarray, clusters: Clusters, at: np.ndarray, rows: np.ndarray) -> SplitLayout:
    """The layout with the leaves `chosen` cut as `clusters` are, whose members `at` are further sites and whose cells are `rows`.

    A leaf that is small as it is keeps its row; the others name the first of theirs.
    """
    layout, leaves, made = given.layout, given.leaves[chosen], clusters.tessellation
    rows, first = rows.copy(), len(layout.cells)
    rows[: made.cells, :, 3] += np.where(rows[: made.cells, :, 3] > 0.0, np.float32(first), np.float32(0.0))
    cells, n = np.concatenate([layout.cells, rows]), made.table[:, 0, 3].astype(np.intp)
    cut, begin = n > 1, made.table[:, 1, 3].astype(np.intp)
    one = np.flatnonzero(~cut)
    cells[leaves.row[one], leaves.side[one]] = rows[begin[one], leaves.side[one]]
    more = np.flatnonzero(cut)
    cells[leaves.row[more], leaves.side[more], 3] = -(first + begin[more])
    new = clusters.sites(at)
    sites = Sites(*(np.concatenate([getattr(layout.sites, name), getattr(new, name)]) for name in _PARTS))
    of = made.face[made.corners[:, 0]]
    below = Leaves(
        first + np.arange(made.cells),
        leaves.side[of],
        cell_corners(made),
        made.normal[made.corners],
        leaves.face[of],
        leaves.level[of] + 1,
    )[cut[of]]
    kept = np.ones(len(given.leaves), bool)
    kept[chosen[more]] = False
    deeper = given.leaves.level.copy()
    deeper[chosen[one]] += 1
    left = replace(given.leaves, level=deeper)[kept]
    return SplitLayout(replace(layout, sites=sites, cells=cells), left.and_more(below))


_PARTS = ("position", "normal", "geometric", "triangle")


def _areas(given: SplitLayout) -> np.ndarray:
    """(S,) m² of the surface that each site stands for: a third of each cell's side for each of its corners."""
    leaves = given.leaves
    values = given.layout.cells[leaves.row, leaves.side, :3].astype(np.intp)
    area = np.repeat(triangle_areas(leaves.corners) / 3.0, 3) * (values.ravel() > DARK_VALUE)
    return np.bincount(np.maximum(values.ravel(), 0), weights=area, minlength=len(given.layout.sites)).astype(float)
