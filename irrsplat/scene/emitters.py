"""The area lights of a scene: emissive triangles, their mean luminance, clusters of them, and meshes without light inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.core.color import LUMINANCE
from irrsplat.core.glsl import MAX_EMITTER_CLUSTERS
from irrsplat.core.vectors import cross, triangle_areas
from irrsplat.scene.appearance import in_order
from irrsplat.scene.image_means import COLOR, sums_of_four
from irrsplat.scene.io.mesh_builder import distinct_rows, welded
from irrsplat.scene.model import Mesh, Scene, Texture, Wrap
from irrsplat.scene.seen_by_light import CLOSED, UNSEEN, sort_of

_BACKDROP_SHARE = 0.125  # share of all surface area; hemisphere samples alone find an emissive mesh that is larger
_LEAST_RATIO = 4.0  # least ratio of an area light's luminance to that of such a large mesh
_SMALLEST_SPLIT = 0.01  # of the scene's diagonal; clusters of this size are not split
_DARK = 1e-3  # of a mesh's brightest triangle; darker ones do not count towards the emissive area
_SHARED = 8  # triangles at one side, at most
_THIN = 1e-5  # of a triangle's size: distance of faces in the same place, by rounding errors
_INSIDE = 0.6, 0.3, 0.1  # weights of the corners at three points of a triangle, none of them on the median of a side
_POINTS = 4  # a textured triangle's mean emission is taken over _POINTS² points


@dataclass(frozen=True)
class Emitters:
    """N emissive triangles.

    triangle: (N,) numbers in the order of `flatten`. luminance: (N,) mean over each triangle, W/(m² sr). in_place: (N,) their
    sums over triangles in the same place, such as both faces of a CAD model's panel, see sums_in_place. area: (N,) m². one_sided:
    (N,) bool, True for triangles of closed meshes, whose back is invisible. cluster: (N,) number of each one's cluster. centre,
    radius: (C, 3) and (C,) metres, bounding balls of the clusters.
    """

    triangle: np.ndarray
    luminance: np.ndarray
    in_place: np.ndarray
    area: np.ndarray
    one_sided: np.ndarray
    cluster: np.ndarray
    centre: np.ndarray
    radius: np.ndarray

    def __len__(self) -> int:
        return len(self.triangle)


def emitters(scene: Scene) -> Emitters:
    """Return the scene's area lights.

    Meshes whose emissive area exceeds an eighth of all surfaces, such as domes and furnaces, are excluded: hundreds of rays of
    each gather hit them. So are triangles that are hardly brighter than such a mesh, and surfaces that transmit light.
    """
    triangles: list[np.ndarray] = [np.zeros(0, int)]
    means: list[np.ndarray] = [np.zeros(0)]
    corners, one_sided, first = [np.zeros((0, 3, 3))], [np.zeros(0, bool)], 0
    backdrop_luminance = 0.0  # luminance of the brightest excluded mesh
    total_area = sum(mesh.area for mesh in scene.meshes) or 1.0
    for mesh in in_order(scene):
        if any(mesh.material.emission) and sort_of(mesh) != UNSEEN:
            mean, at = mean_emission(mesh) @ LUMINANCE, _corners(mesh)
            area = triangle_areas(at)
            power = mean * area
            emitting_area = float(area[mean > _DARK * mean.max(initial=0.0)].sum())
            kept = np.flatnonzero(power > 0.0)
            if emitting_area > _BACKDROP_SHARE * total_area:
                backdrop_luminance, kept = max(backdrop_luminance, float(power.sum()) / emitting_area), kept[:0]
            triangles.append(first + kept)
            means.append(mean[kept])
            corners.append(at[kept])
            one_sided.append(np.full(len(kept), sort_of(mesh) == CLOSED))
        first += len(mesh.faces)
    triangle, luminance, at = np.concatenate(triangles), np.concatenate(means), np.concatenate(corners)
    bright = luminance > _LEAST_RATIO * backdrop_luminance
    triangle, luminance, at = triangle[bright], luminance[bright], at[bright]
    in_place, area = sums_in_place(at, luminance), triangle_areas(at)
    cluster = _clusters(at, luminance * area, _SMALLEST_SPLIT * scene.diagonal)
    centre, radius = _balls(at, cluster)
    return Emitters(triangle, luminance, in_place, area, np.concatenate(one_sided)[bright], cluster, centre, radius)


def sums_in_place(corners: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return (N,) each triangle's value plus those of triangles in its place that share a side with it, by their part of it.

    corners: (N, 3, 3) metres. values: (N,). Both faces of a quadrilateral may have different diagonals, but they share all sides.
    """
    _, corner = welded(corners.reshape(-1, 3).astype(np.float32))
    _, side = distinct_rows(np.sort(corner.reshape(-1, 3)[:, [[0, 1], [1, 2], [2, 0]]]).reshape(-1, 2).astype(np.uint64))
    order = np.argsort(side, kind="stable")
    codes, count = [np.zeros(0, np.intp)], len(values)
    for apart in range(1, _SHARED):
        same = np.flatnonzero(side[order[apart:]] == side[order[:-apart]])
        a, b = order[same] // 3, order[same + apart] // 3
        codes += [a * count + b, b * count + a]
    pairs = np.sort(np.concatenate(codes))
    one, other = np.divmod(pairs[np.diff(pairs, prepend=-1) > 0], max(count, 1))
    own, (a, b, c) = corners.take(one, 0), corners.take(other, 0).swapaxes(0, 1)
    u, v = b - a, c - a
    normal, sums = cross(u, v), values.astype(float)
    square = np.maximum(_dots(normal, normal), 1e-300)
    thin = _THIN * np.sqrt(np.maximum(_dots(u, u), _dots(v, v)) * square)
    for shift in range(len(_INSIDE)):
        away = np.einsum("k,nkx->nx", np.roll(_INSIDE, shift), own) - a
        x, y = _dots(cross(away, v), normal) / square, _dots(cross(u, away), normal) / square
        there = (x > 0.0) & (y > 0.0) & (x + y < 1.0) & (np.abs(_dots(away, normal)) < thin)
        sums += np.bincount(one, values[other] * there, minlength=count) / len(_INSIDE)
    return sums


def _dots(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return (N,) the dot products of vectors (N, 3)."""
    return np.asarray(np.einsum("nx,nx->n", a, b))


def _corners(mesh: Mesh) -> np.ndarray:
    """Return (F, 3, 3) float64, metres."""
    return np.asarray(mesh.positions[mesh.faces].astype(float))


# ---- clusters ------------------------------------------------------------------------------------------------------------


def _clusters(corners: np.ndarray, power: np.ndarray, small: float) -> np.ndarray:
    """Return (N,) the clusters of triangles (N, 3, 3).

    The cluster with the greatest product of power and extent is halved across its longest side, until all are as small as `small`
    metres or there are MAX_EMITTER_CLUSTERS.
    """
    middle = corners.mean(axis=1)
    parts = [np.arange(len(corners))] if len(corners) else []
    finished: list[np.ndarray] = []
    while parts and len(parts) + len(finished) < MAX_EMITTER_CLUSTERS:
        low = [corners[part].min((0, 1)) for part in parts]
        extent = [float(np.linalg.norm(corners[part].max((0, 1)) - a)) for part, a in zip(parts, low, strict=True)]
        strongest = int(np.argmax([float(power[part].sum()) * size for part, size in zip(parts, extent, strict=True)]))
        part = parts.pop(strongest)
        at = middle[part]
        axis = int(np.argmax(np.ptp(at, axis=0)))
        upper = at[:, axis] > 0.5 * (at[:, axis].min() + at[:, axis].max())
        if extent[strongest] <= small or not upper.any() or upper.all():
            finished.append(part)
        else:
            parts += [part[upper], part[~upper]]
    cluster = np.zeros(len(corners), int)
    for number, part in enumerate(parts + finished):
        cluster[part] = number
    return cluster


def _balls(corners: np.ndarray, cluster: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the centres (C, 3) and radii (C,) of the bounding balls of clusters of triangles (N, 3, 3)."""
    count = int(cluster.max(initial=-1)) + 1
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, cluster, corners.min(axis=1))
    np.maximum.at(high, cluster, corners.max(axis=1))
    return 0.5 * (low + high), 0.5 * np.linalg.norm(high - low, axis=1)


def unlit_interiors(scene: Scene) -> tuple[bool, ...]:
    """Return True for each mesh, in the order of flatten, whose inner side no light reaches.

    The mesh is closed, opaque and not emissive. Its bounding box contains no light and no emitter.
    """
    seen = (mesh for mesh in scene.meshes if len(mesh.positions) and any(mesh.material.emission) and sort_of(mesh) != UNSEEN)
    places = (np.asarray(light.position) for light in scene.lights)
    sources = [*(tuple(mesh.bounds) for mesh in seen), *((place, place) for place in places)]

    def unlit(mesh: Mesh) -> bool:
        if sort_of(mesh) != CLOSED or not len(mesh.positions):
            return False
        low, high = mesh.bounds
        return not any((low <= last).all() and (first <= high).all() for first, last in sources)

    return tuple(map(unlit, in_order(scene)))


# ---- textures ------------------------------------------------------------------------------------------------------------


def mean_emission(mesh: Mesh) -> np.ndarray:
    """Return (F, 3) the mean emission of each triangle; vertex colours and texture are averaged independently."""
    plain, texture = np.asarray(mesh.material.emission, float), mesh.material.emission_texture
    if mesh.material.unlit and mesh.colors is not None:
        plain = plain * mesh.colors[mesh.faces].astype(float).mean(1)
    if texture is None:
        return np.broadcast_to(plain, (len(mesh.faces), 3))
    uvs = np.zeros((len(mesh.positions), 4)) if mesh.uvs is None else mesh.uvs.astype(float)
    return np.asarray(plain * _mean_color(texture, uvs[:, 2 * texture.uv_set :][:, :2][mesh.faces]))


def _mean_color(texture: Texture, uvs: np.ndarray) -> np.ndarray:
    """Return (F, 3) the texture's mean linear colour over triangles with these coordinates (F, 3, 2).

    The samples are _POINTS² points at the mip level whose texels match the area of a sample.
    """
    a, b, c, d, e, f = texture.transform
    height, width = texture.image.pixels.shape[:2]
    at = np.stack([a * uvs[..., 0] + b * uvs[..., 1] + c, d * uvs[..., 0] + e * uvs[..., 1] + f], axis=-1)
    one, two = ((at[:, k] - at[:, 0]) * (width, height) for k in (1, 2))
    texels = 0.5 * np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]) / _POINTS**2
    level = np.maximum(np.log2(np.maximum(texels, 1.0)) / 2.0, 0.0).astype(int)
    x, y = ((k.ravel() + 0.5) / _POINTS for k in np.indices((_POINTS, _POINTS)))
    root = np.sqrt(x)
    shares = np.stack([1.0 - root, root * (1.0 - y), root * y], axis=-1)  # barycentric, evenly spread over a triangle
    mean = np.zeros((len(uvs), 3))
    image = np.take(COLOR, texture.image.pixels[..., :3], mode="clip")
    for number in range(int(level.max(initial=0)) + 1):
        rows = np.flatnonzero(level == number)
        if len(rows):
            place = np.einsum("sk,fkj->fsj", shares, at[rows])
            x, y = (_texel(place[..., j], image.shape[1 - j], texture.wrap[j]) for j in (0, 1))
            mean[rows] = image[y, x].mean(axis=1)
        image = sums_of_four(image) * np.float32(0.25)
    return mean


def _texel(at: np.ndarray, size: int, wrap: Wrap) -> np.ndarray:
    """Return the texels at these coordinates, for `size` texels along this axis."""
    if wrap == "repeat":
        at = at - np.floor(at)
    elif wrap == "mirror":
        at = 1.0 - np.abs(at - 2.0 * np.floor(0.5 * at) - 1.0)
    return np.asarray(np.clip((at * size).astype(int), 0, size - 1))
