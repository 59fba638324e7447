"""Sample points of a bake: the lit sides of surfaces, and points on them as a picture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import moderngl
import numpy as np

from irrsplat.core.vectors import triangle_normals
from irrsplat.gather.record_frame import offset_of
from irrsplat.meter.light_meter import LightMeter, touching_distance
from irrsplat.meter.readings import Status
from irrsplat.reference.surfaces import Points, Surfaces
from irrsplat.scene import ray_caster
from irrsplat.scene.appearance import in_order
from irrsplat.scene.model import Mesh, Scene
from irrsplat.scene.spatial.solids import inside_solids

_TRIED = 48  # triangles of an open mesh that are tested on both sides, at most
_DARK = 1e-3  # share of the brightest tested point: a darker side counts as unlit
_AROUND = 8  # tested directions around the normal


@dataclass(frozen=True, eq=False)
class Receivers:
    """Surfaces that receive baked light.

    meshes: their front is the lit side; a mesh lit on both sides occurs twice. sources: index of each mesh in the scene.
    triangle: (F,) the renderer's triangle numbers. origin: world position of the local origin.
    """

    scene: Scene
    meshes: tuple[Mesh, ...]
    sources: tuple[int, ...]
    triangle: np.ndarray
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @cached_property
    def surfaces(self) -> Surfaces:
        """One table of all triangles."""
        return Surfaces.of(replace(self.scene, meshes=self.meshes))

    @cached_property
    def mesh_of(self) -> np.ndarray:
        """Index (F,) of each triangle's mesh."""
        return np.repeat(np.arange(len(self.meshes)), [len(mesh.faces) for mesh in self.meshes])

    def is_two_sided(self, number: int) -> bool:
        """True if both sides of the mesh with this number are visible, and no other mesh has its back."""
        return self.meshes[number].material.double_sided and self.sources.count(self.sources[number]) == 1

    @staticmethod
    def of(scene: Scene, ctx: moderngl.Context | None = None) -> Receivers:
        """Return the lit sides of a scene's meshes, in the scene's order and relative to its origin.

        ctx: as in LightMeter. Without a context, the previously current context is no longer current.
        """
        scene = scene.recentred
        origin, scene = scene.origin, scene.local
        ordered = in_order(scene)
        first = dict(zip(ordered, np.cumsum([0, *(len(mesh.faces) for mesh in ordered)]).tolist(), strict=False))
        meshes, sources, triangles = [], [], []
        lit = _lit_sides(scene, ctx)
        for i, mesh in enumerate(scene.meshes):
            if not len(mesh.faces):
                continue
            for side in lit[i]:
                meshes.append(mesh if side == "front" else _turned(mesh))
                sources.append(i)
                triangles.append(first[mesh] + np.arange(len(mesh.faces)))
        return Receivers(scene, tuple(meshes), tuple(sources), np.concatenate([np.zeros(0, int), *triangles]), origin)


@dataclass(frozen=True, eq=False)
class Places:
    """Points on surfaces as an H×W picture with gaps; all arrays but the last two are float32.

    position, normal, mapped, geometric: (H, W, 3) world space; unit normals, `mapped` with the normal map. albedo, emission:
    (H, W, 3). triangle: (H, W) the renderer's triangle number. seen: (H, W) bool, True at points.
    """

    position: np.ndarray
    normal: np.ndarray
    mapped: np.ndarray
    geometric: np.ndarray
    albedo: np.ndarray
    emission: np.ndarray
    triangle: np.ndarray
    seen: np.ndarray

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in texels."""
        return self.seen.shape[1], self.seen.shape[0]

    def but(self, hidden: np.ndarray) -> Places:
        """Return the places without the `hidden` (H, W) points."""
        return replace(self, seen=self.seen & ~hidden)


def places(receivers: Receivers, triangle: np.ndarray, u: np.ndarray, v: np.ndarray) -> Places:
    """Return the points a + u(b - a) + v(c - a) of the receivers' triangles (H, W); triangle: -1 for none."""
    seen = triangle >= 0
    found: Points = receivers.surfaces.at(triangle[seen], u[seen], v[seen])

    def spread(values: np.ndarray, dtype: str = "f4") -> np.ndarray:
        whole = np.zeros((*seen.shape, *values.shape[1:]), dtype)
        whole[seen] = values
        return whole

    columns = (found.position, found.smooth, found.mapped, found.front, found.albedo, found.emission)
    position, smooth, mapped, front, albedo, emission = map(spread, columns)
    numbers = spread(receivers.triangle[triangle[seen]], "i8")
    return Places(position, smooth, mapped, front, albedo, emission, numbers, seen)


def hidden(scene: Scene, where: Places) -> np.ndarray:
    """Return a mask (H, W) of invisible points: inside solids, or covered by another surface."""
    found = np.zeros(where.seen.shape, bool)
    at = where.position[where.seen].astype(float)
    n = where.geometric[where.seen].astype(float)
    if len(at):
        lifted = at + offset_of(scene) * n
        found[where.seen] = inside_solids(scene, lifted, n) | _covered(scene, lifted, n)
    return found


def _covered(scene: Scene, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return a mask (N,) of points with close geometry in all directions around their normals (N, 3)."""
    covered = np.ones(len(points), bool)
    if not ray_caster.available():  # without a ray caster, records at the hidden points decide, at a higher cost
        return ~covered
    surfaces = Surfaces.of(scene)
    caster = ray_caster.RayCaster(surfaces.positions, surfaces.faces)
    across = np.cross(normals, np.eye(3)[np.abs(normals).argmin(1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    third, reach = np.cross(normals, across), touching_distance(scene)
    for turn in (None, *(2.0 * np.pi * np.arange(_AROUND) / _AROUND)):
        way = normals if turn is None else 0.5 * normals + 0.866 * (np.cos(turn) * across + np.sin(turn) * third)
        left = np.flatnonzero(covered)
        covered[left[caster.free(points[left], points[left] + reach * way[left])]] = False
    return covered


def _turned(mesh: Mesh) -> Mesh:
    """Return the mesh with its back as its front."""
    return replace(mesh, faces=np.ascontiguousarray(mesh.faces[:, ::-1]), normals=-mesh.normals, closed=False)


def _lit_sides(scene: Scene, ctx: moderngl.Context | None) -> list[tuple[str, ...]]:
    """Return the lit sides of each mesh, "front" and "back".

    Closed, one-sided and unlit meshes have the front.
    """
    tried = {i: mesh for i, mesh in enumerate(scene.meshes) if len(mesh.faces) and not mesh.closed and mesh.material.double_sided}
    found: list[tuple[str, ...]] = [("front",)] * len(scene.meshes)
    if not tried:
        return found
    points, normals, owner = [], [], []
    for i, mesh in tried.items():
        corners = mesh.positions[mesh.faces].astype(float)
        normal, area = triangle_normals(corners)
        chosen = np.argsort(-area, kind="stable")[:_TRIED]  # the largest
        chosen = chosen[area[chosen] > 0.0]
        points.append(corners[chosen].mean(1))
        normals.append(normal.T[chosen])
        owner.append(np.full(len(chosen), i))
    at, n, of = np.concatenate(points), np.concatenate(normals), np.concatenate(owner)
    if not len(at):
        return found
    # One bounce: the surface cache leaks some light under objects on the ground
    with LightMeter(scene, "preview", ctx, bounces=1) as meter:
        readings = meter.measure(np.concatenate([at, at]), np.concatenate([n, -n]))
    light = np.where(readings.status == Status.OK, readings.total.max(1), 0.0).reshape(2, -1)
    bright = light > _DARK * light.max()
    for i in tried:
        sides = bright[:, of == i].any(1) if (of == i).any() else (True, False)
        found[i] = tuple(name for name, is_lit in zip(("front", "back"), sides, strict=True) if is_lit) or ("front",)
    return found
