"""The emitting triangles of a scene as lights to be sampled, by power. NumPy alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.reference.surfaces import Surfaces

_SIDE = 6  # a textured triangle's power is the mean of side² points
_SPREAD = 0.25  # of all area: what shines on more of it is met by chance, and sampling it would only add noise
_PART = 1 << 16  # triangles whose texels are read at once


@dataclass(frozen=True)
class Emitters:
    """Triangles that shine, by number (N,), each with the probability (N,) that it is chosen and its area (N,) in m²."""

    face: np.ndarray
    probability: np.ndarray
    area: np.ndarray

    @staticmethod
    def of(surfaces: Surfaces) -> Emitters | None:
        """Those of a scene, chosen by power; None where it has none, and where it shines nearly everywhere."""
        seen, _ = surfaces.seen_by_light
        corners = surfaces.positions.astype(np.float64)[surfaces.faces]
        area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        face = np.flatnonzero((surfaces.emission > 0.0).any(axis=1) & seen & (area > 0.0))
        brightness = _brightness(surfaces, face)
        face, brightness = face[brightness > 0.0], brightness[brightness > 0.0]
        power = brightness * area[face]
        if not len(face) or power.sum() ** 2 > _SPREAD * area.sum() * (power * brightness).sum():
            return None
        return Emitters(face, power / power.sum(), area[face])


def _brightness(surfaces: Surfaces, face: np.ndarray) -> np.ndarray:
    """(N,) the mean emission of triangles (N,), all channels together, where light sees them."""
    table = surfaces.materials
    mean: np.ndarray = surfaces.emission[face].astype(np.float64).sum(axis=1)
    varies = (table.texture["emission"][surfaces.material[face]] >= 0) | surfaces.seen_by_light[1][face]
    at = np.flatnonzero(varies)
    x, y = (np.indices((_SIDE, _SIDE)).reshape(2, -1) + 0.5) / _SIDE
    u, v = np.sqrt(x) * (1.0 - y), np.sqrt(x) * y
    for k in range(0, len(at), _PART):
        part = at[k : k + _PART]
        total = np.zeros(len(part))
        for a, b in zip(u, v, strict=True):  # of the few points of a triangle
            points = surfaces.at(face[part], np.full(len(part), a), np.full(len(part), b))
            total += points.emission.sum(axis=1) * (points.opacity >= table.light_cutoff[points.material])
        mean[part] = total / len(u)
    return mean
