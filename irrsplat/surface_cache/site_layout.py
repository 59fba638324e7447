"""Layout of the sites of a surface cache: a few thousand points that represent all surfaces, and the cells for their lookup.

The surfaces are cut into cells. Members are the corners of cells on both sides of each surface. Close members with similar
normals form a cluster. One member of the cluster is the site of all members that are visible from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from irrsplat.core.buffers import Sites
from irrsplat.core.glsl import TABLE_COLUMNS
from irrsplat.core.timing.background import Steps, in_background
from irrsplat.core.vectors import sphere
from irrsplat.core.vertex_layout import vertex_column
from irrsplat.gather.record_frame import offset_of
from irrsplat.scene.appearance import flatten, in_order
from irrsplat.scene.emitters import unlit_interiors
from irrsplat.scene.model import Scene
from irrsplat.scene.seen_by_light import CLOSED, face_counts, sort_of
from irrsplat.settings import Settings
from irrsplat.surface_cache import clustering
from irrsplat.surface_cache.clustering import Clusters
from irrsplat.surface_cache.tessellation import Graded, Grading, tessellate

POINTS = 4000, 16_000  # least and greatest number of cell corners on all surfaces, about; as many as triangles in between
_STEPS = 9.0  # least number of steps along the extent of the surroundings of an eye
_ROUNDS = 4  # rounds of clustering; members that do not see their cluster's site form clusters in the next round
_ALTERNATIVES = 10  # near sites that are tried for a member without a site of its own
# of `most`: sites of the first round, about and at most; members that see none get the remaining
_FIRST_SHARE = 0.6, 0.7
_MERGED = 0.25  # of the spacing: distance of points of very small triangles that form one member
VOXEL = 0.7  # of the spacing: width of the voxels of clusters
_CLOSE = 1 / 16  # of that width: closer members of a coarse level are one member
_PLACES = 31  # greatest number of eyes, and of lights and emitters, with fine cells around them
_FREE = 100.0  # heights of a record's eye: least extent of the surroundings of a camera that is not in a wall
_STEEP_PLACES = 512  # greatest number of lights and parts of emitters with fine cells around them
_DIRECTIONS = 64  # directions in which the surroundings of a light or camera are measured
SEGMENTS = 16 * TABLE_COLUMNS  # of one batch of lines of sight, at most
_BEFORE = 0.9  # of the visible shares of two edges: the place that is tested for a recess


@dataclass(frozen=True)
class Detail:
    """The density of a surface cache: its share of the sites, and of the rays of each site.

    level: -1 for a coarse level, 0 for the level of the settings, more for finer levels. most: the greatest number of sites.
    fewest: its share of the least number of sites, which carry all light behind a corner.
    """

    points: float = 1.0
    rays: float = 1.0
    level: int = 0
    most: int = 1 << 15
    fewest: float = 1.0

    def refined(self, level: int) -> Detail:
        """Return the density of a finer level, with twice the sites of the level before. Their transport takes some 80 MB."""
        return Detail(self.points * 2.0**level, self.rays, level, 2 * self.most)


# 15 % of the rays: its light at pixels is 8, 14 and 13 % off in cornell, door and atrium. With half as many sites at most, the
# error is twice as large, for a tenth of the time
COARSE = Detail(0.15, 1.0, -1, 4000, 0.5)
MAX_LEVEL = 2  # the finest level, whose tables take some hundred megabytes
_FINE = 64  # side of a gather from which the surface cache is full
_LEAST = 0.2  # of the sites, however few rays a gather has
_LEAST_RAYS = 0.6  # of the rays of each site: with fewer, few sites add their noise to all records


def detail_for(settings: Settings) -> Detail:
    """Return the density for records by these settings: coarse gathers need few sites with fewer rays each."""
    share = min(max(settings.gather_size / _FINE, _LEAST), 1.0)
    return Detail(share, max(share, _LEAST_RAYS))


@dataclass(frozen=True)
class SiteLayout:
    """The S sites of a surface cache, and the cells of the lookup.

    area: (S,) area of the surface that each site represents, m². level: (S,) of its cluster, see Clusters. grading: of the cells.
    triangles: see Tessellation.table. cells: (C + H, 2, 4) float32. For each side of the C cells: numbers of the sites of the
    corners (-1: none), and 0 if all corners see each other. Otherwise an object occludes part of the cell, and the last number is
    that of one of the H further rows. These rows have the lines beyond which corners are hidden, see _borders.
    """

    sites: Sites
    area: np.ndarray
    level: np.ndarray
    grading: Grading
    triangles: np.ndarray
    cells: np.ndarray


@dataclass(frozen=True)
class SiteChooser:
    """Choice of the sites of a scene, step by step.

    reach: the visible share of segments, see RayCaster.reach. detail: the density of the surface cache. eyes: (N, 3) metres, of
    the views that it lights.
    """

    scene: Scene
    reach: Callable[[np.ndarray, np.ndarray], np.ndarray]
    detail: Detail
    eyes: np.ndarray

    @property
    def offset(self) -> float:
        """Height of a record's eye above its surface, metres."""
        return offset_of(self.scene)

    def layout(self) -> Steps[SiteLayout]:
        """Choose the sites: all steps in their order."""
        grading = yield from self.grading()
        clusters = yield from in_background(partial(self.clusters, grading))
        chosen, site = yield from self._assign(clusters)
        yield
        area = np.bincount(site[site >= 0], clusters.area[site >= 0], len(chosen))
        cells = yield from self._cells(clusters, site)
        return SiteLayout(clusters.members[chosen], area, clusters.level[chosen], grading, clusters.tessellation.table, cells)

    def grading(self) -> Steps[Grading]:
        """Return the grading for the eyes, except those in walls, and for lights and emitters."""
        eyes, others = _some(self.eyes), _some(_lights(self.scene))
        rooms = yield from self.rooms(np.concatenate([eyes, others]))
        free = np.flatnonzero(rooms[: len(eyes)] >= self.least_room)
        own, of_others = rooms[free], rooms[len(eyes) :]
        if len(free):  # the middle of a luminous dome has vast surroundings
            of_others = np.minimum(of_others, 2.0 * np.median(own))
        return Grading(np.concatenate([eyes[free], others]), np.concatenate([own, of_others]), len(free))

    @property
    def least_room(self) -> float:
        """Metres, the least extent of the surroundings of an eye that is not in a wall or on a surface."""
        return _FREE * self.offset

    def rooms(self, places: np.ndarray) -> Steps[np.ndarray]:
        """Return (N,) metres: the upper quartile of distances from `places` (N, 3) to surfaces."""
        far = self.scene.diagonal
        starts = np.repeat(places, _DIRECTIONS, axis=0)
        reach = yield from self._free_shares(starts, starts + far * np.tile(sphere(_DIRECTIONS), (len(places), 1)))
        rooms = [np.quantile(one[one < 1.0], 0.75) if (one < 1.0).any() else 1.0 for one in reach.reshape(-1, _DIRECTIONS)]
        return far * np.array(rooms)

    def clusters(self, grading: Grading) -> Clusters:
        """Tessellate the surfaces that light sees, and cluster the corners.

        The spacing follows from the area of the surfaces, in which distant ones count less. Where too many sites would result,
        distant clusters grow as their steps do. If this is not enough, all clusters have a wider spacing than the steps, which
        saves a second tessellation.
        """
        vertices, faces = flatten(self.scene)
        faces = faces[: face_counts(self.scene).lit]
        graded, whole = grading.graded(vertex_column(vertices, "position")[faces])
        room = float(np.median(grading.rooms[: grading.eyes])) if grading.eyes else np.inf
        # a coarse level lights the first pictures: twice the time would delay them
        requested = len(faces) if self.detail == COARSE else max(len(faces), 2.0 * whole * (_STEPS / room) ** 2)
        corners = float(np.clip(requested, self.detail.fewest * POINTS[0], POINTS[1])) * self.detail.points
        spacing = float(np.sqrt(2.0 * whole / corners)) or 1.0  # a grid of right-angled triangles has two points per spacing²
        meshes = in_order(self.scene)
        mesh = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
        emits = np.array([any(one.material.emission) for one in meshes], bool)[mesh[: len(faces)]]
        lights = _steep_places(self.scene, vertices, faces[emits], spacing, graded[emits])
        tessellation = tessellate(vertices, faces, spacing, self.offset, lights, ~emits, graded)
        points, which = clustering.merged(tessellation, mesh, _MERGED * spacing)
        members, member = clustering.both_sides(tessellation, points), np.stack([which, len(points) + which])
        area = np.bincount(member.ravel(), weights=np.tile(tessellation.area, 2), minlength=len(members))
        columns = tessellation.level, mesh[tessellation.face], np.log2(tessellation.wider).astype(np.intp)
        level, of_mesh, farther = (np.tile(of[points], 2) for of in columns)
        doublings = min(int(farther.max(initial=0)), clustering.MOST_DOUBLINGS)
        inner = np.arange(len(members)) >= len(points)
        within = inner & np.array([sort_of(one) == CLOSED for one in meshes], bool)[of_mesh]  # the inner sides of closed meshes
        lit = ~(inner & np.array(unlit_interiors(self.scene), bool)[of_mesh])
        low, high = self.scene.bounds
        farthest = np.where(members.geometric > 0.0, high, low) - clustering.eyes(members, slice(None), self.offset)
        # no ray hits a surface above the whole scene, or one without area and normal, as in hidden meshes
        lit &= (farthest * members.geometric).sum(1) > 0.0
        left = np.flatnonzero(lit)
        about, most = (share * self.detail.most for share in _FIRST_SHARE)
        while True:
            keys = clustering.voxel_keys(members.position, members.normal, VOXEL * spacing, level, within)
            clusters = Clusters(tessellation, members, keys, spacing, area, of_mesh, member, lit, level)
            sites = len(clusters.choose(left, len(left), small=False)[0])
            if sites <= most:
                break
            if doublings:  # the corners of a thousand distant houses must not take the sites of a room
                level, farther, doublings = level - (farther > 0), farther - 1, doublings - 1
                continue
            spacing *= 1.05 * float(np.sqrt(sites / about))
        return clusters.merged(_CLOSE * VOXEL * spacing) if self.detail == COARSE else clusters

    def _assign(self, clusters: Clusters) -> Steps[tuple[np.ndarray, np.ndarray]]:
        """Choose sites among lit members, and assign each member to a visible site of its cluster, or a near one.

        Return the members (S,) that are sites, and (M,) the number of each member's site; -1 for members without light.
        """
        members, site = clusters.members, np.full(len(clusters.members), -1)
        left, sites = np.flatnonzero(clusters.lit), np.zeros(0, np.intp)
        for number in range(_ROUNDS):
            choosing = partial(clusters.choose, left, self.detail.most - len(sites), small=number == _ROUNDS - 1)
            chosen, site_of = yield from in_background(choosing)
            chosen = left[chosen]
            pending = np.flatnonzero(site_of >= 0)
            seen = np.zeros(len(left), bool)
            seen[pending] = yield from self.see(members, left[pending], chosen[site_of[pending]])
            site[left[seen]] = len(sites) + site_of[seen]
            left, sites = left[~seen], np.concatenate([sites, chosen])
        site[left] = yield from self._near(clusters, left, sites)
        return sites, site

    def _near(self, clusters: Clusters, left: np.ndarray, gathered: np.ndarray) -> Steps[np.ndarray]:
        """Return (N,) a near site for each of the members `left` (N,): the nearest visible one, else the nearest; -1: none.

        gathered: the members that are sites. Without this step, small objects beyond the number of sites are black: a room full
        of them lost a third of its second bounce.
        """
        members, size = clusters.members, VOXEL * clusters.spacing
        near = yield from in_background(partial(clustering.near_sites, members, left, gathered, size, _ALTERNATIVES))
        found = np.full(len(left), -1)
        for site in near.T:
            pending = np.flatnonzero((found < 0) & (site >= 0))
            seen = yield from self.see(members, left[pending], gathered[site[pending]])
            found[pending[seen]] = site[pending[seen]]
        # the two sides of a small emitter are close, and only one side is bright
        alike = (near >= 0) & (clusters.within[gathered[near]] == clusters.within[left][:, None])
        nearest = near[np.arange(len(near)), alike.argmax(1)]
        return np.where((found < 0) & alike.any(1), nearest, found)

    def _cells(self, clusters: Clusters, site: np.ndarray) -> Steps[np.ndarray]:
        """Return SiteLayout.cells by the `site` (M,) of each member."""
        members = clusters.members
        table = [np.zeros((len(clusters.tessellation.corners), 2, 4), np.float32)]
        for side, cells in enumerate(table[0].swapaxes(0, 1)):
            corners = clusters.member[side][clusters.tessellation.corners]
            cells[:, :3] = site[corners]
            unlike = np.flatnonzero((site[corners] != site[corners[:, :1]]).any(1))
            pairs = np.sort(corners[unlike][:, [[1, 2], [2, 0], [0, 1]]], axis=-1)  # opposite to each corner
            key, pair = np.unique(pairs[..., 0] * len(members) + pairs[..., 1], return_inverse=True)
            seen = yield from self.see(members, *np.divmod(key, len(members)))
            free = seen[pair.reshape(-1, 3)]  # True at a corner if the other two corners see each other
            hidden = ~free.all(1)
            unlike, free = unlike[hidden], free[hidden]
            cells[unlike, 3] = sum(map(len, table)) + np.arange(len(unlike))
            reach = yield from self._reach(members, corners[unlike], free)
            recess = yield from self._recesses(members, corners[unlike], reach)
            table.append(_borders(reach, free, recess))
        return np.concatenate(table)

    def _reach(self, members: Sites, cells: np.ndarray, free: np.ndarray) -> Steps[np.ndarray]:
        """Return (N, 3, 2) the visible shares of a cell's edges, from each corner to the next two corners; inf for free
        edges.

        cells: (N, 3) the members at the corners. free: (N, 3) of each corner, whether the other two see each other.
        """
        reach = np.full((len(cells), 3, 2), np.inf)
        corners, steps = np.indices((3, 2)).reshape(2, -1)
        ends = (corners + 1 + steps) % 3
        cell, way = np.nonzero(~free[:, 3 - corners - ends])
        a, b = cells[cell, corners[way]], cells[cell, ends[way]]
        straight = yield from self._free_shares(*(clustering.eyes(members, at, self.offset) for at in (a, b)))
        raised = yield from self._free_shares(*clustering.raised_lines(members, a, b, self.offset))
        reach[cell, corners[way], steps[way]] = np.minimum(straight, raised)
        return reach

    def _recesses(self, members: Sites, cells: np.ndarray, reach: np.ndarray) -> Steps[np.ndarray]:
        """Return (N, 3) True for corners that alone see the place as far as visible along both edges, as in the corner of a room.

        cells: (N, 3) the members at the corners. reach: from _reach.
        """
        found: np.ndarray = np.isfinite(reach).all(2)
        cell, corner = np.nonzero(found)
        a, b, c = (clustering.eyes(members, cells[cell, (corner + step) % 3], self.offset) for step in range(3))
        along, across = (_BEFORE * reach[cell, corner, step][:, None] for step in range(2))
        place = a + along * (b - a) + across * (c - a)
        seen = yield from self._free_shares(np.concatenate([a, b, c]), np.tile(place, (3, 1)))
        by_a, by_b, by_c = seen.reshape(3, -1) >= 1.0
        found[cell, corner] = by_a & ~by_b & ~by_c
        return found

    def see(self, members: Sites, a: np.ndarray, b: np.ndarray) -> Steps[np.ndarray]:
        """Return (N,) True where members a see members b (N,)."""
        seen = np.ones(len(a), bool)
        apart = np.flatnonzero(a != b)
        starts, ends, bent = clustering.sight_lines(members, a[apart], b[apart], self.offset)
        free = (yield from self._free_shares(starts, ends)) >= 1.0
        first, second = free[: len(apart)], free[len(apart) :]
        seen[apart] = first
        seen[apart[bent]] &= second
        first[bent] = False
        flat = apart[first]
        seen[flat] = (yield from self._free_shares(*clustering.raised_lines(members, a[flat], b[flat], self.offset))) >= 1.0
        return seen

    def _free_shares(self, starts: np.ndarray, ends: np.ndarray) -> Steps[np.ndarray]:
        """Return (N,) the visible share of segments, see RayCaster.reach; pause after each batch."""
        free = np.ones(len(starts), np.float32)
        for first in range(0, len(starts), SEGMENTS):
            some = slice(first, first + SEGMENTS)
            free[some] = self.reach(starts[some], ends[some])
            yield
        return free


def _lights(scene: Scene) -> np.ndarray:
    """Return (N, 3) metres, the places of the scene's lights and emitters."""
    lights = [light.position for light in scene.lights if not light.directional]
    emitters = [mesh.positions.mean(0) for mesh in scene.meshes if any(mesh.material.emission) and len(mesh.positions)]
    return np.array([*lights, *emitters], float).reshape(-1, 3)


def _some(places: np.ndarray) -> np.ndarray:
    """Return at most _PLACES of these places (N, 3), at equal steps of their numbers."""
    return places[:: -(-len(places) // _PLACES) or 1]


def _steep_places(scene: Scene, vertices: np.ndarray, emissive: np.ndarray, spacing: float, graded: Graded) -> np.ndarray:
    """Return (K, 4) places where light is steep: of lights and of parts of emitters, and sizes in metres, 0 for a point light.

    emissive: (F, 3) the triangles of emitters. Each voxel with emitters is one part. Light is steep near the rim of a panel, too,
    so that the size of a part is at most half of a voxel.
    """
    lights = [[*light.position, 0.0] for light in scene.lights if not light.directional]
    cells, width = tessellate(vertices, emissive, spacing, 0.0, graded=graded), VOXEL * spacing
    _, voxel = np.unique(np.floor(cells.position / width).astype(np.int64), axis=0, return_inverse=True)
    weights = np.maximum(cells.area, 1e-30)
    area = np.bincount(voxel.ravel(), weights)
    at = [np.bincount(voxel.ravel(), weights * x) / area for x in cells.position.T]
    size = np.minimum(area / width, 0.5 * width)  # the width of a strip, or less
    found = np.concatenate([np.reshape(lights, (-1, 4)), np.stack([*at, size], axis=1)])
    return found[:: -(-len(found) // _STEEP_PLACES) or 1]


def _borders(reach: np.ndarray, free: np.ndarray, recess: np.ndarray) -> np.ndarray:
    """Return (N, 2, 4) float32, the rows of SiteLayout.cells that bound the part of a cell that sees each corner.

    reach, free, recess: from SiteChooser._reach and _recesses. A corner is hidden beyond a line through the occluder on two
    edges. There, weights of the next two corners, times their numbers in the first and the second texel, sum to more than 1. For
    a recess the greater of both products counts, and its first number is negative. If only one pair of corners see each other,
    the first texel ends with the number of the third corner, and the pair is visible beyond the third corner's line. Else the
    texel ends with 3. That line lies halfway between the reaches from either side.
    """
    rows = np.zeros((len(reach), 2, 4))
    rows[:, :, :3] = (1.0 / np.maximum(reach, 1e-6)).swapaxes(1, 2)
    rows[:, 0, 3] = alone = np.where(free.sum(1) == 1, np.argmax(free, axis=1), 3)
    for k in range(3):
        chosen, a, b = np.flatnonzero(alone == k), (k + 1) % 3, (k + 2) % 3
        ends = 0.5 * (reach[chosen, k] + 1.0 - np.stack([reach[chosen, a, 1], reach[chosen, b, 0]], axis=1))
        rows[chosen, :, k] = 1.0 / np.maximum(ends, 1e-6)
    rows[:, 0, :3] *= np.where(recess, -1.0, 1.0)
    return rows.astype(np.float32)
