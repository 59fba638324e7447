"""The truth that the benchmark's errors are told by: a fine gather at random pixels of a view, made once and kept."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from irrsplat import exact, paper
from irrsplat.app.terminal import say
from irrsplat.errors import IrrsplatError
from irrsplat.reference import store
from irrsplat.reference.traced import kept

if TYPE_CHECKING:
    from irrsplat.renderer import Renderer
    from irrsplat.scene.model import Camera

VERSION = 1  # of what is gathered and how
COUNT = 2000  # pixels
SECONDS = 240.0  # after which fewer must do
SHADOW_SIZE = 2048  # texels


def truth(renderer: Renderer, camera: Camera) -> exact.Truth | None:
    """Indirect irradiance of one bounce, as the scene is lit now, at COUNT smooth pixels of a view of the renderer's size, from
    the user's cache folder or gathered now; of more bounces the path-traced truth of `verify` where it is there.

    None where there is none, and where no pixel can be compared.
    """
    scene, size, bounces = renderer.scene, renderer.size, renderer.settings.bounces
    if bounces != 1:
        traced = kept(scene, camera, size, bounces)
        if traced is None or not traced.valid.any():
            return None
        return exact.Truth(np.argwhere(traced.valid), traced.irradiance[traced.valid])
    try:
        key = store.key_of(scene, camera, VERSION, size, exact.SIDE, COUNT, SHADOW_SIZE)
        path = store.folder() / f"gather-{key}.npz"
        if (found := _read(path, size)) is not None:
            return found
    except store.DAMAGE:
        say(f"notice: {path}: damaged; the truth is gathered again")
    except IrrsplatError as error:
        say(f"notice: {error}")
        path = None
    view, _ = renderer.frame(camera, gather=False)
    with renderer.ctx:
        seen = paper.read_back(view.gbuffer)
        found = exact.gather(renderer.ctx, scene, renderer.geometry, seen, SHADOW_SIZE, COUNT, SECONDS)
    if not len(found.pixels):
        return None
    if path is not None:
        try:
            store.write(path, {"pixels": found.pixels, "irradiance": found.irradiance})
        except OSError as error:
            say(f"notice: {path}: cannot keep the truth for the next time: {error.strerror or error}")
    return found


def _read(path: Path, size: tuple[int, int]) -> exact.Truth | None:
    """The truth in a file, None where there is no file; raises one of store.DAMAGE for what is none of a view of that size."""
    arrays = store.read(path)
    if arrays is None:
        return None
    pixels, irradiance = arrays["pixels"], arrays["irradiance"]
    whole = pixels.ndim == 2 and pixels.shape[1] == 2 and len(pixels) > 0 and pixels.dtype.kind == "i"
    if not whole or irradiance.shape != (len(pixels), 3) or not np.isfinite(irradiance).all():
        raise ValueError("not what irrsplat writes")
    if pixels.min() < 0 or (pixels >= size[::-1]).any():
        raise ValueError("pixels outside the view")
    return exact.Truth(pixels, irradiance)
