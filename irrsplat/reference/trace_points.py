"""Irradiance at given points by path tracing, timed with increasing sample counts, for the benchmark.

Importing this needs the extra `reference`. `main` is the process that the benchmark starts.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, TypedDict

import drjit as dr
import mitsuba as mi
import numpy as np

from irrsplat.core.errors import IrrsplatError
from irrsplat.reference.lanes import cosine_hemisphere
from irrsplat.reference.path_tracer import Tracer, has_cone
from irrsplat.reference.worker import serve
from irrsplat.scene.model import Light, Mesh, Scene

_BATCH = 4  # samples per point at once, by Mitsuba's own integrator
_SIDES = (1, 2, 3, 4, 6, 8, 11, 16, 23, 32)  # sides of the stratified grids of the other method


class TimedLevels(TypedDict):
    """load: seconds until the scene can be traced. levels: for each filter ("": none) samples per point, processor
    time in seconds and relative RMSE, without compilation."""

    load: float
    threads: int
    levels: dict[str, list[tuple[int, float, float]]]


def timed(
    scene: Scene,
    points: tuple[np.ndarray, np.ndarray, np.ndarray],
    judged: np.ndarray,
    truth: np.ndarray,
    method: str,
    bounces: int,
    enough: float,
    seconds: float,
    mask: np.ndarray,
    filters: Sequence[str],
    report: Callable[[float], object],
) -> TimedLevels:
    """Return times and errors of irradiance with `bounces` at `points`, (N, 3) each: positions, shading and geometric normals.

    judged: (M,) numbers of the points with reference irradiance `truth` (M, 3). method: "path", Mitsuba's own integrator on
    cosine-distributed rays, or "joined", Tracer's, which also connects every vertex to the first hits of each light's rays. Ends
    at a relative RMSE of at most `enough`, or after `seconds` of processor time. mask: (H, W) bool, the N pixels of the points.
    filters: qualities of Open Image Denoise ("fast", "high"), each of which filters the picture of every level as well.
    """
    start = time.perf_counter()
    levels = {"path": _path, "joined": _joined}[method](scene, points, bounces)
    next(levels)
    filtered = {"": lambda E: E} | {quality: partial(_denoised, mask, points[1], quality) for quality in filters}
    for smooth in filtered.values():
        smooth(np.zeros((len(points[0]), 3)))  # loads its weights
    load = time.perf_counter() - start
    found: dict[str, list[tuple[int, float, float]]] = {name: [] for name in filtered}
    for count, traced, E in levels:
        for name, smooth in filtered.items():
            begun = time.process_time()
            off = smooth(E)[judged] - truth
            took = traced + time.process_time() - begun
            found[name].append((count, took, float(np.sqrt(np.mean(off**2)) / truth.mean())))
        report(min(traced / seconds, 1.0))
        if found[""][-1][2] <= enough or traced >= seconds:
            break
    return {"load": load, "threads": dr.thread_count(), "levels": found}


def _denoised(mask: np.ndarray, normal: np.ndarray, quality: str, E: np.ndarray) -> np.ndarray:
    """Return irradiance (N, 3) at the N pixels of the mask (H, W), filtered by Open Image Denoise with the normals (N, 3)."""
    import pyoidn

    pictures = np.zeros((3, *mask.shape, 3), np.float32)
    for picture, values in zip(pictures, (np.maximum(E, 0.0), np.ones_like(normal), normal), strict=True):
        picture[mask] = values
    color, albedo, normals = pictures
    found: np.ndarray = pyoidn.denoise(color, albedo, normals, hdr=True, clean_aux=True, quality=quality)[mask].astype(float)
    return found


def main() -> None:
    """Send `timed` to the parent process."""
    serve(timed)


Level = tuple[int, float, np.ndarray]  # samples per point, processor time so far in seconds, irradiance (N, 3)


def _path(scene: Scene, points: tuple[np.ndarray, np.ndarray, np.ndarray], bounces: int) -> Iterator[Any]:
    """Yield None once the scene is loaded; then a Level whenever the samples have doubled."""
    world, epsilon = _world(scene), 2e-5 * scene.diagonal
    p, n, g = (mi.Vector3f(a.T.astype(np.float32)) for a in points)
    # one bounce needs only direct light at the hit; `path` would trace a further ray for nothing
    direct = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
    integrator = mi.load_dict(direct if bounces == 1 else {"type": "path", "max_depth": bounces + 1})
    yield None

    def batch(seed: int) -> np.ndarray:
        lanes = len(points[0]) * _BATCH
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, lanes)
        point = dr.arange(mi.UInt32, lanes) // _BATCH
        origin, normal, geometric = (dr.gather(mi.Vector3f, v, point) for v in (p, n, g))
        way = mi.Frame3f(normal).to_world(cosine_hemisphere(sampler.next_2d()))
        ray = mi.RayDifferential3f(mi.Point3f(origin + epsilon * way), way)
        radiance, _, _ = integrator.sample(world, sampler, ray, active=dr.dot(way, geometric) > 0.0)
        sums = [dr.block_sum(radiance[k], _BATCH) for k in range(3)]
        return np.stack([np.array(s, dtype=np.float64) for s in sums], axis=1) * np.pi

    batch(0)  # compiles
    done, took, total = 0, 0.0, np.zeros((len(points[0]), 3))
    while True:
        start = time.process_time()
        total += batch(1 + done)
        took, done = took + time.process_time() - start, done + 1
        if done & (done - 1) == 0:
            yield done * _BATCH, took, total / (done * _BATCH)


def _joined(scene: Scene, points: tuple[np.ndarray, np.ndarray, np.ndarray], bounces: int) -> Iterator[Any]:
    """Yield None once the scene is loaded; then a Level for each of _SIDES, with new strata each."""
    tracer = Tracer(scene)
    yield None
    p, n, g = points
    for side in _SIDES:
        few = slice(0, 256)
        tracer.irradiance(p[few], n[few], g[few], side, 1, bounces)  # compiles
        start = time.process_time()
        E = tracer.irradiance(p, n, g, side, 1 + side, bounces)
        yield side * side, time.process_time() - start, E


def _world(scene: Scene) -> Any:
    """Return the scene in Mitsuba's terms; raises IrrsplatError for unsupported features."""
    lit = any(max(mesh.material.emission) > 0.0 for mesh in scene.meshes) or max(scene.sky) > 0.0 or any(scene.sky_gradient)
    lit = lit or scene.environment is not None
    plain = all(not m.material.textures and not m.material.light_cutoff and m.colors is None for m in scene.meshes)
    if lit or not plain:
        # emitters would also light a hit directly, one bounce too many
        raise IrrsplatError("Mitsuba's own integrator is timed on opaque scenes of plain colours with point lights alone")
    parts: dict[str, Any] = {f"mesh{i}": _mesh(mesh) for i, mesh in enumerate(scene.meshes) if len(mesh.faces)}
    return mi.load_dict({"type": "scene", **parts, **{f"lamp{i}": _light(light) for i, light in enumerate(scene.lights)}})


def _mesh(mesh: Mesh) -> Any:
    colour = {"type": "rgb", "value": [float(c) for c in mesh.material.albedo]}
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict({"type": "twosided", "both": {"type": "diffuse", "reflectance": colour}})
    made = mi.Mesh(
        "mesh", vertex_count=len(mesh.positions), face_count=len(mesh.faces), has_vertex_normals=True, props=properties
    )
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = mesh.positions.astype(np.float32).ravel()
    parameters["vertex_normals"] = mesh.normals.astype(np.float32).ravel()
    parameters["faces"] = mesh.faces.astype(np.uint32).ravel()
    parameters.update()
    return made


def _light(light: Light) -> dict[str, Any]:
    strength = {"type": "rgb", "value": [float(c) for c in light.color]}
    if light.directional:
        toward = [-float(x) for x in light.position]
        irradiance = [light.strength(1.0) * c for c in light.color]
        return {"type": "directional", "direction": toward, "irradiance": {**strength, "value": irradiance}}
    if light.photometry is not None:
        raise IrrsplatError("luminaires (IES) are not written for it; give a scene of other lights")
    if not light.physical or light.spot_exponent > 0.0:
        raise IrrsplatError("Mitsuba has no light with OpenGL's attenuation or exponent")
    if not has_cone(light):
        return {"type": "point", "position": [float(x) for x in light.position], "intensity": strength}
    place = mi.ScalarTransform4f().look_at(
        origin=list(light.position), target=list(light.spot_target or (0, 0, 0)), up=_across(light)
    )
    beam = min(light.spot_inner, light.spot_cutoff)
    return {"type": "spot", "to_world": place, "intensity": strength, "cutoff_angle": light.spot_cutoff, "beam_width": beam}


def _across(light: Light) -> list[float]:
    """Return a vector that is not parallel to the spot's axis."""
    axis = np.abs(np.subtract(light.spot_target or (0.0, 0.0, 0.0), light.position))
    return [float(x) for x in np.eye(3)[axis.argmin()]]
