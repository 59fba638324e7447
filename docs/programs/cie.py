"""Cases of CIE 171:2006 for diffuse light, by the light meter, against closed forms; `measure.py cie` fills docs/about/cie.md."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from irrsplat.meter.light_meter import irradiance
from irrsplat.scene.model import Camera, Light, Material, Mesh, Scene

UP = np.array([0.0, 1.0, 0.0])
Points = tuple[np.ndarray, np.ndarray]  # (N, 3) places and normals


class Case(NamedTuple):
    """A case of CIE 171:2006: its clause, what it is of, and how to find (N,) values and what they should be.

    goal: of the relative error of each value.
    """

    clause: str
    what: str
    find: Callable[[], tuple[np.ndarray, np.ndarray]]
    goal: float = 0.01

    def error(self) -> tuple[int, float, float]:
        """Return how many values there are, and their greatest and root mean square relative error."""
        found, truth = self.find()
        relative = found / truth - 1.0
        return len(relative), float(np.abs(relative).max()), float(np.sqrt((relative**2).mean()))


def paint(reflectance: float, emission: float = 0.0) -> Material:
    """Return a grey material."""
    return Material(albedo=(reflectance,) * 3, emission=(emission,) * 3)


def rectangle(corner: Any, u: Any, v: Any, material: Material) -> Mesh:
    """Return a rectangle whose edges from a corner are u and v."""
    c, u, v = (np.asarray(x, float) for x in (corner, u, v))
    n = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    corners = np.array([c, c + u, c + u + v, c + v], "f4")
    return Mesh(corners, np.tile(n, (4, 1)).astype("f4"), np.array([[0, 1, 2], [0, 2, 3]], "i4"), material)


def room(sides: Any, material: Material) -> tuple[Mesh, ...]:
    """Return the walls of a closed room about 0 0 0."""
    half, found = 0.5 * np.asarray(sides, float), []
    for axis in range(3):
        u, v = (2.0 * half * np.eye(3)[(axis + k) % 3] for k in (1, 2))
        found += [rectangle(-half, u, v, material), rectangle(half, -v, -u, material)]
    return tuple(found)


def quadrature(sides: Any, count: int = 8) -> tuple[Points, np.ndarray]:
    """Return points on these walls, and (N,) m² of which a sum is Gauss's quadrature over them all."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    half, places, normals, areas = 0.5 * np.asarray(sides, float), [], [], []
    x, y = (grid.ravel() for grid in np.meshgrid(nodes, nodes))
    for axis, sign in ((axis, sign) for axis in range(3) for sign in (-1.0, 1.0)):
        u, v, n = (half * np.eye(3)[(axis + k) % 3] for k in (1, 2, 3))
        places.append(x[:, None] * u + y[:, None] * v + sign * n)
        normals.append(np.broadcast_to(-sign * np.eye(3)[axis], (len(x), 3)))
        areas.append(np.outer(weights, weights).ravel() * u.max() * v.max())
    return (np.concatenate(places), np.concatenate(normals)), np.concatenate(areas)


def measured(meshes: tuple[Mesh, ...], points: Points, *lights: Light, sky: float = 0.0, **settings: Any) -> np.ndarray:
    """Return (N,) what the light meter finds."""
    scene = Scene(meshes, lights, (Camera((0.0, 0.0, 0.0), (1.0, 0.1, 0.0)),), (sky,) * 3)
    return irradiance(scene, *points, **settings)[:, 0].astype(float)


def lambert(corners: Any, points: Points) -> np.ndarray:
    """Return (N,) the form factors of a convex polygon (Lambert 1760: half the sum over its edges of the angle that an edge
    subtends times the cosine between the normal and that of the plane through the edge and the point, by π)."""
    places, normals = points
    away = np.asarray(corners, float)[None] - places[:, None]
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    following = np.roll(away, -1, axis=1)
    axis = np.cross(away, following)
    angle = np.arctan2(np.linalg.norm(axis, axis=-1), (away * following).sum(-1))
    axis /= np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-30)
    found: np.ndarray = np.abs(np.einsum("nk,nkj,nj->n", angle, axis, normals)) / (2.0 * np.pi)
    return found


def grid(width: float, count: int = 5) -> Points:
    """Return places on a floor, a square about 0 0 0."""
    x, z = (g.ravel() for g in np.meshgrid(*[np.linspace(-0.5 * width, 0.5 * width, count)] * 2))
    return np.stack([x, 0.0 * x, z], 1), np.broadcast_to(UP, (len(x), 3))


FLOOR = rectangle((-4, 0, 4), (8, 0, 0), (0, 0, -8), paint(0.0))
PANEL = (-0.5, 3.0, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
PANEL_CORNERS = [(-0.5, 3, -0.5), (0.5, 3, -0.5), (0.5, 3, 0.5), (-0.5, 3, 0.5)]


def point_source() -> tuple[np.ndarray, np.ndarray]:
    """E = I·cosθ/d²: 1000 cd, 3 m above a black floor."""
    points = grid(4.0)
    d = np.linalg.norm(points[0] - (0, 3, 0), axis=1)
    return measured((FLOOR,), points, Light((0, 3, 0), (1000.0,) * 3, physical=True)), 3000.0 / d**3


def area_source() -> tuple[np.ndarray, np.ndarray]:
    """E = π·L·F: a square of 1 m² and 1000 cd/m², 3 m above a black floor."""
    points = grid(4.0)
    return measured((FLOOR, rectangle(*PANEL, paint(0.0, 1000.0))), points), np.pi * 1000.0 * lambert(PANEL_CORNERS, points)


def flux_of_a_point() -> tuple[np.ndarray, np.ndarray]:
    """∫E dA = Φ = 4πI over black walls."""
    sides = 4.0, 4.0, 4.0
    points, area = quadrature(sides)
    E = measured(room(sides, paint(0.0)), points, Light((0.0, 0.0, 0.0), (1000.0,) * 3, physical=True))
    return np.array([E @ area]), np.array([4000.0 * np.pi])


def flux_of_an_area() -> tuple[np.ndarray, np.ndarray]:
    """∫E dA = Φ = πLA over black walls under a ceiling that emits."""
    sides = 4.0, 4.0, 4.0
    points, area = quadrature(sides)
    walls = [
        mesh if number != 3 else replace(mesh, material=paint(0.0, 1000.0)) for number, mesh in enumerate(room(sides, paint(0.0)))
    ]
    return np.array([measured(tuple(walls), points) @ area]), np.array([16_000.0 * np.pi])


def reflection(side: float, screen: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """E = ρ·E_h·F at a wall next to a horizontal square of ρ = 0.8 under a sun of E_h = 1000 lx; no other surface reflects.

    screen: a black one as wide as the square, 1 m high and 1 m before the wall. From h > 1 m up the square is hidden from there
    to where the line of sight over the screen's edge meets it, h/(h - 1) m away; below 1 m, all that lies behind the screen is.
    """
    heights = np.linspace(0.25, 2.75, 11)
    points = np.stack([0.0 * heights, heights, 0.0 * heights], 1), np.tile((1.0, 0.0, 0.0), (len(heights), 1))
    start, half = 1.5 if screen else 0.0, 0.5 * side
    square = rectangle((start, 0, half), (side, 0, 0), (0, 0, -side), paint(0.8))
    meshes: tuple[Mesh, ...] = (square,)
    if screen:
        meshes += (rectangle((1, 0, -half), (0, 0, side), (0, 1, 0), paint(0.0)),)
    seen = np.full(len(heights), start)  # metres from the wall, from where on each point sees the square
    if screen:
        seen = np.where(heights > 1.0, np.maximum(heights / np.maximum(heights - 1.0, 1e-9), start), np.inf)
    E = measured(meshes, points, Light((0.0, 1.0, 0.0), (1000.0 / np.pi,) * 3, directional=True), bounces=1)
    end = start + side
    truth = np.zeros(len(heights))
    for i in np.flatnonzero(seen < end):
        corners = [(seen[i], 0, -half), (end, 0, -half), (end, 0, half), (seen[i], 0, half)]
        truth[i] = 800.0 * lambert(corners, (points[0][i : i + 1], points[1][i : i + 1]))[0]
    hidden = truth == 0.0
    assert (E[hidden] < 1e-3).all(), "light comes through the screen"
    return E[~hidden], truth[~hidden]


def interreflection(reflectance: float) -> tuple[np.ndarray, np.ndarray]:
    """E_ind = Φ/S·ρ/(1 - ρ) in the mean over the walls of a cube of 4 m: 10 000 lm, all the same in all directions, S = 96 m²."""
    sides = 4.0, 4.0, 4.0
    (places, normals), area = quadrature(sides)
    walls, lamp = room(sides, paint(reflectance)), Light((0.0, 0.0, 0.0), (10_000.0 / (4.0 * np.pi),) * 3, physical=True)
    away = np.linalg.norm(places, axis=1)
    direct = 10_000.0 / (4.0 * np.pi) * -(places * normals).sum(1) / away**3
    E = measured(walls, (places, normals), lamp) - direct
    return np.array([E @ area / area.sum()]), np.array([10_000.0 / 96.0 * reflectance / (1.0 - reflectance)])


def skylight() -> tuple[np.ndarray, np.ndarray]:
    """E = π·L·F of an opening of 1 m² in the roof of a black room of 4 × 3 × 4 m, under a sky that is the same all over."""
    sides, points = (4.0, 3.0, 4.0), grid(3.0)
    points = points[0] - (0.0, 1.5, 0.0), points[1]
    bars = [((-2, -2), (4, 1.5)), ((-2, 0.5), (4, 1.5)), ((-2, -0.5), (1.5, 1)), ((0.5, -0.5), (1.5, 1))]
    roof = [rectangle((x, 1.5, z), (w, 0, 0), (0, 0, d), paint(0.0)) for (x, z), (w, d) in bars]
    walls = [mesh for mesh in room(sides, paint(0.0)) if not (mesh.positions[:, 1] > 1.4).all()]
    corners = [(-0.5, 1.5, -0.5), (0.5, 1.5, -0.5), (0.5, 1.5, 0.5), (-0.5, 1.5, 0.5)]
    return measured((*walls, *roof), points, sky=1000.0), np.pi * 1000.0 * lambert(corners, points)


REFLECTANCES = 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95
CASES = (
    Case("5.2", "point source over a floor", point_source),
    Case("5.3", "area source over a floor", area_source),
    Case("5.4", "flux of a point source on black walls", flux_of_a_point),
    Case("5.4", "flux of an area source on black walls", flux_of_an_area),
    Case("5.6", "wall next to a lit square of 0.5 m", partial(reflection, 0.5)),
    Case("5.6", "wall next to a lit square of 4 m", partial(reflection, 4.0)),
    Case("5.6", "wall next to a lit square of 500 m", partial(reflection, 500.0)),
    Case("5.7", "wall behind a screen, square of 4 m", partial(reflection, 4.0, True)),
    Case("5.7", "wall behind a screen, square of 500 m", partial(reflection, 500.0, True)),
    *(Case("5.8", f"walls of a cube, ρ = {rho:g}", partial(interreflection, rho)) for rho in REFLECTANCES[:-1]),
    Case("5.8", "walls of a cube, ρ = 0.95", partial(interreflection, 0.95), goal=0.02),
    Case("5.9", "opening in a roof, uniform sky", skylight),
)
