"""A path-traced view: irradiance in two halves, direct light, and the pixels where both may be compared.

Importing this needs the extra `reference`. `main` is the process that `irrsplat.reference.worker` starts.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from irrsplat.reference.path_tracer import Hit, Tracer, image, lights, look
from irrsplat.reference.worker import serve
from irrsplat.scene.model import Camera, Scene

ANGLE = 18.0  # degrees between a pixel's normal and its neighbours'
PLANE = 0.01  # distance of its neighbours from its tangent plane, in diagonals
FAR_FROM_EDGES = 3  # pixels: direct light is compared where a shadow's edge is farther than this
_PART = 1 << 22  # samples between two reports of progress


def trace(
    scene: Scene, camera: Camera, size: tuple[int, int], side: int, bounces: int, report: Callable[[float], object]
) -> dict[str, np.ndarray]:
    """The arrays of a `Traced` view of W×H pixels, irradiance of so many `bounces`, side² samples of each kind per pixel and
    half; report: called with the share done."""
    width, height = size
    tracer = Tracer(scene)
    hit = look(tracer, camera, size)
    position, normal, geometric = (image(v, size) for v in (hit.p, hit.n, hit.g))
    seen, smooth = image(hit.valid, size), valid_pixels(position, normal, image(hit.valid, size), scene.diagonal)
    direct, changes = direct_light(tracer, camera, hit, size)
    valid = smooth & ~image(hit.ambiguous, size)  # which way is "turned to the camera" there is a matter of taste

    p, n, g = (a[seen] for a in (position, normal, geometric))
    halves = np.zeros((2, height, width, 3), np.float32)
    step = min(max(_PART // (side * side), 1), 65536)  # below the distance of two seeds in Tracer.irradiance
    parts = [slice(k, k + step) for k in range(0, len(p), step)]
    found: list[list[np.ndarray]] = [[], []]
    for k, part in enumerate(parts):
        for half in range(2):
            found[half].append(tracer.irradiance(p[part], n[part], g[part], side, 2 * k + half + 1, bounces))
        report((k + 1) / len(parts))
    for half in range(2):
        halves[half][seen] = np.concatenate(found[half]) if parts else 0.0
    return {
        "halves": halves,
        "direct": np.where(seen[..., None], direct, 0.0).astype(np.float32),
        "albedo": np.where(seen[..., None], image(hit.albedo, size), 0.0).astype(np.float32),
        "emission": np.where(seen[..., None], image(hit.emission, size), scene.sky).astype(np.float32),
        "seen": seen,
        "valid": valid,
        "clear": valid & (distance_to(changes | ~smooth) > FAR_FROM_EDGES),
    }


def neighbours(array: np.ndarray, reach: int = 1) -> np.ndarray:
    """(windows, H, W, …) views of `array` shifted by up to `reach` pixels; its border is repeated outward."""
    width = [(reach, reach)] * 2 + [(0, 0)] * (array.ndim - 2)
    padded = np.pad(array, width, mode="edge")
    h, w = array.shape[:2]
    span = range(2 * reach + 1)
    return np.stack([padded[i : i + h, j : j + w] for i in span for j in span])


def valid_pixels(position: np.ndarray, normal: np.ndarray, seen: np.ndarray, diagonal: float) -> np.ndarray:
    """(H, W) pixels whose 3×3 neighbours are seen, have normals within ANGLE and lie within PLANE of the tangent plane."""
    turned = (neighbours(normal) * normal).sum(-1) >= np.cos(np.radians(ANGLE))
    flat = np.abs(((neighbours(position) - position) * normal).sum(-1)) <= PLANE * diagonal
    valid: np.ndarray = np.logical_and.reduce(turned & flat & neighbours(seen), axis=0)
    valid[[0, -1]] = valid[:, [0, -1]] = False
    return valid


def direct_light(tracer: Tracer, camera: Camera, hit: Hit, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) direct outgoing radiance at pixel centres, and (H, W) the pixels in which a light's visibility changes.

    Visibility is looked at in 3×3 points of every pixel, so that shadows thinner than a pixel count as well.
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
    for dx, dy in np.stack(np.meshgrid([1 / 6, 0.5, 5 / 6], [1 / 6, 0.5, 5 / 6]), -1).reshape(-1, 2):
        sub = look(tracer, camera, size, dx, dy)
        for k, light in enumerate(tracer.scene.lights):
            E, before = tracer.lit(light, sub)
            # where a surface turns away from the light, or a cone ends, visibility is what is left of the light: none
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


def distance_to(marked: np.ndarray, most: int = 255) -> np.ndarray:
    """(H, W) uint8 Chebyshev distance to the nearest marked pixel, in pixels, at most `most`."""
    distance = np.full(marked.shape, most, np.uint8)
    reached = marked.copy()
    for step in range(most):
        distance[reached & (distance == most)] = step
        if reached.all() or not reached.any():
            break
        reached = np.logical_or.reduce(neighbours(reached), axis=0)
    return distance


def main() -> None:
    """Answer the process that started this one with `trace`."""
    serve(trace)
