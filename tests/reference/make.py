"""Make the reference data of the bundled scenes: `python -m tests.reference.make [SCENE …]` (extra `reference`).

For each scene, tests/reference/<scene>.npz holds the truth at some thousand random pixels of a 400×400 image from the
default camera (tests/truth.py says what it holds, and compares frames with it). Samples are added, in two independent
halves, until the halves agree; the random numbers are seeded. Run it again whenever a scene changes.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

from irrsplat.scene import load
from irrsplat.scene.model import Camera, Scene
from tests.reference.tracer import Hit, Tracer, choose_variant, lights, mi
from tests.truth import FOLDER, SIZE, camera_numbers, load_reference, scene_hash

SCENES = ("cornell", "cornell-paper", "furnace", "door", "curved", "atrium")
POINTS = 3000  # pixels kept per scene
SIDE = 32  # side² stratified samples of each kind per pass
ANGLE = 18.0  # degrees between a pixel's normal and its neighbours'
PLANE = 0.01  # distance of its neighbours from its tangent plane, in diagonals


def camera_rays(camera: Camera, size: int, dx: Any = 0.5, dy: Any = 0.5) -> np.ndarray:
    """(size², 3) unit directions, row by row from the top, through the point (dx, dy) of every pixel (0.5: its centre).

    dx, dy: 0..1 to the right and downward, one number or (size, size).
    """
    row, column = np.indices((size, size))
    slope = np.tan(np.radians(camera.fov) / 2.0)
    x = ((column + dx) / size * 2.0 - 1.0) * slope
    y = (1.0 - (row + dy) / size * 2.0) * slope
    world = np.stack([x, y, -np.ones_like(x)], axis=-1).reshape(-1, 3) @ camera.axes
    return world / np.linalg.norm(world, axis=1, keepdims=True)


def look(tracer: Tracer, camera: Camera, size: int, dx: Any = 0.5, dy: Any = 0.5) -> Hit:
    """What the camera sees through one point of every pixel, as camera_rays has it; one lane per pixel."""
    return tracer.hit(mi.Point3f(*camera.eye), mi.Vector3f(camera_rays(camera, size, dx, dy).T))


def image(values: Any, size: int) -> np.ndarray:
    """(size, size, …) array of what lies in `size`² lanes."""
    array = np.array(values)
    return array.T.reshape(size, size, -1) if array.ndim == 2 else array.reshape(size, size)


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
    valid = np.logical_and.reduce(turned & flat & neighbours(seen), axis=0)
    valid[[0, -1]] = valid[:, [0, -1]] = False
    return valid


def direct_light(tracer: Tracer, camera: Camera, hit: Hit, size: int) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) direct outgoing radiance at pixel centres, and (H, W) the pixels in which a light's visibility changes.

    Visibility is looked at in 3×3 points of every pixel, so that shadows thinner than a pixel count as well.
    """
    direct = np.zeros((size, size, 3))
    strength, least, most = [], [], []
    for light in tracer.scene.lights:
        E, before = tracer.lit(light, hit)
        direct += image(hit.albedo * E / np.pi, size)
        strength.append(image(before, size).max(axis=-1))
        least.append(np.ones((size, size), bool))
        most.append(np.zeros((size, size), bool))
    for dx, dy in np.stack(np.meshgrid([1 / 6, 0.5, 5 / 6], [1 / 6, 0.5, 5 / 6]), -1).reshape(-1, 2):
        sub = look(tracer, camera, size, dx, dy)
        for k, light in enumerate(tracer.scene.lights):
            E, before = tracer.lit(light, sub)
            # where a surface turns away from the light, or a cone ends, visibility is what is left of the light: none
            visible = image(lights(E), size)
            strength[k] = np.maximum(strength[k], image(before, size).max(axis=-1))
            least[k] &= visible
            most[k] |= visible
    changes = np.zeros((size, size), bool)
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


def converge(tracer: Tracer, p: np.ndarray, n: np.ndarray, g: np.ndarray, goal: float, seconds: float) -> dict[str, Any]:
    """E_1 at the points from two independent halves, sampled until they agree within `goal` (relative RMS) or time is up."""
    sums = np.zeros((2, len(p), 3))
    start, passes, agreement = time.monotonic(), 0, np.inf
    while True:
        for half in range(2):
            sums[half] += tracer.irradiance(p, n, g, SIDE, seed=2 * passes + half + 1)
        passes += 1
        halves = sums / passes
        agreement = np.sqrt(np.mean((halves[0] - halves[1]) ** 2)) / max(halves.mean(), 1e-20)
        if (passes >= 4 and agreement <= goal) or time.monotonic() - start > seconds:
            break
    return {
        "irradiance": halves.mean(axis=0),
        "noise": np.abs(halves[0] - halves[1]) / 2.0,
        "agreement": float(agreement),
        "samples": 2 * passes * SIDE * SIDE,
    }


def make(scene: Scene, name: str, points: int, goal: float, seconds: float) -> dict[str, Any]:
    """The arrays of one reference."""
    tracer, camera = Tracer(scene), scene.cameras[0]
    hit = look(tracer, camera, SIZE)
    position, normal, geometric = (image(v, SIZE) for v in (hit.p, hit.n, hit.g))
    valid = valid_pixels(position, normal, image(hit.valid, SIZE), scene.diagonal)
    direct, changes = direct_light(tracer, camera, hit, SIZE)
    edge = distance_to(changes | ~valid)
    valid &= ~image(hit.ambiguous, SIZE)  # which way is "turned to the camera" there is a matter of taste

    pixels = np.argwhere(valid)
    if len(pixels) > points:
        pixels = np.random.default_rng(0).permutation(pixels)[:points]
    pixels = pixels[np.lexsort(pixels.T[::-1])]
    row, column = pixels.T
    p, n, g = (a[row, column] for a in (position, normal, geometric))
    found = converge(tracer, p, n, g, goal, seconds)
    return {
        "scene": name,
        "hash": scene_hash(scene),
        "diagonal": scene.diagonal,
        "camera": camera_numbers(camera),
        "samples": found["samples"],
        "agreement": found["agreement"],
        "pixels": pixels.astype(np.int16),
        "position": shorten(p, 16),
        "normal": n.astype(np.float16),
        "irradiance": shorten(found["irradiance"], 13),
        "direct": shorten(direct[row, column], 12),
        "edge": edge[row, column],
        "noise": shorten(found["noise"], 6),
    }


def shorten(values: np.ndarray, bits: int) -> np.ndarray:
    """`values` as float32 rounded to `bits` of mantissa (a relative error of 2^−(bits+1)), which compress well."""
    drop = 23 - bits
    integer = np.ascontiguousarray(values, np.float32).view(np.uint32).astype(np.uint64) + (1 << (drop - 1))
    return (integer >> drop << drop).astype(np.uint32).view(np.float32)


def main() -> None:
    """Make the references that the command line names."""
    parser = argparse.ArgumentParser(prog="python -m tests.reference.make", description="Make the reference data of the tests.")
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE", help=f"of {', '.join(SCENES)}; default: all")
    parser.add_argument("--agree", type=float, default=0.002, help="relative difference of the halves to reach (0.002)")
    parser.add_argument("--seconds", type=float, default=180.0, help="time after which to stop sampling a scene (180)")
    parser.add_argument("--points", type=int, default=POINTS, help=f"pixels per scene ({POINTS})")
    parser.add_argument("--stale", action="store_true", help="only scenes that have changed since their reference was made")
    options = parser.parse_args()
    print(f"Mitsuba {mi.__version__}, {choose_variant()}")
    for name in options.scenes:
        scene = load(name)
        path = FOLDER / f"{name}.npz"
        if options.stale and path.exists() and load_reference(name).hash == scene_hash(scene):
            continue
        start = time.monotonic()
        arrays = make(scene, name, options.points, options.agree, options.seconds)
        assert all(np.isfinite(v).all() for v in arrays.values() if isinstance(v, np.ndarray)), name
        np.savez_compressed(path, **arrays)
        print(
            f"{name:14} {len(arrays['pixels'])} pixels, {arrays['samples']} samples, halves agree within "
            f"{100 * arrays['agreement']:.2f} %, mean E {arrays['irradiance'].mean():.5g}, "
            f"{np.mean(arrays['edge'] > 3):.0%} far from edges, {path.stat().st_size / 1000:.0f} kB, "
            f"{time.monotonic() - start:.0f} s"
        )


if __name__ == "__main__":
    main()
