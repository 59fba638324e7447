"""A bounding volume hierarchy over triangles: what a ray may hit, as tables that a shader traverses without a stack.

The tree is split level by level, at the least surface area cost among some bins (Wald 2007, "On fast Construction of SAH-based
Bounding Volume Hierarchies"): first cells of some triangles each, then the triangles in these (after
Garanzha, Pantaleoni, McAllister 2011, "Simpler and Faster HLBVH with Work Queues"). It is stored in depth-first order, each node
with a link to what follows its subtree, once for each octant of ray directions, so that the nearer child comes first (after
Hachisuka 2015, "MTBVH").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.core.vectors import morton_codes

LEAF = 4  # triangles of a leaf at most; two bits of the shader's tables hold their number
STEPS = 65533  # of the grid to which boxes are rounded, along an axis; with a margin of one on either side they fit in 16 bits
_MARGIN = 0.05  # steps by which a box is larger than its content: more than what a shader's rounding may lose
_BINS = 16  # per node and level at most
_TOGETHER = 32  # triangles that are split from each other last: splitting all of them from the root on took twice as long
_DEPTH = 10  # levels of the octree whose cells hold so many
_SIZES = 1 / 8, 1 / 32  # of the whole: triangles of different sizes lie in different cells
_LEVELS = 40  # after which nodes are halved by number: triangles whose sizes grow by powers would make a tree without end
_FAR = np.float32(1e18)  # metres, an empty box's corners; its area is still a number


@dataclass(frozen=True)
class Bvh:
    """The tree of F triangles, as a shader takes it (shaders/lib/rays/bvh.glsl).

    nodes: (8, N, 4) uint32, depth first, once for each octant of directions (bit i set: the i-th component is negative).
    Of each: the 16-bit grid coordinates of the box's near corner x y z, then its far one's, two a word, low half first; then
    the row of the node that follows the whole subtree, counted through all octants, or for a leaf
    2³¹ + 4·(its first triangle) + (their number - 1).
    grid: (2, 3) float32: grid coordinate g is at grid[0] + g·grid[1] metres. order: (F,) the triangles' numbers, leaf by leaf.
    """

    nodes: np.ndarray
    grid: np.ndarray
    order: np.ndarray


def build(corners: np.ndarray) -> Bvh:
    """The tree of triangles (F, 3, 3) of finite corners; the same corners make the same tree."""
    corners = np.asarray(corners, np.float32).reshape(-1, 3, 3)
    if not len(corners):  # one node that no ray enters: its near corner is beyond its far one
        link = np.arange(1, 9, dtype=np.uint32)[:, None, None]
        nodes = np.concatenate([np.broadcast_to(np.array([0xFFFFFFFF, 0xFFFF, 0], np.uint32), (8, 1, 3)), link], axis=2)
        return Bvh(nodes, np.array([[0.0] * 3, [1.0] * 3], np.float32), np.zeros(0, np.intp))
    tree = _tree(_boxes(corners))
    grid = _grid(tree.boxes[:3, 0], -tree.boxes[3:, 0])
    return Bvh(_table(tree, grid), grid, tree.order)


def _boxes(corners: np.ndarray) -> np.ndarray:
    """(6, F) the boxes of triangles (F, 3, 3), as _Tree has them."""
    a, b, c = (np.ascontiguousarray(corners[:, k].T) for k in range(3))  # numpy takes long over axes as short as 3
    return np.concatenate([np.minimum(np.minimum(a, b), c), -np.maximum(np.maximum(a, b), c)])


def _grid(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Bvh.grid of what lies between the corners low and high (3,); exact in float32, so that a shader has the same."""
    step = np.maximum(high - low, 1e-3 * float((high - low).max()) + 1e-30) / STEPS
    start = np.nextafter(low - step, np.float32(-np.inf)).astype(np.float32)
    step = (np.maximum(high - start.astype(float), step * STEPS) / (STEPS + 1)).astype(np.float32)
    return np.stack([start, np.nextafter(step, np.float32(np.inf))])


@dataclass(frozen=True)
class _Levels:
    """Trees of some roots, N nodes level by level.

    left: (N,) the left child; the right one is the next; -1: a leaf. axis: (N,) of the split.
    first, count: (N,) of leaves the first item and their number. inner: the numbers of the nodes that
    are no leaves, level by level. order: the items, leaf by leaf.
    """

    left: np.ndarray
    axis: np.ndarray
    first: np.ndarray
    count: np.ndarray
    inner: list[np.ndarray]
    order: np.ndarray


@dataclass(frozen=True)
class _Tree(_Levels):
    """The tree of all triangles.

    boxes: (6, N) the least corner and the negative of the greatest, so that the minimum over boxes bounds all of them.
    """

    boxes: np.ndarray


def _tree(boxes: np.ndarray) -> _Tree:
    """The tree of triangles with these boxes (6, F): that of the cells in which they lie, and below it one for each of these."""
    cells = _cells(boxes)
    top = _levels(cells.boxes, np.array([len(cells.count)]), cells.count)
    below = _levels(boxes, np.add.reduceat(cells.count[top.order], top.first[top.left < 0]), None, cells.triangles(top.order))
    # a leaf of the upper tree is a root of the lower ones, which come first there; all of their other nodes follow the upper ones
    roots, nodes = int(np.count_nonzero(top.left < 0)), len(top.left)
    number = np.concatenate([np.flatnonzero(top.left < 0), nodes + np.arange(len(below.left) - roots)])
    left, axis, first, count = (np.zeros(nodes + len(below.left) - roots, np.intp) for _ in range(4))
    left[:nodes], axis[:nodes] = top.left, top.axis
    left[number], axis[number] = np.where(below.left < 0, -1, below.left + nodes - roots), below.axis
    first[number], count[number] = below.first, below.count
    inner = [*top.inner, *(number[level] for level in below.inner)]
    bounds = np.empty((6, len(left)), np.float32)
    leaves = number[below.left < 0]
    bounds[:, leaves] = np.minimum.reduceat(np.take(boxes, below.order, axis=1), first[leaves], axis=1)
    for level in reversed(inner):
        bounds[:, level] = np.minimum(bounds[:, left[level]], bounds[:, left[level] + 1])
    return _Tree(left, axis, first, count, inner, below.order, bounds)


@dataclass(frozen=True)
class _Cells:
    """The cells in which triangles lie: their boxes (6, C) together, how many each one has, count (C,), and all of them cell by
    cell, order (F,)."""

    boxes: np.ndarray
    count: np.ndarray
    order: np.ndarray

    def triangles(self, cells: np.ndarray) -> np.ndarray:
        """(F,) the triangles of all `cells` (C,), one cell after the other."""
        count, start = self.count[cells], (np.cumsum(self.count) - self.count)[cells]
        within = np.arange(len(self.order)) - np.repeat(np.cumsum(count) - count, count)
        found: np.ndarray = self.order[np.repeat(start, count) + within]
        return found


def _cells(boxes: np.ndarray) -> _Cells:
    """The cells of an octree by the triangles' centres, cut down to _TOGETHER triangles in each or to its last level; large
    triangles lie apart from small ones, whose boxes they would swell."""
    centre, wide = boxes[:3] - boxes[3:], -(boxes[:3] + boxes[3:]).min(axis=0)
    start = centre.min(axis=1, keepdims=True)
    whole = np.maximum((centre.max(axis=1, keepdims=True) - start).max(), np.float32(1e-30))
    code = morton_codes(np.minimum((centre - start) * np.float32(1 << _DEPTH) / whole, (1 << _DEPTH) - 1))
    for size in _SIZES:
        code += (2.0 * wide > size * whole).astype(np.int64) << 3 * _DEPTH  # centres are twice as far apart as they seem
    packed = np.sort(code << 32 | np.arange(len(code)))
    order, differs = packed & 0xFFFFFFFF, np.full(len(packed), -1)
    differs[1:] = (packed[1:] ^ packed[:-1]) >> 32
    begin = np.flatnonzero(differs >> 3 * _DEPTH)
    for depth in range(1, _DEPTH + 1):
        count = np.diff(begin, append=len(code))
        if count.max() <= _TOGETHER:
            break
        many = np.repeat(count > _TOGETHER, count)
        many[begin] = True
        begin = np.flatnonzero(many & (differs >> 3 * (_DEPTH - depth) != 0))
    bounds = np.minimum.reduceat(np.take(boxes, order, axis=1), begin, axis=1)
    return _Cells(bounds, np.diff(begin, append=len(code)), order)


def _levels(boxes: np.ndarray, counts: np.ndarray, weights: np.ndarray | None, items: np.ndarray | None = None) -> _Levels:
    """Split nodes of so many items each, `counts`, until LEAF of them are left, or of items with weights (N,) one, or as many as
    weigh _TOGETHER.

    boxes: (6, N) of the items. items: their numbers, root by root (default: all, in their order)."""
    live = np.arange(boxes.shape[1]) if items is None else items  # those not in leaves yet, node by node
    part = boxes if items is None else np.take(boxes, items, axis=1)
    lefts, axes, numbers = [], [], []
    inner: list[np.ndarray] = []
    order: list[np.ndarray] = []
    done = 0  # nodes in the levels before
    while len(counts):
        leaf = counts <= LEAF
        if weights is not None:
            leaf = (counts == 1) | (np.add.reduceat(weights[live], np.cumsum(counts) - counts) <= _TOGETHER)
        keep = np.repeat(~leaf, counts)
        order.append(live[~keep])
        numbers.append(np.where(leaf, counts, 0))
        inner.append(done + np.flatnonzero(~leaf))
        done += len(counts)
        left, axis = np.full(len(leaf), -1), np.zeros(len(leaf), np.intp)
        left[~leaf] = done + 2 * np.arange(len(inner[-1]))
        if not keep.all():
            live, part = live[keep], part[:, keep]
        counts = counts[~leaf]
        if len(counts):
            weight = None if weights is None else weights[live]
            place, axis[~leaf], nearer = _split(part, counts, weight, len(inner) > _LEVELS)
            live, part = live[place], np.take(part, place, axis=1)
            counts = np.stack([nearer, counts - nearer], axis=1).ravel()
        lefts.append(left)
        axes.append(axis)
    count = np.concatenate(numbers)
    return _Levels(np.concatenate(lefts), np.concatenate(axes), np.cumsum(count) - count, count, inner, np.concatenate(order))


def _split(
    boxes: np.ndarray, counts: np.ndarray, weights: np.ndarray | None, halve: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split N nodes, each of which has `counts` (N,) of the boxes (6, B), across the axis along which centres spread most.

    Returns the boxes' new order, in which each node's left ones come first, the axes (N,), and how many boxes are left (N,).
    weights: (B,) how many triangles each box has; None: one. halve: split by number at any cost, as is done where all centres
    coincide.
    """
    nodes, total = len(counts), boxes.shape[1]
    bins = int(np.clip(2 * total // nodes, 4, _BINS))
    starts, node = np.cumsum(counts) - counts, np.repeat(np.arange(nodes), counts)
    centre = boxes[:3] - boxes[3:]
    low, high = np.minimum.reduceat(centre, starts, axis=1), np.maximum.reduceat(centre, starts, axis=1)
    axis, at = np.argmax(high - low, axis=0), np.arange(nodes)
    low, spread = low[axis, at], (high - low)[axis, at]
    scale = np.float32(bins) / np.maximum(spread, np.float32(1e-30))
    offset = (centre.ravel()[axis[node] * total + np.arange(total)] - low[node]) * scale[node]
    key = node * bins + np.minimum(offset.astype(np.intp), bins - 1)
    packed = np.sort(key << 32 | np.arange(total))  # the numbers make all keys different, so that every sort gives the same order
    place, key = packed & 0xFFFFFFFF, packed >> 32

    begin = np.flatnonzero(np.diff(key, prepend=-1))
    filled = key[begin]
    bounds = np.full((6, nodes * bins), _FAR, np.float32)
    bounds[:, filled] = np.minimum.reduceat(np.take(boxes, place, axis=1), begin, axis=1)
    binned = bounds.reshape(6, nodes, bins)

    def up_to_each(of_bins: np.ndarray) -> np.ndarray:
        """(N, bins - 1) the sums of what lies left of each split."""
        sums = np.zeros(nodes * bins, np.intp)
        sums[filled] = of_bins
        left: np.ndarray = np.cumsum(sums.reshape(nodes, bins), axis=1)[:, :-1]
        return left

    number = up_to_each(np.diff(begin, append=total))
    weight, whole = number, counts
    if weights is not None:
        weight, whole = up_to_each(np.add.reduceat(weights[place], begin)), np.add.reduceat(weights, starts)
    cost = _area(np.minimum.accumulate(binned, axis=2)[..., :-1]) * weight
    cost += _area(np.minimum.accumulate(binned[..., ::-1], axis=2)[..., -2::-1]) * (whole[:, None] - weight)
    cost[(number == 0) | (number == counts[:, None])] = np.inf
    best = np.argmin(cost, axis=1)
    return place, axis, np.where(np.isfinite(cost[at, best]) & (not halve), number[at, best], counts // 2)


def _area(boxes: np.ndarray) -> np.ndarray:
    """Half the surface area of boxes (6, …); meaningless for empty ones."""
    x, y, z = -(boxes[:3] + boxes[3:])
    area: np.ndarray = x * y + y * z + z * x
    return area


def _table(tree: _Tree, grid: np.ndarray) -> np.ndarray:
    """Bvh.nodes."""
    count = len(tree.left)
    size = np.ones(count, np.intp)  # of each node's subtree
    for nodes in reversed(tree.inner):
        size[nodes] += size[tree.left[nodes]] + size[tree.left[nodes] + 1]
    start, step = grid.astype(float)[..., None]
    low = np.floor((tree.boxes[:3] - start) / step - _MARGIN).astype(np.uint32)
    high = np.ceil((-tree.boxes[3:] - start) / step + _MARGIN).astype(np.uint32)
    leaf = tree.left < 0
    content = (0x80000000 + 4 * tree.first + tree.count - 1).astype(np.uint32)
    table = np.empty((8, count, 4), np.uint32)
    for octant, rows in enumerate(table):
        negative = np.array([octant & 1, octant & 2, octant & 4], bool)
        place = np.zeros(count, np.intp)
        for nodes in tree.inner:
            left, swap = tree.left[nodes], negative[tree.axis[nodes]]
            near, far = left + swap, left + 1 - swap
            place[near] = place[nodes] + 1
            place[far] = place[near] + size[near]
        n = [high[i] if negative[i] else low[i] for i in range(3)]
        f = [low[i] if negative[i] else high[i] for i in range(3)]
        link = np.where(leaf, content, (octant * count + place + size).astype(np.uint32))
        rows[place] = np.stack([n[0] | n[1] << 16, n[2] | f[0] << 16, f[1] | f[2] << 16, link], axis=1)
    return table
