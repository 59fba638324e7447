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

from irrsplat.errors import IrrsplatError
from irrsplat.reference.tracer import Tracer, choose_variant, image, look, mi
from irrsplat.reference.view import direct_light, distance_to, valid_pixels
from irrsplat.scene import load
from irrsplat.scene.model import Scene
from tests.truth import FOLDER, SIZE, camera_numbers, load_reference, scene_hash

SCENES = ("cornell", "cornell-paper", "furnace", "door", "curved", "atrium")
POINTS = 3000  # pixels kept per scene
SIDE = 32  # side² stratified samples of each kind per pass


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
    tracer, camera, size = Tracer(scene), scene.cameras[0], (SIZE, SIZE)
    hit = look(tracer, camera, size)
    position, normal, geometric = (image(v, size) for v in (hit.p, hit.n, hit.g))
    valid = valid_pixels(position, normal, image(hit.valid, size), scene.diagonal)
    direct, changes = direct_light(tracer, camera, hit, size)
    edge = distance_to(changes | ~valid)
    valid &= ~image(hit.ambiguous, size)  # which way is "turned to the camera" there is a matter of taste

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
    try:
        print(f"Mitsuba {mi.__version__}, {choose_variant()}")
    except IrrsplatError as error:
        raise SystemExit(f"reference: {error}") from error
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
