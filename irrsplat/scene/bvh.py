"""A bounding volume hierarchy over triangles: what a ray may hit, as tables that a shader traverses without a stack.

The tree is split level by level, at the least surface area cost among some bins (Wald 2007, "On fast Construction of SAH-based
Bounding Volume Hierarchies"). It is stored in depth-first order, each node with a link to what follows its subtree, once for
each octant of ray directions, so that the nearer child comes first (after Hachisuka 2015, "MTBVH").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEAF = 4  # triangles of a leaf at most; two bits of the shader's tables hold their number
STEPS = 65533  # of the grid to which boxes are rounded, along an axis; with a margin of one on either side they fit in 16 bits
_MARGIN = 0.05  # steps by which a box is larger than its content: more than what a shader's rounding may lose
_BINS = 16  # per node and level at most
_LEVELS = 40  # after which nodes are halved by number: triangles whose sizes grow by powers would make a tree without end
_FAR = np.float32(1e18)  # metres, an empty box's corners; its area is still a number


@dataclass(frozen=True)
class Bvh:
    """The tree of F triangles, as a shader takes it (shaders/lib/bvh.glsl).

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
    tree = _tree(np.concatenate([corners.min(1), -corners.max(1)], axis=1).T.copy())
    grid = _grid(tree.boxes[:3, 0], -tree.boxes[3:, 0])
    return Bvh(_table(tree, grid), grid, tree.order)


def _grid(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Bvh.grid of what lies between the corners low and high (3,); exact in float32, so that a shader has the same."""
    step = np.maximum(high - low, 1e-3 * float((high - low).max()) + 1e-30) / STEPS
    start = np.nextafter(low - step, np.float32(-np.inf)).astype(np.float32)
    step = (np.maximum(high - start.astype(float), step * STEPS) / (STEPS + 1)).astype(np.float32)
    return np.stack([start, np.nextafter(step, np.float32(np.inf))])


@dataclass(frozen=True)
class _Tree:
    """N nodes, level by level.

    boxes: (6, N) the least corner and the negative of the greatest, so that the minimum over boxes bounds all of them.
    left: (N,) the left child; the right one is the next; -1: a leaf. axis: (N,) of the split.
    first, count: (N,) of leaves the first triangle and their number. inner: the numbers of the nodes that
    are no leaves, level by level. order: the triangles, leaf by leaf.
    """

    boxes: np.ndarray
    left: np.ndarray
    axis: np.ndarray
    first: np.ndarray
    count: np.ndarray
    inner: list[np.ndarray]
    order: np.ndarray


def _tree(boxes: np.ndarray) -> _Tree:
    """The tree of triangles with these boxes (6, F)."""
    live, counts, part = np.arange(boxes.shape[1]), np.array([boxes.shape[1]]), boxes  # those not in leaves yet, node by node
    lefts, axes, numbers = [], [], []
    inner: list[np.ndarray] = []
    order: list[np.ndarray] = []
    done = 0  # nodes in the levels before
    while len(counts):
        leaf = counts <= LEAF
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
            place, axis[~leaf], nearer = _split(part, counts, len(inner) > _LEVELS)
            live, part = live[place], np.take(part, place, axis=1)
            counts = np.stack([nearer, counts - nearer], axis=1).ravel()
        lefts.append(left)
        axes.append(axis)
    left, count, triangles = np.concatenate(lefts), np.concatenate(numbers), np.concatenate(order)
    first = np.cumsum(count) - count
    bounds = np.empty((6, len(left)), np.float32)
    bounds[:, left < 0] = np.minimum.reduceat(np.take(boxes, triangles, axis=1), first[left < 0], axis=1)
    for nodes in reversed(inner):
        bounds[:, nodes] = np.minimum(bounds[:, left[nodes]], bounds[:, left[nodes] + 1])
    return _Tree(bounds, left, np.concatenate(axes), first, count, inner, triangles)


def _split(boxes: np.ndarray, counts: np.ndarray, halve: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split N nodes, each of which has `counts` (N,) of the boxes (6, B), across the axis along which centres spread most.

    Returns the boxes' new order, in which each node's left ones come first, the axes (N,), and how many boxes are left (N,).
    halve: split by number at any cost, as is done where all centres coincide.
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
    number = np.zeros(nodes * bins, np.intp)
    number[filled] = np.diff(begin, append=total)
    number = np.cumsum(number.reshape(nodes, bins), axis=1)[:, :-1]
    cost = _area(np.minimum.accumulate(binned, axis=2)[..., :-1]) * number
    cost += _area(np.minimum.accumulate(binned[..., ::-1], axis=2)[..., -2::-1]) * (counts[:, None] - number)
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
