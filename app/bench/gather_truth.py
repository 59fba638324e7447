"""Reference of the benchmark's errors: a fine gather at random pixels of a view, computed once and stored."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np

from irrsplat.app.common.terminal import say
from irrsplat.indirect import paper_scan
from irrsplat.reference import disk_cache, fine_gather, worker
from irrsplat.reference.truth import kept, vertices
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera

VERSION = 2  # version of the reference's method
COUNT = 2000  # pixels
SIDE = 64  # of the two grids of paths at each
SECONDS = 240.0  # time limit, after which fewer pixels suffice
SHADOW_SIZE = 2048  # texels


def truth(renderer: Renderer, camera: Camera, trace: bool = False) -> fine_gather.Truth | None:
    """Return the reference irradiance at COUNT smooth pixels of a view of the renderer's size.

    One bounce: a fine gather under the present lights, from the user's cache folder or new. More bounces: the path-traced
    reference of `verify`, if it exists; trace: else a new one at COUNT pixels, if Mitsuba is installed. None without a reference
    or without comparable pixels.
    """
    scene, size, bounces = renderer.scene, renderer.size, renderer.settings.bounces
    if bounces != 1:
        traced = kept(scene, camera, size, bounces)
        if traced is not None and traced.valid.any():
            return fine_gather.Truth(np.argwhere(traced.valid), traced.irradiance[traced.valid])
        if traced is not None or not trace or importlib.util.find_spec("mitsuba") is None:
            return None
    how = (fine_gather.SIDE, COUNT, SHADOW_SIZE) if bounces == 1 else (SIDE, COUNT, vertices(bounces))
    key = disk_cache.key_of(scene, camera, VERSION, size, *how)

    def make() -> fine_gather.Truth:
        view, _ = renderer.frame(camera, gather=False)
        with renderer.ctx:
            seen = paper_scan.read_back(view.gbuffer)
            if bounces == 1:
                return fine_gather.gather(renderer.world, seen, SHADOW_SIZE, COUNT, SECONDS)
            pixels = fine_gather.chosen(seen, scene, COUNT)
            at = tuple(pixels.T)
            points = seen.position[at], seen.lit_normal[at], seen.geometric[at]
            irradiance: np.ndarray = worker.call("at_points", (scene, points, SIDE, vertices(bounces)))
            return fine_gather.Truth(pixels, irradiance)

    name = f"{'gather' if bounces == 1 else 'points'}-{key}.npz"
    found = disk_cache.kept(name, lambda path: _read(path, size), make, lambda line: say(f"notice: {line}"))
    return found if len(found.pixels) else None


def _read(path: Path, size: tuple[int, int]) -> fine_gather.Truth:
    """Return the reference in a file; raise FileNotFoundError without a file, one of files.DAMAGE for another view."""
    arrays = disk_cache.read(path)
    pixels, irradiance = arrays["pixels"], arrays["irradiance"]
    whole = pixels.ndim == 2 and pixels.shape[1] == 2 and pixels.dtype.kind == "i"
    if not whole or irradiance.shape != (len(pixels), 3) or not np.isfinite(irradiance).all():
        raise ValueError("not what irrsplat writes")
    if (pixels < 0).any() or (pixels >= size[::-1]).any():
        raise ValueError("pixels outside the view")
    return fine_gather.Truth(pixels, irradiance)
