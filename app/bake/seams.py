"""Lightmap values outside charts and along seams, so that bilinear filtering shows neither gaps nor lines."""

from __future__ import annotations

import numpy as np

from irrsplat.app.bake.unwrap import Charts

_NEIGHBOURS = 4  # visible points that replace a hidden one
_ALIKE = 0.98  # cosine: normals that differ by more form a crease, where the light differs
_KEPT = 0.1  # weight of a texel's original value against a match across a seam


def filled(values: np.ndarray, known: np.ndarray, position: np.ndarray, chart: np.ndarray) -> np.ndarray:
    """Return `values` (H, W, C) with the unknown texels filled.

    Unknown texels of a chart take the mean of the chart's nearest known points in space, or of other charts without such
    points. Texels outside charts take the nearest chart texel. known: (H, W). position: (H, W, 3). chart: (H, W), -1 for
    none.
    """
    from scipy import ndimage
    from scipy.spatial import cKDTree

    found = np.where(known[..., None], values, 0.0)
    if not known.any():
        return found
    missing = (chart >= 0) & ~known
    if missing.any():
        # Charts are offset by more than the scene's size: other charts' points are used only as a last resort
        apart = 10.0 * np.ptp(position[chart >= 0], axis=0).max() + 1.0
        places = np.dstack([position, apart * chart[..., None]]).astype(float)
        distance, near = cKDTree(places[known]).query(places[missing], k=_NEIGHBOURS)
        distance, near = distance.reshape(-1, _NEIGHBOURS), near.reshape(-1, _NEIGHBOURS)
        there = np.isfinite(distance)  # fewer points than neighbours
        share = np.where(there, 1.0 / np.maximum(distance, 1e-9), 0.0)
        light = values[known][np.where(there, near, 0)]
        found[missing] = (share[..., None] * light).sum(1) / share.sum(1)[:, None]
    nearest = ndimage.distance_transform_edt(chart < 0, return_distances=False, return_indices=True)
    return np.asarray(found[tuple(nearest)])


def matched(values: np.ndarray, charts: Charts, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return `values` (H, W, C) with the least change that makes both sides of every seam equal after bilinear filtering.

    position, normal: (F, 3, 3) corners of all triangles in space. Least squares (Iwanicki 2013, "Lighting Technology of The
    Last of Us"): the difference between both sides along seams, plus the change of each texel.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.linalg import cg

    ends, others = _seams(charts, position, normal)
    if not len(ends):
        return values
    height, width, channels = values.shape
    length = np.maximum(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), np.linalg.norm(others[:, 1] - others[:, 0], axis=1))
    steps = np.ceil(2.0 * length).astype(np.int64) + 1  # half a texel each
    which = np.repeat(np.arange(len(ends)), steps)
    share = (np.arange(len(which)) - np.repeat(np.cumsum(steps) - steps, steps)) / np.maximum(steps - 1, 1)[which]
    columns, weights = [], []
    for side, sign in ((ends, 1.0), (others, -1.0)):
        at = side[which, 0] + share[:, None] * (side[which, 1] - side[which, 0]) - 0.5
        low = np.floor(at).astype(np.int64)
        x, y = (at - low).T
        for dx, dy, w in ((0, 0, (1 - x) * (1 - y)), (1, 0, x * (1 - y)), (0, 1, (1 - x) * y), (1, 1, x * y)):
            column, row = np.clip(low[:, 0] + dx, 0, width - 1), np.clip(low[:, 1] + dy, 0, height - 1)
            columns.append(row * width + column)
            weights.append(sign * w)
    texels, number = np.unique(np.concatenate(columns), return_inverse=True)
    rows = np.tile(np.arange(len(which)), len(columns))
    match = csr_array((np.concatenate(weights), (rows, number)), shape=(len(which), len(texels)))
    normal_matrix = match.T @ match + _KEPT**2 * csr_array((np.ones(len(texels)), (np.arange(len(texels)),) * 2))
    flat = values.reshape(-1, channels).astype(float)
    result = flat.copy()
    for k in range(channels):
        own = flat[texels, k]
        # Solve for the change: seams without a difference stay as they are
        change, _ = cg(normal_matrix, -(match.T @ (match @ own)), rtol=1e-5, maxiter=500)
        result[texels, k] = np.maximum(own + change, 0.0)
    return result.reshape(values.shape)


def _seams(charts: Charts, position: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (S, 2, 2) texels of the ends of seam edges on both sides.

    A seam edge is one edge in space with similar normals and two positions in the map.
    """
    corners = charts.corners
    scale = np.ptp(position.reshape(-1, 3), axis=0).max() or 1.0
    keys = np.round(position / (1e-6 * scale)).astype(np.int64)
    _, number = np.unique(keys.reshape(-1, 3), axis=0, return_inverse=True)
    number = number.reshape(-1, 3)
    face = np.repeat(np.arange(len(corners)), 3)
    first = np.tile(np.arange(3), len(corners))
    second = (first + 1) % 3
    a, b = number[face, first], number[face, second]
    swap = a > b  # consistent order of ends on both sides
    first, second = np.where(swap, second, first), np.where(swap, first, second)
    low, high = np.minimum(a, b), np.maximum(a, b)
    order = np.lexsort((face, high, low))
    here, there = order[:-1], order[1:]  # equal edges are adjacent in this order
    same = (low[here] == low[there]) & (high[here] == high[there]) & (low[here] != high[here])
    here, there = here[same], there[same]

    def ends(edge: np.ndarray, of: np.ndarray) -> np.ndarray:
        return np.stack([of[face[edge], first[edge]], of[face[edge], second[edge]]], axis=1)

    alike = ((ends(here, normal) * ends(there, normal)).sum(-1) > _ALIKE).all(1)
    here, there = here[alike], there[alike]
    uv, other = ends(here, corners), ends(there, corners)
    apart = (np.abs(uv - other) > 1e-3).any((1, 2))
    return uv[apart], other[apart]
