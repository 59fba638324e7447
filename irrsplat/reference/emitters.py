"""The emitting triangles of a scene as lights for sampling, in spatial clusters. NumPy alone.

A cluster is chosen by its power over its squared distance, bounded by the horizon, and a triangle in it by power. Among a hundred
lights in a house, a point then mostly samples the nearest one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.reference.surfaces import Surfaces
from irrsplat.scene.emitters import sums_in_place

_SIDE = 6  # a textured triangle's power is the mean of side² points
_SPREAD = 0.25  # of all area: larger emitters are hit by chance, and sampling them would only add noise
_GROUPS = 32  # clusters, at most
_PART = 1 << 16  # triangles whose texels are read at once


@dataclass(frozen=True)
class Emitters:
    """Emitting triangles, cluster by cluster.

    face: (N,) numbers of the triangles. share: (N,) of the cluster's power. density: (N,) m⁻² of their samples in the cluster,
    with those of triangles in the same place. area: (N,) in m². group: (N,) cluster number, ascending. centre: (G, 3), radius:
    (G,) a sphere around each cluster. power: (G,), in sum 1.
    """

    face: np.ndarray
    share: np.ndarray
    density: np.ndarray
    area: np.ndarray
    group: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    power: np.ndarray

    @staticmethod
    def of(surfaces: Surfaces) -> Emitters | None:
        """Return a scene's emitters; None without emitters, or if they cover most of the scene."""
        seen, _ = surfaces.seen_by_light
        corners = surfaces.positions.astype(np.float64)[surfaces.faces]
        area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        face = np.flatnonzero((surfaces.emission > 0.0).any(axis=1) & seen & (area > 0.0))
        brightness = _brightness(surfaces, face)
        face, brightness = face[brightness > 0.0], brightness[brightness > 0.0]
        power = brightness * area[face]
        if not len(face) or power.sum() ** 2 > _SPREAD * area.sum() * (power * brightness).sum():
            return None
        group = _groups(corners[face], power)
        order = np.argsort(group, kind="stable")
        face, power, group = face[order], power[order], group[order]
        total = np.bincount(group, power)
        boxes = [corners[face[group == g]].reshape(-1, 3) for g in range(len(total))]
        low, high = (np.array([end(box, axis=0) for box in boxes]) for end in (np.min, np.max))
        radius = np.linalg.norm(high - low, axis=1) / 2.0
        density = sums_in_place(corners[face], power / area[face]) / total[group]
        return Emitters(face, power / total[group], density, area[face], group, (low + high) / 2.0, radius, total / total.sum())


def _groups(corners: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Return (N,) clusters of triangles (N, 3, 3): split repeatedly the one with the greatest power · extent²."""
    middle, group = corners.mean(axis=1), np.zeros(len(corners), np.int64)
    worth = [1.0]
    while len(worth) < _GROUPS and max(worth) > 0.0:
        widest = int(np.argmax(worth))
        members = np.flatnonzero(group == widest)
        axis = int(np.argmax(np.ptp(middle[members], axis=0)))
        place = middle[members, axis]
        upper = place > (place.min() + place.max()) / 2.0
        group[members[upper]] = len(worth)
        halves = (members[~upper], members[upper])
        worth[widest], added = (float(power[m].sum() * (np.ptp(middle[m], axis=0) ** 2).sum()) if len(m) else 0.0 for m in halves)
        if not upper.any():
            worth[widest] = 0.0
            continue
        worth.append(added)
    return group


def _brightness(surfaces: Surfaces, face: np.ndarray) -> np.ndarray:
    """Return (N,) mean emission of triangles (N,), summed over channels, where light hits them."""
    table = surfaces.materials
    mean: np.ndarray = surfaces.emission[face].astype(np.float64).sum(axis=1)
    varies = (table.texture["emission"][surfaces.material[face]] >= 0) | surfaces.seen_by_light[1][face]
    varies |= surfaces.emission_varies[face]
    at = np.flatnonzero(varies)
    x, y = (np.indices((_SIDE, _SIDE)).reshape(2, -1) + 0.5) / _SIDE
    u, v = np.sqrt(x) * (1.0 - y), np.sqrt(x) * y
    for k in range(0, len(at), _PART):
        part = at[k : k + _PART]
        total = np.zeros(len(part))
        for a, b in zip(u, v, strict=True):  # over the few points of a triangle
            points = surfaces.at(face[part], np.full(len(part), a), np.full(len(part), b))
            total += points.emission.sum(axis=1) * (points.opacity >= table.light_cutoff[points.material])
        mean[part] = total / len(u)
    return mean
