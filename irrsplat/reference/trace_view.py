"""A path-traced view: irradiance in two halves and by time, direct light, and the pixels for comparison.

Importing this needs the extra `reference`. Functions of a `report` run in the process that `irrsplat.reference.worker` starts.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

from irrsplat.core.timing.other_process import Report
from irrsplat.reference.camera_view import Visible, camera_rays
from irrsplat.reference.lanes import lights
from irrsplat.reference.path_tracer import Hit, Tracer, image, surface, view
from irrsplat.reference.timed_levels import JudgedView, TimedLevels, levels
from irrsplat.scene.model import Camera, Scene

ANGLE = 18.0  # degrees between a pixel's normal and its neighbours'
PLANE = 0.01  # in diagonals: distance of a pixel's neighbours from its tangent plane
FAR_FROM_EDGES = 3  # pixels: least distance of compared direct light from a shadow's edge
_FINE = 4  # textures are sampled at side² points of every pixel
_PART = 1 << 22  # samples between two reports of progress
_SEEDS = 1 << 20  # more than the seeds of one pass
_TIMED = (1, 2, 3, 4, 6, 8, 11, 16, 23, 32)  # sides of the stratified grids of a point's samples in the benchmark


def trace(
    scene: Scene, camera: Camera, size: tuple[int, int], side: int, bounces: int, report: Callable[[float], object]
) -> dict[str, np.ndarray]:
    """Return the arrays of a `Traced` view of W×H pixels: irradiance of `bounces`, side² samples of each kind per pixel and half.

    report: called with the finished share.
    """
    width, height = size
    tracer = Tracer(scene)
    sites, valid, hit = _sites(tracer, camera, size)
    direct, changes = direct_light(tracer, camera, hit, size)
    if any(mesh.material.textures for mesh in scene.meshes):
        normal, albedo = (values.reshape(-1, 3).T for values in (sites.normal, sites.albedo))
        hit = replace(hit, n=mi.Vector3f(normal), albedo=mi.Color3f(albedo))
        lit = (image(hit.albedo * tracer.lit(light, hit)[0] / np.pi, size) for light in scene.lights)
        direct = sum(lit, 0.0 * sites.albedo)
    seen, smooth = sites.seen, valid_pixels(sites.position, sites.smooth, sites.seen, scene.diagonal)
    halves = _halves(tracer, sites, side, bounces, 0, report)
    sky = scene.sky_radiance(camera_rays(camera, size)).reshape(height, width, 3) if scene.own_sky else 0.0
    own = {name: getattr(sites, name).astype(np.float32) for name in ("albedo", "normal", "tint", "glow", "opacity")}
    return own | {
        "halves": halves,
        "direct": np.where(seen[..., None], direct, 0.0).astype(np.float32),
        "emission": np.where(seen[..., None], sites.emission, sky).astype(np.float32),
        "seen": seen,
        "valid": valid,
        "clear": valid & (distance_to(changes | ~smooth) > FAR_FROM_EDGES),
    }


def _halves(tracer: Tracer, sites: Visible, side: int, bounces: int, seed: int, report: Callable[[float], object]) -> np.ndarray:
    """Return (2, H, W, 3) irradiance of `bounces`, side² samples of each kind per pixel and half, from the seeds after `seed`."""
    halves = np.zeros((2, *sites.seen.shape, 3), np.float32)
    points = tuple(a[sites.seen] for a in (sites.position, sites.normal, sites.geometric))
    halves[:, sites.seen] = _traced(tracer, points, side, bounces, seed, report)
    return halves


def _traced(
    tracer: Tracer, points: tuple[np.ndarray, ...], side: int, bounces: int, seed: int, report: Callable[[float], object]
) -> np.ndarray:
    """Return (2, N, 3) float32: irradiance like `_halves` at points, see `at_points`."""
    count = len(points[0])
    found = np.zeros((2, count, 3), np.float32)
    step = max(_PART // (side * side), 1)
    parts = [slice(k, k + step) for k in range(0, count, step)]
    for k, part in enumerate(parts):
        p, n, g = (a[part] for a in points)
        for half in range(2):
            found[half, part] = tracer.irradiance(p, n, g, side, seed + 2 * k + half + 1, bounces)
        report((k + 1) / len(parts))
    return found


def refine(scene: Scene, camera: Camera, size: tuple[int, int], sides: Sequence[int], bounces: int, report: Report) -> None:
    """Trace irradiance of `bounces` pass by pass: twice side² samples of each kind per pixel, for each of the `sides`.

    report: called with the finished share of all samples, and after each pass with `halves`, `seen` and `valid`, see `Traced`.
    """
    tracer, done, whole = Tracer(scene), 0.0, sum(side * side for side in sides)
    sites, valid, _ = _sites(tracer, camera, size)
    for number, side in enumerate(sides):
        share = side * side / whole
        part = partial(lambda done, share, finished: report(done + share * finished), done, share)
        halves = _halves(tracer, sites, side, bounces, number * _SEEDS, part)
        done += share
        report(done, {"halves": halves, "seen": sites.seen, "valid": valid})


def _sites(tracer: Tracer, camera: Camera, size: tuple[int, int]) -> tuple[Visible, np.ndarray, Hit]:
    """Return the surfaces at the pixels' centres (H, W, …), the pixels (H, W) for the comparison of irradiance, and the surfaces
    in lanes. The first have the means of albedo and normal over a pixel."""
    middle = view(tracer, camera, size)
    hit, centre = surface(middle, camera), middle.image(size)
    if any(mesh.material.textures for mesh in tracer.scene.meshes):
        albedo, normal = over_pixels(tracer, camera, size, centre)
        centre = replace(centre, albedo=albedo, normal=normal)
    valid = valid_pixels(centre.position, centre.smooth, centre.seen, tracer.scene.diagonal)
    valid &= ~image(hit.ambiguous, size)  # the side turned to the camera is ambiguous there
    valid &= np.any(centre.albedo > 0.0, axis=-1)  # a black emitter shows only its own light
    return centre, valid, hit


def at_points(
    scene: Scene,
    points: tuple[np.ndarray, np.ndarray, np.ndarray],
    side: int,
    bounces: int,
    report: Callable[[float], object],
) -> np.ndarray:
    """Return (N, 3) float32 irradiance of `bounces` at points on surfaces, in W/m².

    points: positions, shading and geometric normals, (N, 3) each. side: as for `trace`. report: called with the finished share.
    """
    places = tuple(np.asarray(a, np.float64) for a in points)
    return np.asarray(_traced(Tracer(scene), places, side, bounces, 0, report).mean(0))


def timed(scene: Scene, bounces: int, view: JudgedView, report: Callable[[float], object]) -> TimedLevels:
    """Return times and errors of irradiance with `bounces` at the points of a view."""
    start = time.perf_counter()
    tracer, p, n, g, few = Tracer(scene), view.position, view.normal, view.geometric, slice(0, 256)
    load = time.perf_counter() - start

    def compiled(count: int) -> None:
        tracer.irradiance(p[few], n[few], g[few], round(count**0.5), 1, bounces)

    def irradiance(count: int) -> np.ndarray:
        side = round(count**0.5)
        return tracer.irradiance(p, n, g, side, 1 + side, bounces)  # with new strata

    found = levels(irradiance, [side * side for side in _TIMED], view, report, compiled)
    return {"load": load, "threads": dr.thread_count(), "levels": found}


def over_pixels(tracer: Tracer, camera: Camera, size: tuple[int, int], centre: Visible) -> tuple[np.ndarray, np.ndarray]:
    """Return (H, W, 3) albedo and mapped normal, averaged over every pixel's part on the surface at its centre.

    A texture may be finer than a pixel, and no renderer shows exactly the texel at the centre. Normals are averaged only where
    maps bend them, so that a bevel in the pixel does not turn the flat side at its centre.
    """
    albedo, bent = centre.albedo.copy(), centre.normal - centre.smooth
    count = np.ones((*centre.seen.shape, 1))
    for dx, dy in _within_a_pixel(_FINE):
        sub = view(tracer, camera, size, dx, dy).image(size)
        near = np.abs(((sub.position - centre.position) * centre.smooth).sum(-1)) <= PLANE * tracer.scene.diagonal
        same = sub.seen & centre.seen & near & ((sub.smooth * centre.smooth).sum(-1) >= np.cos(np.radians(ANGLE)))
        albedo += np.where(same[..., None], sub.albedo, 0.0)
        bent += np.where(same[..., None], sub.normal - sub.smooth, 0.0)
        count += same[..., None]
    normal = centre.smooth + bent / count
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return albedo / count, np.where(length > 0.0, normal / np.where(length > 0.0, length, 1.0), centre.normal)


def neighbours(array: np.ndarray) -> np.ndarray:
    """Return (9, H, W, …) copies of `array` shifted by up to one pixel; its border is repeated outward."""
    padded = np.pad(array, [(1, 1)] * 2 + [(0, 0)] * (array.ndim - 2), mode="edge")
    h, w = array.shape[:2]
    return np.stack([padded[i : i + h, j : j + w] for i in range(3) for j in range(3)])


def valid_pixels(position: np.ndarray, normal: np.ndarray, seen: np.ndarray, diagonal: float) -> np.ndarray:
    """Return (H, W) pixels whose 3×3 neighbours are visible, with normals within ANGLE, and within PLANE of the tangent plane."""
    turned = (neighbours(normal) * normal).sum(-1) >= np.cos(np.radians(ANGLE))
    flat = np.abs(((neighbours(position) - position) * normal).sum(-1)) <= PLANE * diagonal
    valid: np.ndarray = np.logical_and.reduce(turned & flat & neighbours(seen), axis=0)
    valid[[0, -1]] = valid[:, [0, -1]] = False
    return valid


def direct_light(tracer: Tracer, camera: Camera, hit: Hit, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return (H, W, 3) direct outgoing radiance at pixel centres, and (H, W) the pixels where a light's visibility changes.

    Visibility is tested at 3×3 points of every pixel, so that thin shadows count as well.
    """
    width, height = size
    direct = np.zeros((height, width, 3))
    strength, least, most = [], [], []
    for light in tracer.scene.lights:
        E, before = tracer.lit(light, hit)
        direct += image(hit.albedo * E / np.pi, size)
        strength.append(image(before, size).max(axis=-1))
        least.append(np.ones((height, width), bool))
        most.append(np.zeros((height, width), bool))
    for dx, dy in _within_a_pixel(3):
        sub = surface(view(tracer, camera, size, dx, dy), camera)
        for k, light in enumerate(tracer.scene.lights):
            E, before = tracer.lit(light, sub)
            # for surfaces turned away and outside of cones the light is zero, so visibility is as well
            visible = image(lights(E), size)
            strength[k] = np.maximum(strength[k], image(before, size).max(axis=-1))
            least[k] &= visible
            most[k] |= visible
    changes = np.zeros((height, width), bool)
    total = sum(strength).mean() if strength else 0.0
    for s, low, high in zip(strength, least, most, strict=True):
        differs = ~neighbours(low).all(axis=0) & neighbours(high).any(axis=0)
        changes |= differs & (neighbours(s).max(axis=0) > 1e-3 * total)
    return direct, changes


def _within_a_pixel(side: int) -> np.ndarray:
    """Return (side², 2) evenly spaced points of a pixel, 0..1 to the right and downward."""
    s = (np.arange(side) + 0.5) / side
    return np.stack(np.meshgrid(s, s), -1).reshape(-1, 2)


def distance_to(marked: np.ndarray) -> np.ndarray:
    """Return (H, W) uint8 Chebyshev distances to the nearest marked pixel, in pixels, at most 255."""
    from scipy import ndimage

    distance = ndimage.distance_transform_cdt(~marked, "chessboard") if marked.any() else np.full(marked.shape, 255)
    return np.asarray(np.minimum(distance, 255).astype(np.uint8))
