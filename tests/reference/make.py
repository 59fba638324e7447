"""Make the reference data of the bundled scenes: `python -m tests.reference.make [SCENE …]` (extra `reference`).

For each scene, tests/reference/<scene>.npz holds references of one bounce and of all bounces. They are of some thousand random
pixels of a 400×400 image from the default camera. tests/support/truth.py documents the files and compares frames with them.
Two independent halves of samples grow until the halves agree. Random numbers are seeded. Run it again whenever a scene changes.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import mitsuba as mi
import numpy as np

from irrsplat.core.errors import IrrsplatError
from irrsplat.reference.path_tracer import Tracer, choose_variant, image, surface, view
from irrsplat.reference.trace_view import direct_light, distance_to, valid_pixels
from irrsplat.reference.truth import MOST_BOUNCES
from irrsplat.scene import load
from irrsplat.scene.model import Scene
from tests.support.truth import FOLDER, SIZE, camera_numbers, scene_hash

SCENES = ("cornell", "cornell-paper", "furnace", "door", "curved", "atrium")
POINTS = 3000  # pixels kept per scene
SIDE = 32  # side² stratified samples of each kind per pass
Points = tuple[np.ndarray, np.ndarray, np.ndarray]  # position, shading normal, geometric normal


def converge(tracer: Tracer, points: Points, bounces: int, goal: float, seconds: float) -> dict[str, Any]:
    """E at the points from two independent halves, sampled until they agree within `goal` (relative RMS) or time is up."""
    sums = np.zeros((2, *points[0].shape))
    start, passes, agreement = time.monotonic(), 0, np.inf
    while True:
        for half in range(2):
            sums[half] += tracer.irradiance(*points, SIDE, seed=2 * passes + half + 1, bounces=bounces)
        passes += 1
        halves = sums / passes
        agreement = np.sqrt(np.mean((halves[0] - halves[1]) ** 2)) / max(halves.mean(), 1e-20)
        if (passes >= 4 and agreement <= goal) or time.monotonic() - start > seconds:
            break
    return {
        "irradiance": shorten(halves.mean(axis=0), 13),
        "noise": shorten(np.abs(halves[0] - halves[1]) / 2.0, 6),
        "agreement": float(agreement),
        "samples": 2 * passes * SIDE * SIDE,
    }


def make(scene: Scene, name: str, options: argparse.Namespace, old: dict[str, Any] | None) -> dict[str, Any]:
    """The arrays of one reference; what an `old` one of the same scene has of one bounce, and of all, is kept."""
    tracer, camera, size = Tracer(scene), scene.cameras[0], (SIZE, SIZE)
    hit = surface(view(tracer, camera, size), camera)
    position, normal, geometric = (image(v, size) for v in (hit.p, hit.n, hit.g))
    valid = valid_pixels(position, normal, image(hit.valid, size), scene.diagonal)
    direct, changes = direct_light(tracer, camera, hit, size)
    edge = distance_to(changes | ~valid)
    valid &= ~image(hit.ambiguous, size)  # which way is "turned to the camera" there is a matter of taste

    pixels = np.argwhere(valid)
    if len(pixels) > options.points:
        pixels = np.random.default_rng(0).permutation(pixels)[: options.points]
    pixels = pixels[np.lexsort(pixels.T[::-1])]
    row, column = pixels.T
    p, n, g = (a[row, column] for a in (position, normal, geometric))
    found: dict[str, Any] = {}
    for suffix, bounces, goal in (("", 1, options.agree), ("_all", MOST_BOUNCES, options.agree_all)):
        names = [f"{part}{suffix}" for part in ("irradiance", "noise", "agreement", "samples")]
        if old is not None and old.keys() >= set(names):
            assert np.array_equal(old["pixels"], pixels), f"{name}: the old pixels are others; make all of it anew"
            found |= {key: old[key] for key in names}
        else:
            made = converge(tracer, (p, n, g), bounces, goal, options.seconds)
            found |= {f"{part}{suffix}": value for part, value in made.items()}
    return found | {
        "scene": name,
        "hash": scene_hash(scene),
        "diagonal": scene.diagonal,
        "camera": camera_numbers(camera),
        "pixels": pixels.astype(np.int16),
        "position": shorten(p, 16),
        "normal": n.astype(np.float16),
        "direct": shorten(direct[row, column], 12),
        "edge": edge[row, column],
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
    parser.add_argument("--agree", type=float, default=0.002, help="relative difference of one bounce's halves to reach (0.002)")
    parser.add_argument("--agree-all", type=float, default=0.008, help="and of all bounces' halves (0.008)")
    parser.add_argument("--seconds", type=float, default=180.0, help="time after which to stop sampling either (180)")
    parser.add_argument("--points", type=int, default=POINTS, help=f"pixels per scene ({POINTS})")
    parser.add_argument("--missing", action="store_true", help="only what is missing, or of a scene that has changed since")
    options = parser.parse_args()
    try:
        print(f"Mitsuba {mi.__version__}, {choose_variant()}")
    except IrrsplatError as error:
        raise SystemExit(f"reference: {error}") from error
    for name in options.scenes:
        scene, path, old = load(name), FOLDER / f"{name}.npz", None
        if options.missing and path.exists():
            with np.load(path) as data:
                old = dict(data) if data["hash"] == scene_hash(scene) else None
            if old is not None and "irradiance_all" in old:
                continue
        start = time.monotonic()
        arrays = make(scene, name, options, old)
        assert all(np.isfinite(v).all() for v in arrays.values() if isinstance(v, np.ndarray) and v.ndim), name
        np.savez_compressed(path, **arrays)
        for suffix, what in (("", "one bounce"), ("_all", "all bounces")):
            print(
                f"{name:14} {what}: {arrays[f'samples{suffix}']} samples, halves agree within "
                f"{100 * arrays[f'agreement{suffix}']:.2f} %, mean E {arrays[f'irradiance{suffix}'].mean():.5g}"
            )
        print(
            f"{name:14} {len(arrays['pixels'])} pixels, {np.mean(arrays['edge'] > 3):.0%} far from edges, "
            f"{path.stat().st_size / 1000:.0f} kB, {time.monotonic() - start:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
