"""The surfaces that a camera sees, with cut-outs and culled sides removed and filters applied.

NumPy alone; `seen` takes any source of hits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from irrsplat.reference.surfaces import Surfaces
from irrsplat.scene.model import Camera, Scene

_EPSILON = 2e-5, 2e-4  # of the scene's diagonal, metres: greatest offset behind a surface before the search for the next one
_LEAST = 1e-6  # of the diagonal: least offset, ten times the rounding of float32
_LAYERS = 1000  # surfaces along a ray, at most

# Returns (found, triangle, u, v, distance), (N,) each, of the nearest hits of rays by number (N,) beyond distances (N,)
Nearest = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Visible:
    """The surfaces along N rays of a camera, float64; 0 for rays without a surface.

    seen: (N,) bool, True for a surface. position: (N, 3) world space. normal: (N, 3) with normal map; smooth: (N, 3)
    interpolated; geometric: (N, 3), turned to the eye; the other normals are on its side. albedo, emission: (N, 3), not tinted.
    tint: (N, 3) product of all filters in front; glow: (N, 3) radiance emitted by them. opacity: (N,) of the nearest filter, or 1
    for a surface. distance: (N,) from the eye; inf without a surface.
    """

    seen: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    smooth: np.ndarray
    geometric: np.ndarray
    albedo: np.ndarray
    emission: np.ndarray
    tint: np.ndarray
    glow: np.ndarray
    opacity: np.ndarray
    distance: np.ndarray

    def image(self, size: tuple[int, int]) -> Visible:
        """Return (H, W, …) arrays, for the rays of the pixels of size (W, H)."""
        width, height = size
        arrays = {f.name: getattr(self, f.name) for f in fields(self)}
        return Visible(**{name: a.reshape(height, width, *a.shape[1:]) for name, a in arrays.items()})


def epsilon_of(scene: Scene) -> float:
    """Return the offset behind a surface, metres: equal on a large ground and in the house on this ground."""
    return max(min(_EPSILON[0] * scene.diagonal, _EPSILON[1]), _LEAST * scene.diagonal)


def camera_rays(camera: Camera, size: tuple[int, int], dx: float = 0.5, dy: float = 0.5) -> np.ndarray:
    """Return (W·H, 3) unit directions, row by row from the top, through the point (dx, dy) of every pixel (0.5: its centre).

    size: (W, H). dx, dy: 0..1 to the right and downward.
    """
    width, height = size
    row, column = np.indices((height, width))
    slope = np.tan(np.radians(camera.fov) / 2.0)
    x = ((column + dx) / width * 2.0 - 1.0) * slope * (width / height)
    y = (1.0 - (row + dy) / height * 2.0) * slope
    world = np.stack([x, y, -np.ones_like(x)], axis=-1).reshape(-1, 3) @ camera.axes
    return np.asarray(world / np.linalg.norm(world, axis=1, keepdims=True))


def seen(surfaces: Surfaces, directions: np.ndarray, nearest_hits: Nearest, epsilon: float) -> Visible:
    """Return the surfaces along rays (N, 3) of a camera; epsilon: offset behind a surface before the next one, in metres."""
    count, table = len(directions), surfaces.materials
    p, n, smooth, g, albedo, emission, glow = np.zeros((7, count, 3))
    tint, nearest, far = np.ones((count, 3)), np.zeros(count), np.full(count, np.inf)
    it = Visible(np.zeros(count, bool), p, n, smooth, g, albedo, emission, tint, glow, nearest, far)
    active, beyond, touched = np.arange(count), np.zeros(count), np.zeros(count, bool)
    for _ in range(_LAYERS):
        if not len(active):
            break
        found, triangle, u, v, distance = nearest_hits(active, beyond[active])
        active, triangle, u, v, distance = (x[found] for x in (active, triangle, u, v, distance))
        beyond[active] = distance + epsilon
        points = surfaces.at(triangle, u, v)
        material, opacity = points.material, points.opacity
        inward = (points.front * directions[active]).sum(1) > 0.0
        there = (table.double_sided[material] | ~inward) & (opacity >= table.cut_out[material]) & (opacity > 0.0)
        opacity = np.where(table.cut_out[material] > 0.0, 1.0, opacity)
        # `light_cutoff`: more than half of the light is blocked
        filters = there & table.filters[material] & (opacity * (1.0 - table.transmission[material]) < 0.5)
        first = there & ~touched[active]
        it.opacity[active[first]], touched[active[first]] = np.where(filters, opacity, 1.0)[first], True
        it.glow[active[filters]] += opacity[filters, None] * points.emission[filters]
        it.tint[active[filters]] *= 1.0 - opacity[filters, None] * (1.0 - np.clip(points.albedo[filters], 0.0, 1.0))
        stops = there & ~filters
        at, geometric = active[stops], np.where(inward[:, None], -points.front, points.front)[stops]
        side = np.where(inward[stops, None], -1.0, 1.0)
        it.seen[at], it.distance[at], it.position[at], it.geometric[at] = True, distance[stops], points.position[stops], geometric
        it.normal[at], it.smooth[at] = side * points.mapped[stops], side * points.smooth[stops]
        it.albedo[at], it.emission[at] = points.albedo[stops], points.emission[stops]
        active = active[~stops]
    return it
