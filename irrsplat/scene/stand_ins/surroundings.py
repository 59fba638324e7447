"""Surroundings of a point: a coarse depth image of the sphere around it, from points on the surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.core.vectors import triangle_normals
from irrsplat.scene.model import Scene

_POINTS = 20_000  # on all surfaces: a few dozen for each direction
_RINGS, _SECTORS = 16, 32  # of the sphere, of equal solid angle
_GAP_SPACINGS = 6.4  # spacings of the points: nearer surfaces have gaps between their points
_WALLS = 0.85  # least share of blocked level directions between walls
_HIDDEN = 1.25  # times the nearest distance in a direction: farther points are hidden
_PICTURE_RISE, _PICTURE_SECTORS = 0.5, 4  # extent of a level picture: sine of the elevation, sectors to each side


@dataclass(frozen=True)
class SurfacePoints:
    """N points spread evenly over all surfaces that light sees.

    position: (N, 3). normal: (N, 3) unit, geometric. spacing: metres from one to the next, about.
    """

    position: np.ndarray
    normal: np.ndarray
    spacing: float = 0.0


@dataclass(frozen=True)
class Surroundings:
    """The sphere around a point, in rings by height and sectors by azimuth of equal solid angle.

    distance: (RINGS, SECTORS) metres to the nearest surface, infinite where there is none; the first ring points down. facing:
    True if that surface is front-facing.
    """

    distance: np.ndarray
    facing: np.ndarray

    @property
    def closed(self) -> float:
        """The share of blocked directions."""
        return float(np.isfinite(self.distance).mean())

    @property
    def fronts(self) -> float:
        """The share of front-facing surfaces among blocked directions."""
        hit = np.isfinite(self.distance)
        return float(self.facing[hit].mean()) if hit.any() else 0.0

    @property
    def open_above(self) -> bool:
        """True if walls surround the point, and most directions steeply above it are free."""
        blocked = np.isfinite(self.distance).mean(axis=1)
        level, above = slice(_RINGS * 3 // 8, _RINGS * 5 // 8), slice(_RINGS * 7 // 8, None)
        return bool(blocked[level].mean() >= _WALLS and blocked[above].mean() <= 0.5)

    @property
    def volume(self) -> float:
        """The visible volume, m³, slightly underestimated; free directions do not contribute."""
        hit = np.isfinite(self.distance)
        return float(4.0 / 3.0 * np.pi * (np.where(hit, self.distance, 0.0) ** 3).mean())

    def shown(self, points: SurfacePoints, at: np.ndarray, axes: np.ndarray) -> np.ndarray:
        """Return (SECTORS,) the weighted number of points that a level picture from `at` towards each sector shows."""
        distance, ring, sector = cells(points.position - at, axes)
        level = np.abs(ring + 0.5 - 0.5 * _RINGS) < 0.5 * _PICTURE_RISE * _RINGS
        seen = level & (distance < _HIDDEN * self.distance[ring, sector])
        counts = np.bincount(sector[seen], minlength=_SECTORS)
        share = np.cos(np.linspace(-0.5 * np.pi, 0.5 * np.pi, 2 * _PICTURE_SECTORS + 3))  # the middle weighs most
        return np.convolve(np.tile(counts, 3), share, "same")[_SECTORS : 2 * _SECTORS]


def directions(axes: np.ndarray) -> np.ndarray:
    """Return (RINGS, SECTORS, 3) unit directions of the centres; axes: (3, 3) rows right, up and front of the world."""
    rise = (np.arange(_RINGS) + 0.5) / _RINGS * 2.0 - 1.0
    azimuth = (np.arange(_SECTORS) + 0.5) / _SECTORS * 2.0 * np.pi - np.pi
    level = np.sqrt(1.0 - rise**2)[:, None]
    x, z = level * np.cos(azimuth), level * np.sin(azimuth)
    return np.asarray(np.stack([x, np.broadcast_to(rise[:, None], x.shape), z], -1) @ axes)


def surface_points(scene: Scene) -> SurfacePoints:
    """Return deterministic points on the scene's surfaces, except those that let light pass."""
    meshes = [m for m in scene.meshes if len(m.faces) and m.material.light_cutoff <= m.material.opacity]
    if not meshes:
        return SurfacePoints(np.zeros((0, 3)), np.zeros((0, 3)))
    corners = np.concatenate([mesh.positions[mesh.faces] for mesh in meshes])
    normals, areas = triangle_normals(corners)
    total = np.cumsum(areas)
    chance = np.random.default_rng(0)
    chosen = np.searchsorted(total, (np.arange(_POINTS) + chance.random(_POINTS)) / _POINTS * total[-1], "right")
    chosen = np.minimum(chosen, len(total) - 1)
    corners = corners[chosen].astype(float)
    u, v = chance.random((2, _POINTS, 1))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    a, along, across = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return SurfacePoints(a + u * along + v * across, normals.T[chosen], float(np.sqrt(total[-1] / _POINTS)))


def surroundings(points: SurfacePoints, at: np.ndarray, axes: np.ndarray) -> Surroundings:
    """Return the surroundings of the point `at` (3,); axes: (3, 3) rows right, up and front of the world."""
    way = points.position - at
    distance, ring, sector = cells(way, axes)
    cell = ring * _SECTORS + sector
    order = np.argsort(-distance)  # the nearest is written last
    nearest = np.full(_RINGS * _SECTORS, -1)
    nearest[cell[order]] = order
    hit = nearest >= 0
    found = np.where(hit, distance[nearest], np.inf)
    facing = hit & ((points.normal[nearest] * way[nearest]).sum(1) < 0.0)
    return _filled(found.reshape(_RINGS, _SECTORS), facing.reshape(_RINGS, _SECTORS), _GAP_SPACINGS * points.spacing)


def _filled(found: np.ndarray, facing: np.ndarray, sparse: float) -> Surroundings:
    """Return the surroundings without gaps between the points of surfaces nearer than `sparse` metres."""
    for _ in range(2):
        padded = np.pad(np.pad(found, ((1, 1), (0, 0)), constant_values=np.inf), ((0, 0), (1, 1)), mode="wrap")
        around = np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).min((2, 3))
        between = ~np.isfinite(found) & (around < sparse)
        found, facing = np.where(between, around, found), facing | between
    return Surroundings(found, facing)


def cells(way: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the lengths (N,) of vectors (N, 3) from a point, and their rings and sectors (N,)."""
    distance = np.linalg.norm(way, axis=1)
    x, rise, z = (way @ axes.T).T
    ring = np.clip(((rise / np.maximum(distance, 1e-300) + 1.0) * (0.5 * _RINGS)).astype(int), 0, _RINGS - 1)
    sector = np.clip(((np.arctan2(z, x) + np.pi) * (_SECTORS / (2.0 * np.pi))).astype(int), 0, _SECTORS - 1)
    return distance, ring, sector
