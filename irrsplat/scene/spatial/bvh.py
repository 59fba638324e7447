"""Bounding volume hierarchy over triangles, as tables for a stackless traversal in shaders.

Nodes are split level by level by the binned surface area heuristic (Wald 2007, "On fast Construction of SAH-based Bounding
Volume Hierarchies"): first grid cells of triangles, then the triangles of each cell (after Garanzha, Pantaleoni, McAllister
2011, "Simpler and Faster HLBVH with Work Queues"). The tree is stored depth first, each node with a link past its subtree,
once for each octant of ray directions, so that the nearer child comes first (after Hachisuka 2015, "MTBVH").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.core.vectors import morton_codes

LEAF = 4  # triangles of a leaf at most; two bits of the shader's tables hold their number
STEPS = 65533  # grid steps along an axis to which boxes are rounded; with a margin of one on either side they fit 16 bits
_MARGIN = 0.05  # steps by which a box exceeds its content: more than the rounding error of a shader
_BINS = 16  # per node and level at most
_CELL_TRIANGLES = 32  # triangles of a cell at most: splitting all triangles from the root took twice as long
_DEPTH = 10  # levels of the octree of cells
_SIZES = 1 / 8, 1 / 32  # of the whole: triangles of different sizes lie in different cells
_LEVELS = 40  # of splits by cost, then by number: sizes that grow by powers would give an unbounded depth
_EMPTY_BOX = np.float32(1e18)  # metres, corners of an empty box; its area is finite


@dataclass(frozen=True)
class Bvh:
    """Tree of F triangles in the layout of shaders/lib/rays/bvh.glsl.

    nodes: (8, N, 4) uint32, depth first, for each octant of directions (bit i set: component i is negative). The first three
    words hold the box's near corner x y z, then its far corner, as 16-bit grid coordinates, two a word, low half first. The last
    word is the row after the subtree, counted through all octants, or for a leaf 2³¹ + 4·(first triangle) + (count - 1). grid:
    (2, 3) float32: grid coordinate g is at grid[0] + g·grid[1] metres. order: (F,) the triangles' numbers, leaf by leaf.
    """

    nodes: np.ndarray
    grid: np.ndarray
    order: np.ndarray


def build(corners: np.ndarray, room: np.ndarray | None = None) -> Bvh:
    """Return the tree of triangles (F, 3, 3) with finite corners; equal corners give an equal tree.

    room: (2, 3) corners of a box around all of them, which the grid spans; default: the smallest one.
    """
    corners = np.asarray(corners, np.float32).reshape(-1, 3, 3)
    if not len(corners):  # one node with an inverted box, which no ray enters
        link = np.arange(1, 9, dtype=np.uint32)[:, None, None]
        nodes = np.concatenate([np.broadcast_to(np.array([0xFFFFFFFF, 0xFFFF, 0], np.uint32), (8, 1, 3)), link], axis=2)
        return Bvh(nodes, np.array([[0.0] * 3, [1.0] * 3], np.float32) if room is None else _grid(*room), np.zeros(0, np.intp))
    tree = _tree(_boxes(corners))
    grid = _grid(*((tree.boxes[:3, 0], -tree.boxes[3:, 0]) if room is None else room))
    return Bvh(_table(tree, grid), grid, tree.order)


def joined(first: Bvh, second: Bvh) -> Bvh:
    """Return one tree of the triangles of two trees with equal grids. Rays traverse the nodes of the second after the first's."""
    counts, parts = [tree.nodes.shape[1] for tree in (first, second)], []
    for tree, other, rows, items in ((first, counts[1], 0, 0), (second, counts[0], counts[0], len(first.order))):
        nodes = tree.nodes.copy()
        octant = np.arange(8, dtype=np.uint32)[:, None]
        nodes[..., 3] += np.where(nodes[..., 3] < 1 << 31, octant * other + rows, 4 * items).astype(np.uint32)
        parts.append(nodes)
    return Bvh(np.concatenate(parts, axis=1), first.grid, np.concatenate([first.order, second.order]))


def _boxes(corners: np.ndarray) -> np.ndarray:
    """Return (6, F) the boxes of triangles (F, 3, 3), in the form of _Tree."""
    a, b, c = (np.ascontiguousarray(corners[:, k].T) for k in range(3))  # numpy is slow over axes as short as 3
    return np.concatenate([np.minimum(np.minimum(a, b), c), -np.maximum(np.maximum(a, b), c)])


def _grid(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return Bvh.grid between the corners low and high (3,); exact in float32, so that a shader computes the same."""
    step = np.maximum(high - low, 1e-3 * float((high - low).max()) + 1e-30) / STEPS
    start = np.nextafter(low - step, np.float32(-np.inf)).astype(np.float32)
    step = (np.maximum(high - start.astype(float), step * STEPS) / (STEPS + 1)).astype(np.float32)
    return np.stack([start, np.nextafter(step, np.float32(np.inf))])


@dataclass(frozen=True)
class _Levels:
    """Forest of some roots, N nodes level by level.

    left: (N,) left child, followed by the right one; -1: a leaf. axis: (N,) of the split. first, count: (N,) first item and
    number of items of a leaf. inner: numbers of the inner nodes, level by level. order: the items, leaf by leaf.
    """

    left: np.ndarray
    axis: np.ndarray
    first: np.ndarray
    count: np.ndarray
    inner: list[np.ndarray]
    order: np.ndarray


@dataclass(frozen=True)
class _Tree(_Levels):
    """Tree of all triangles.

    boxes: (6, N) the least corner and the negative of the greatest, so that one minimum bounds several boxes.
    """

    boxes: np.ndarray


def _tree(boxes: np.ndarray) -> _Tree:
    """Return the tree of triangles with these boxes (6, F): a tree of their cells, and below it one for each cell."""
    cell_boxes, sizes, triangles = _cells(boxes)
    top = _levels(cell_boxes, np.array([len(sizes)]), sizes)
    counts, starts = sizes[top.order], (np.cumsum(sizes) - sizes)[top.order]  # of the cells in the order of the upper tree
    triangles = triangles[np.arange(len(triangles)) + np.repeat(starts - (np.cumsum(counts) - counts), counts)]
    below = _levels(boxes, np.add.reduceat(counts, top.first[top.left < 0]), None, triangles)
    # leaves of the upper tree are the roots of the lower ones, which come first there; other lower nodes follow the upper tree
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


def _cells(boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return boxes (6, C) of octree cells, their numbers of triangles (C,), and the triangles cell by cell (F,).

    Cells have at most _CELL_TRIANGLES triangles, by their centres, or are of the last level. Large triangles have cells of their
    own, because they would enlarge the boxes of small ones.
    """
    centre, wide = boxes[:3] - boxes[3:], -(boxes[:3] + boxes[3:]).min(axis=0)
    start = centre.min(axis=1, keepdims=True)
    whole = np.maximum((centre.max(axis=1, keepdims=True) - start).max(), np.float32(1e-30))
    code = morton_codes(np.minimum((centre - start) * np.float32(1 << _DEPTH) / whole, (1 << _DEPTH) - 1))
    for size in _SIZES:
        code += (2.0 * wide > size * whole).astype(np.int64) << 3 * _DEPTH  # the sums of corners are twice the centres
    packed = np.sort(code << 32 | np.arange(len(code)))
    order, differs = packed & 0xFFFFFFFF, np.full(len(packed), -1)
    differs[1:] = (packed[1:] ^ packed[:-1]) >> 32
    begin = np.flatnonzero(differs >> 3 * _DEPTH)
    for depth in range(1, _DEPTH + 1):
        count = np.diff(begin, append=len(code))
        if count.max() <= _CELL_TRIANGLES:
            break
        many = np.repeat(count > _CELL_TRIANGLES, count)
        many[begin] = True
        begin = np.flatnonzero(many & (differs >> 3 * (_DEPTH - depth) != 0))
    bounds = np.minimum.reduceat(np.take(boxes, order, axis=1), begin, axis=1)
    return bounds, np.diff(begin, append=len(code)), order


def _levels(boxes: np.ndarray, counts: np.ndarray, weights: np.ndarray | None, items: np.ndarray | None = None) -> _Levels:
    """Split nodes of `counts` items until at most LEAF items remain.

    With `weights` (N,), nodes of one item or of at most _CELL_TRIANGLES in weight are leaves.
    boxes: (6, N) of the items. items: their numbers, root by root (default: all, in order).
    """
    live = np.arange(boxes.shape[1]) if items is None else items  # items that are not in leaves yet, node by node
    part = boxes if items is None else np.take(boxes, items, axis=1)
    lefts, axes, numbers = [], [], []
    inner: list[np.ndarray] = []
    order: list[np.ndarray] = []
    done = 0  # nodes in the levels before
    while len(counts):
        leaf = counts <= LEAF
        if weights is not None:
            leaf = (counts == 1) | (np.add.reduceat(weights[live], np.cumsum(counts) - counts) <= _CELL_TRIANGLES)
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
    """Split N nodes, each of which has `counts` (N,) of the boxes (6, B), across the axis of the greatest extent of centres.

    Returns the boxes' new order with each node's left ones first, the axes (N,), and the numbers of left boxes (N,).
    weights: (B,) triangles of each box; None: one. halve: split by number; also done where all centres coincide.
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
    packed = np.sort(key << 32 | np.arange(total))  # the item numbers make all keys distinct, so that the order is unique
    place, key = packed & 0xFFFFFFFF, packed >> 32

    begin = np.flatnonzero(np.diff(key, prepend=-1))
    filled = key[begin]
    bounds = np.full((6, nodes * bins), _EMPTY_BOX, np.float32)
    bounds[:, filled] = np.minimum.reduceat(np.take(boxes, place, axis=1), begin, axis=1)
    binned = bounds.reshape(6, nodes, bins)

    def up_to_each(of_bins: np.ndarray) -> np.ndarray:
        """Return (N, bins - 1) the sums over the bins to the left of each split."""
        sums = np.zeros(nodes * bins, np.intp)
        sums[filled] = of_bins
        return np.cumsum(sums.reshape(nodes, bins), axis=1)[:, :-1]

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
    """Return half the surface area of boxes (6, …); meaningless for empty ones."""
    x, y, z = -(boxes[:3] + boxes[3:])
    return np.asarray(x * y + y * z + z * x)


def _table(tree: _Tree, grid: np.ndarray) -> np.ndarray:
    """Return Bvh.nodes."""
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
