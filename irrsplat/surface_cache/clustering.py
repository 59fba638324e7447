"""Clusters of points on surfaces: close points with similar normals share a site, which is one of these points.

Each point of a tessellation has two members, one on each side of its surface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from irrsplat.core.buffers import Sites
from irrsplat.surface_cache.tessellation import Tessellation

# any rotation that turns walls away from the axes
_ROTATION = np.linalg.qr(np.array([[1.0, 0.37, -0.21], [-0.29, 1.0, 0.43], [0.31, -0.47, 1.0]])).Q
_WITHIN = 62  # the bit of a key that marks an inner side
MOST_DOUBLINGS = 5  # of the size of distant clusters; a key has room for these and for 4 halvings
# Sides in steps of the blocks that near_sites searches in turn, and True if a block must have all requested sites. Blocks of 3
# steps have hundreds of sites in dense models.
_BLOCKS = (0.5, True), (1.5, True), (3.0, False), (12.0, False), (50.0, False), (400.0, False)  # the last for doubled clusters
_AT_ONCE = 16_384  # members in a batch of near_sites, each with some ten sites
_MIN_AREA = 0.02  # of the squared spacing: smaller clusters get a site only in the last round
_MIN_COSINE = 0.3  # least cosine between normals of a member and its site
_BEYOND = 1.001  # of the distance to the point between: the first segment ends behind a surface at that point
_RAISED = 0.3  # of the distance of two members: height of the second line of sight between them
_CLEARANCE = 1.2  # of the height at which tangents meet: clearance of a bent line between two members above the surface


def both_sides(tessellation: Tessellation, points: np.ndarray) -> Sites:
    """Return the `points` (N,) on their front by the winding, then on their back."""
    both = np.tile(points, 2)
    normal, geometric = (np.concatenate([n[points], -n[points]]) for n in (tessellation.normal, tessellation.geometric))
    return Sites(tessellation.position[both], normal, geometric, tessellation.face[both])


def eyes(members: Sites, at: np.ndarray | slice, offset: float) -> np.ndarray:
    """Return (N, 3) metres, points above the members `at` (N,) by the `offset` of a record's eye."""
    return members.position[at] + np.float32(offset) * members.geometric[at]


def voxel_keys(
    position: np.ndarray, normal: np.ndarray, size: float, level: np.ndarray | int = 0, within: np.ndarray | int = 0
) -> np.ndarray:
    """Return (M,) int64, equal for members in one voxel of `size` metres with normals in one of 24 parts of the sphere.

    level: (M,) how many times the size is halved, or doubled if negative. within: (M,) True for the inner sides of closed
    meshes, which have keys of their own.
    """
    low = [float(at.min(initial=np.inf)) for at in position.T]
    # + 0.37: walls often lie on round numbers, which should not be a voxel's border
    x, y, z = (
        ((at.astype(float) - least) * (2.0**level / size) + 0.37).astype(np.int64)
        for at, least in zip(position.T, low, strict=True)
    )
    normal = np.ascontiguousarray(normal.T)  # by columns: arithmetic along the short axis takes ten times as long
    a, b, c = (sum(n * share for n, share in zip(normal, column, strict=True)) for column in _ROTATION.T.astype(np.float32))
    widest = np.where(np.maximum(np.abs(b), np.abs(c)) <= np.abs(a), 0, np.where(np.abs(c) <= np.abs(b), 1, 2))
    face = 8 * widest + (a < 0.0) + 2 * (b < 0.0) + 4 * (c < 0.0)
    kind = 24 * (level + MOST_DOUBLINGS) + face
    return np.asarray((np.asarray(within, np.int64) << _WITHIN) | (((x << 19 | y) << 19 | z) << 8) | kind)


def merged(tessellation: Tessellation, mesh: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Merge points of very small triangles that lie in one voxel of `size` metres and have similar normals.

    A fine mesh has far more triangles than its light has detail.

    mesh: (F,) the number of each triangle's mesh; only points of one mesh are merged. Returns the points (K,) that stay, of each
    voxel the one nearest to their mean; and which of these each point is now, (P,).
    """
    corners = tessellation.corners
    fine = corners[corners[:, 0] == corners[:, 1], 0]  # each is all three corners of its cell
    stays = np.ones(len(tessellation.face), bool)
    stays[fine] = False
    kept, which = np.flatnonzero(stays), np.cumsum(stays) - 1
    position = tessellation.position[fine]
    key = _by_mesh(voxel_keys(position, tessellation.normal[fine], size), mesh[tessellation.face[fine]])
    chosen, site = choose_sites(key, position, tessellation.area[fine], 0.0, len(fine))
    which[fine] = len(kept) + site
    return np.concatenate([kept, fine[chosen]]), which


def _by_mesh(keys: np.ndarray, mesh: np.ndarray) -> np.ndarray:
    """Return (M,) numbers that are equal for equal `keys` (M,) of one `mesh` (M,)."""
    _, number = np.unique(keys, return_inverse=True)
    return np.asarray(number.ravel() * (int(mesh.max(initial=0)) + 1) + mesh)


def choose_sites(
    keys: np.ndarray, position: np.ndarray, area: np.ndarray, min_area: float, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the site of each cluster of members with equal `keys` (M,): the member nearest to their mean `position` (M, 3).

    area: (M,) m² of the surface that each member stands for. Only the `most` largest clusters of at least
    `min_area` m² have a site. Returns the sites (K,), as numbers of members, and which of them is each member's,
    (M,), -1 where its cluster has none.
    """
    order = np.argsort(keys, kind="stable")
    begin = np.flatnonzero(np.diff(keys[order], prepend=-1))
    counts = np.diff(begin, append=len(keys))
    cluster = np.empty(len(keys), np.intp)
    cluster[order] = in_order = np.repeat(np.arange(len(counts)), counts)
    apart = np.zeros(len(keys))
    for x in position.T:
        mean = np.bincount(cluster, weights=x, minlength=len(counts)) / counts
        apart += (x - mean[cluster]) ** 2
    apart = apart[order]
    nearest = np.flatnonzero(apart == np.minimum.reduceat(apart, begin)[in_order]) if len(keys) else order
    chosen = order[nearest[np.flatnonzero(np.diff(in_order[nearest], prepend=-1))]]  # the first member
    size = np.bincount(cluster, weights=area, minlength=len(counts))
    kept = np.argsort(-size, kind="stable")[:most]
    kept = np.sort(kept[size[kept] >= min_area])
    number = np.full(len(counts), -1)
    number[kept] = np.arange(len(kept))
    return chosen[kept], number[cluster]


@dataclass(frozen=True)
class Clusters:
    """The tessellation, M members on its two sides, and the keys (M,) of their clusters, which have a size of `spacing` metres.

    area: (M,) area that each member represents, m². mesh: (M,) number of its mesh. member: (2, P) number of the member for each
    side of each point of the tessellation. lit: (M,) False for members without light, and for those that no surface sees. level:
    (M,) number of times that the size of the cluster is halved, or doubled if negative.
    """

    tessellation: Tessellation
    members: Sites
    keys: np.ndarray
    spacing: float
    area: np.ndarray
    mesh: np.ndarray
    member: np.ndarray
    lit: np.ndarray
    level: np.ndarray

    @property
    def within(self) -> np.ndarray:
        """(M,) True for the inner sides of closed meshes."""
        return np.asarray(self.keys >> _WITHIN == 1)

    def choose(self, left: np.ndarray, most: int, small: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return the sites among the members `left`, and the site of each member, see choose_sites.

        small: True if small clusters have sites as well.
        """
        area, least = self.area[left] * 4.0 ** self.level[left], 0.0 if small else _MIN_AREA * self.spacing**2
        return choose_sites(self.keys[left], self.members.position[left], area, least, most)

    def merged(self, width: float) -> Clusters:
        """Return the clusters with one member for all of one mesh in one voxel of `width` metres that are alike in normals."""
        keys = voxel_keys(self.members.position, self.members.normal, width, self.level, self.within)
        parts = 2 * _by_mesh(keys, self.mesh) + self.lit
        kept, which = choose_sites(parts, self.members.position, self.area, 0.0, len(parts))
        columns = {name: getattr(self, name)[kept] for name in ("members", "keys", "mesh", "lit", "level")}
        area = np.bincount(which, self.area, len(kept))
        return replace(self, member=which[self.member], area=area, **columns)


def near_sites(members: Sites, requesting: np.ndarray, sites: np.ndarray, size: float, most: int) -> np.ndarray:
    """Return (N, most), the nearest sites to each of the members `requesting` (N,), the nearest first, as indices into `sites`.

    Sites face alike and lie in a member's block, the smallest one with enough of them. Entries are -1 where there are no more.
    requesting, sites: as numbers of members. Distance combines places and normals: `size` metres count as much as 60° between
    normals.
    """
    found = np.full((len(requesting), most), -1)
    (place, normal), (site_place, site_normal) = ((members.position[of], members.normal[of]) for of in (requesting, sites))
    for block, full in _BLOCKS:
        left = np.flatnonzero(found[:, 0] < 0)
        if not len(left):
            break
        both = np.concatenate([sites, requesting[left]])
        blocks = voxel_keys(members.position[both], members.normal[both], block * size) >> 8  # without the normals' parts
        order = np.argsort(blocks[: len(sites)], kind="stable")
        known = blocks[order]
        for first in range(0, len(left), _AT_ONCE):
            some = left[first : first + _AT_ONCE]
            requested = blocks[len(sites) + first :][: len(some)]
            begin, end = (np.searchsorted(known, requested, side) for side in ("left", "right"))
            member, counts = np.repeat(some, end - begin), np.cumsum(end - begin)
            site = order[np.arange(len(member)) + np.repeat(end - counts, end - begin)]
            # `take` of rows is four times as fast as an index
            turned = np.einsum("nx,nx->n", normal.take(member, 0), site_normal.take(site, 0))
            member, site, turned = (of[turned > _MIN_COSINE] for of in (member, site, turned))
            apart = (place.take(member, 0) - site_place.take(site, 0)) / np.float32(size)
            distance = np.einsum("nx,nx->n", apart, apart) + (2.0 - 2.0 * turned)  # |a - b|² = 2 - 2 a·b of unit normals
            near = np.argsort(member + distance / (3.0 * block**2 + 4.0), kind="stable")  # by member, then by distance
            rank = np.arange(len(near)) - np.searchsorted(member[near], member[near])
            near, rank = near[rank < most], rank[rank < most]
            found[member[near], rank] = site[near]
            found[some[found[some, (most - 1) * full] < 0]] = -1
    return found


def raised_lines(members: Sites, a: np.ndarray, b: np.ndarray, offset: float) -> tuple[np.ndarray, np.ndarray]:
    """Return starts and ends (N, 3) of the lines from eyes of members `a` to those of `b` (N,), raised by a part of their length.

    Where an object is closer to the surface than that, as a wall with a gap below, little light crosses, though a and b see each
    other through the gap.
    """
    start, end = (eyes(members, at, offset) for at in (a, b))
    rise = np.float32(_RAISED) * np.linalg.norm(end - start, axis=-1, keepdims=True)
    return start + rise * members.geometric[a], end + rise * members.geometric[b]


def sight_lines(members: Sites, a: np.ndarray, b: np.ndarray, offset: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return starts and ends (N + K, 3) of the segments that are free where members `a` (N,) see members `b`.

    The first N segments start at the eyes of `a`. Where the surface is concave or flat, they end at those of `b`. Where it is
    convex, a second segment follows. Both meet slightly above the point where the tangents of an arc between a and b
    meet. The third result has the numbers (K,) of first segments that have a second one.
    """
    start, end = (eyes(members, at, offset) for at in (a, b))
    n_a, n_b = members.geometric[a], members.geometric[b]
    bent = np.flatnonzero(np.einsum("nx,nx->n", end - start, n_b - n_a) > 0.0)
    from_a, to_b, apart, both = start[bent], end[bent], n_b[bent] - n_a[bent], n_a[bent] + n_b[bent]
    # |n_a − n_b|/|n_a + n_b| is the tangent of half the angle between the normals
    slope = np.linalg.norm(apart, axis=1) / np.maximum(np.einsum("nx,nx->n", both, both), 1e-30)
    rise = 0.5 * _CLEARANCE * np.linalg.norm(to_b - from_a, axis=1) * slope
    between = 0.5 * (from_a + to_b) + rise[:, None] * both
    end[bent] = from_a + np.float32(_BEYOND) * (between - from_a)
    return np.concatenate([start, between]), np.concatenate([end, to_b]), bent
