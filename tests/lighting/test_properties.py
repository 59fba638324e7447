"""Irradiance of small random scenes against closed forms, over irrelevant variations and relevant sizes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

import irrsplat
from irrsplat.gather.record_frame import offset_of
from irrsplat.meter.light_meter import LightMeter
from irrsplat.meter.readings import Readings
from irrsplat.scene.model import Camera, Mesh, Scene
from tests.support.worlds import box, floor, material, point_light, polygon_vector, quad, scene, shared

ONE_MM_TO_3_M = st.floats(-3.0, 0.477).map(lambda power: 10.0**power)
SIDES = st.tuples(*[st.floats(2.0, 6.0)] * 3)
SEEDS = st.integers(0, 2**32 - 1)
HIGHEST = 0.99  # reflectance
COUNTS = pytest.mark.parametrize("count", [5, pytest.param(50, marks=pytest.mark.long)])


def hold(count: int, body: Callable[..., None], **values: Any) -> None:
    """Run the body of a test for `count` random values, reproducibly."""
    settings(max_examples=count, deadline=None, derandomize=True, database=None, phases=[Phase.generate])(given(**values)(body))()


def within(rho: float) -> float:
    """Return the allowed relative error: a transport error counts 1/(1 - ρ) times."""
    return 0.02 if rho <= 0.98 else 0.05


def split(mesh: Mesh, random: np.random.Generator) -> Mesh:
    """Return the mesh with some triangles split into three at an inner point."""
    chosen = random.random(len(mesh.faces)) < 0.5
    faces, shares = mesh.faces[chosen], random.dirichlet((2, 2, 2), int(chosen.sum()))[..., None]
    positions, normals = ((mesh_array[faces] * shares).sum(1).astype("f4") for mesh_array in (mesh.positions, mesh.normals))
    apex = len(mesh.positions) + np.arange(len(faces))
    parts = [np.stack([faces[:, k], faces[:, (k + 1) % 3], apex], 1) for k in range(3)]
    return replace(
        mesh,
        positions=np.concatenate([mesh.positions, positions]),
        normals=np.concatenate([mesh.normals, normals]),
        faces=np.concatenate([mesh.faces[~chosen], *parts]).astype("i4"),
    )


class Elsewhere:
    """Random rotation, mirrored or not, scale from 1/20 to 20, and shift by up to a hundred metres."""

    def __init__(self, random: np.random.Generator) -> None:
        self.turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
        self.scale, self.shift = 20.0 ** random.uniform(-1.0, 1.0), random.uniform(-100.0, 100.0, 3)

    def point(self, p: Any) -> np.ndarray:
        """Return transformed points (..., 3)."""
        found: np.ndarray = self.scale * np.asarray(p, float) @ self.turn.T + self.shift
        return found

    def mesh(self, mesh: Mesh) -> Mesh:
        """Return a transformed mesh."""
        faces = mesh.faces if np.linalg.det(self.turn) > 0.0 else mesh.faces[:, ::-1]
        normals = (mesh.normals @ self.turn.T).astype("f4")
        return replace(
            mesh, positions=self.point(mesh.positions).astype("f4"), normals=normals, faces=np.ascontiguousarray(faces)
        )


def read(world: Scene, points: np.ndarray, normals: Any, **values: Any) -> Readings:
    """Return the readings of a meter; fail for a NaN or negative value."""
    with shared() as ctx, LightMeter(world, ctx=ctx, **{"gather_size": 16, "light_samples": 256} | values) as meter:
        found = meter.measure(points, normals)
    assert (found.total >= 0.0).all()  # false for NaN
    return found


def walls(sides: tuple[float, ...], count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points (N, 3) on the inner walls of a centred box, normals (N, 3), and areas (N,) of Gauss's quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    points, normals, areas = [], [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = (0.5 * sides[(axis + k) % 3] * nodes for k in (1, 2))
            p, n = np.zeros((count * count, 3)), np.zeros(3)
            p[:, (axis + 1) % 3], p[:, (axis + 2) % 3] = (grid.ravel() for grid in np.meshgrid(u, v))
            p[:, axis], n[axis] = 0.5 * sign * sides[axis], -sign
            points.append(p)
            normals.append(np.tile(n, (len(p), 1)))
            areas.append(np.outer(weights, weights).ravel() * 0.25 * sides[(axis + 1) % 3] * sides[(axis + 2) % 3])
    return np.concatenate(points), np.concatenate(normals), np.concatenate(areas)


@COUNTS
def test_light_in_a_closed_room_is_kept(count: int) -> None:
    """Flux is conserved for any position, size, rotation, mirroring and tessellation, and any outer objects.

    A light of Φ = 4πI in a room of surface S: ∫ E_indirect dA = Φ·ρ/(1 - ρ), since each bounce keeps ρ of the flux. Rays begin up
    to 2.5 mm above surfaces on a large ground, so that a room of centimetres stands on a small one.
    """

    def body(sides: tuple[float, ...], rho: float, gap: float, seed: int) -> None:
        random = np.random.default_rng(seed)
        half, there, axis = 0.5 * np.array(sides), Elsewhere(random), random.integers(3)
        at = random.uniform(-0.6, 0.6, 3) * half
        at[axis] = half[axis] - min(gap, half[axis])
        room = there.mesh(split(box(-half, half, material(rho), outward=False), random))
        wide = 10.0 ** random.uniform(1.0, 2.5)
        ground = there.mesh(floor(wide if there.scale > 0.5 else 10.0, -half[1] - 0.1, material(0.5)))
        points, normals, area = walls(sides, 12)  # 6 points an axis miss 4 % of the light of a spot in a long room, 12 miss 0.3 %
        eye = Camera(tuple(there.point(0.0 * half)), tuple(there.point(half)), tuple(there.turn[:, 1]))
        world = scene(room, ground, lights=(point_light(there.point(at), there.scale**2),), camera=eye)
        found = read(world, there.point(points), normals @ there.turn.T).indirect[:, 0]
        assert found @ area == pytest.approx(4.0 * np.pi * rho / (1.0 - rho), rel=within(rho), abs=1e-6)

    hold(count, body, sides=SIDES, rho=st.floats(0.0, HIGHEST), gap=ONE_MM_TO_3_M, seed=SEEDS)


@COUNTS
def test_every_wall_of_a_furnace_is_lit_alike(count: int) -> None:
    """Walls that emit L and reflect ρ: E = πL/(1 - ρ) at every point and pixel, and no converged pixel is black."""

    def body(sides: tuple[float, ...], rho: float, seed: int) -> None:
        random = np.random.default_rng(seed)
        half, there, truth = 0.5 * np.array(sides), Elsewhere(random), np.pi / (1.0 - rho)
        points = random.uniform(-0.9, 0.9, (20, 3)) * half
        eye = Camera(tuple(there.point(0.0 * half)), tuple(there.point(half)), tuple(there.turn[:, 1]))
        world = scene(there.mesh(split(box(-half, half, material(rho, 1.0), outward=False), random)), camera=eye)
        assert read(world, there.point(points), random.normal(size=(20, 3))).total == pytest.approx(truth, rel=within(rho))
        frame = irrsplat.render(world, (16, 12), preset="preview")
        assert frame.stats["converged"] and frame.image.sum() > 0.0
        assert frame.irradiance.mean() == pytest.approx(truth, rel=within(rho))

    hold(count, body, sides=SIDES, rho=st.floats(0.0, HIGHEST), seed=SEEDS)


@COUNTS
def test_a_square_that_emits_lights_by_lamberts_formula(count: int) -> None:
    """The square is 0.5° to 60° wide from a point on a black floor, near or far, overhead or aside, among unlit walls."""

    def body(degrees: float, distance: float, tilt: float, seed: int) -> None:
        random = np.random.default_rng(seed)
        there, half = Elsewhere(random), distance * np.tan(np.radians(degrees) / 2.0)
        u, v = half * np.array([np.cos(tilt), -np.sin(tilt), 0.0]), np.array([0.0, 0.0, half])
        centre = distance * np.array([np.sin(tilt), np.cos(tilt), 0.0])
        corners = np.array([centre - u - v, centre + u - v, centre + u + v, centre - u + v])
        panel = quad(corners[0], 2.0 * u, 2.0 * v, material(0.0, 5.0))
        below = box((-9.0, -3.0, -9.0), (9.0, -2.0, 9.0), material(0.9))
        world = scene(*(there.mesh(part) for part in (panel, floor(8.0 * distance, 0.0, material(0.0)), below)))
        found = read(world, there.point([[0.0, 0.0, 0.0]] * 2), there.turn[:, 1], bounces=1).total[:, 0]
        nearer = 2.0 * offset_of(world) / (there.scale * distance)  # a meter's ray origin lies above its point
        assert found == pytest.approx(5.0 * polygon_vector(corners, np.zeros(3))[1], rel=0.02 + nearer)

    hold(count, body, degrees=st.floats(0.5, 60.0), distance=st.floats(0.3, 3.0), tilt=st.floats(0.0, 0.9), seed=SEEDS)


@COUNTS
def test_a_light_near_a_wall_lights_the_others_and_nothing_through_a_box(count: int) -> None:
    """E = I·cosθ/d² at the walls of a black room, for a light 1 mm to 3 m from one wall; 0 inside a closed box."""

    def body(sides: tuple[float, ...], gap: float, edge: float, seed: int) -> None:
        random = np.random.default_rng(seed)
        half, there, axis = 0.5 * np.array(sides), Elsewhere(random), random.integers(3)
        at = random.uniform(-0.6, 0.6, 3) * half
        at[axis] = half[axis] - min(gap, half[axis])
        points, normals, _ = walls(sides, 3)
        points, normals = points[normals[:, axis] >= 0.0], normals[normals[:, axis] >= 0.0]
        parts = [box(-half, half, material(0.0), outward=False), floor(100.0, -half[1] - 0.1)]
        around = min(edge, 0.9 * gap, 0.9 * float((half - np.abs(at)).min()))
        parts.append(box(at - around, at + around))
        lights, way = (point_light(there.point(at), there.scale**2),), at - points
        away = np.linalg.norm(way, axis=1)
        for shown, truth in ((2, np.maximum((way * normals).sum(1), 0.0) / away**3), (3, 0.0 * away)):
            world = scene(*(there.mesh(part) for part in parts[:shown]), lights=lights)
            found = read(world, there.point(points), normals @ there.turn.T, bounces=0).total[:, 0]
            assert found == pytest.approx(truth, rel=0.02, abs=1e-6)

    hold(count, body, sides=SIDES, gap=ONE_MM_TO_3_M, edge=ONE_MM_TO_3_M, seed=SEEDS)
