"""Change of light between consecutive frames of a film at identical points, without interpolation between pixels.

The points visible in a frame are projected into the previous frame, and the records are splatted there with its camera.
Differences result from changes of the records and of their radii per view.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise

import moderngl
import numpy as np

from irrsplat.app.bench.flicker import FRAMES, JUMP, Flicker, change, table
from irrsplat.app.bench.fly_through import route
from irrsplat.app.common.terminal import doing, out
from irrsplat.app.film.fill import fill
from irrsplat.app.film.flight import Flight
from irrsplat.core.color import LUMINANCE
from irrsplat.gpu.target import float_texture, pixels
from irrsplat.indirect.splat import SplatPass
from irrsplat.records.culling import reaching
from irrsplat.renderer import Renderer
from irrsplat.scene.camera_path import Path
from irrsplat.scene.model import Camera, Scene

LEGEND = """\
films: changes at equal places between two frames, by the records of each frame
film: each frame gathers missing records; frozen: all frames use one cache that was filled along the path\
"""
_SAME = 0.01  # share of the distance: tolerance for a point to count as visible in the previous frame


@dataclass(frozen=True)
class Places:
    """Visible points of a camera: position and depth, normal, and lit normal, (H, W, 4) each, top row first."""

    camera: Camera
    position: np.ndarray
    normal: np.ndarray
    lit_normal: np.ndarray

    @classmethod
    def seen(cls, renderer: Renderer, camera: Camera) -> Places:
        """Return the points visible from `camera`, in world space."""
        local = camera.shifted(np.negative(renderer.scene.origin))
        gbuffer = renderer.draw_gbuffer(local)
        return cls(local, *(pixels(one).copy() for one in (gbuffer.position, gbuffer.normal, gbuffer.lit_normal)))

    def put_where(self, before: Places) -> tuple[Places, np.ndarray]:
        """Return these points at their pixels in the previous frame, and (H, W) their own pixel numbers, -1 for none."""
        height, width = self.position.shape[:2]
        camera, depth = before.camera, self.position[..., 3]
        (numbers,) = np.nonzero(depth.ravel() > 0.0)
        right, up, backward = camera.axes
        away = self.position.reshape(-1, 4)[numbers, :3] - np.asarray(camera.eye)
        z = -(away @ backward)
        scale = height / (camera.screen * np.maximum(z, 1e-9))  # pixels per metre
        x = np.floor(away @ right * scale + 0.5 * width).astype(int)
        y = np.floor(0.5 * height - away @ up * scale).astype(int)
        here = (z > 0.0) & (x >= 0) & (y >= 0) & (x < width) & (y < height)
        numbers, x, y, z = (v[here] for v in (numbers, x, y, z))
        here = np.abs(before.position[y, x, 3] - z) < _SAME * z
        numbers, x, y, z = (v[here] for v in (numbers, x, y, z))
        position, normal, lit_normal = np.zeros((3, height, width, 4), "f4")
        own = np.full((height, width), -1)
        own[y, x] = numbers
        position[y, x] = np.column_stack([self.position.reshape(-1, 4)[numbers, :3], z])
        normal[y, x] = self.normal.reshape(-1, 4)[numbers]
        lit_normal[y, x] = self.lit_normal.reshape(-1, 4)[numbers]
        return Places(camera, position, normal, lit_normal), own


def run(scenes: Sequence[Scene], size: tuple[int, int], preset: str) -> list[dict[str, object]]:
    """Measure every scene, print a table, and return its rows for JSON."""
    out(LEGEND)
    found: list[Flicker] = []
    for scene in scenes:
        doing(f"{scene.name}: films")
        found += measure(scene, size, preset, FRAMES)
    doing("")
    out("\n".join(table(found)))
    return [asdict(one) for one in found]


def measure(scene: Scene, size: tuple[int, int], preset: str, frames: int) -> Iterator[Flicker]:
    """Yield the films "film" and "frozen" along the benchmark's flight through `scene`."""
    path = Path(route(scene).keys, frames)
    with Renderer(scene, size, preset, tile_size=0) as renderer:
        for frozen in (False, True):
            renderer.forget(lights=False)
            if frozen:
                fill(renderer, Flight(path, range(frames)))
            yield film_flicker(renderer, list(path), frozen)


def film_flicker(renderer: Renderer, cameras: Sequence[Camera], frozen: bool) -> Flicker:
    """Return the change of irradiance between frames of the film by `cameras`.

    frozen: use existing records only; otherwise each frame gathers missing records.
    """
    squares = jumps = count = 0.0
    ms: list[float] = []
    textures = [float_texture(renderer.ctx, renderer.size, 4) for _ in range(3)]
    splat = SplatPass(renderer.ctx, renderer.size, renderer.settings.gradients)
    try:
        start = time.perf_counter()
        renderer.render(cameras[0], gather=not frozen, buffers=("irradiance",))
        for camera, following in pairwise(cameras):
            ms.append(1e3 * (time.perf_counter() - start))
            places, own = Places.seen(renderer, following).put_where(Places.seen(renderer, camera))
            then, there = _luminance(renderer, places, splat, textures)
            start = time.perf_counter()
            frame = renderer.render(following, gather=not frozen, buffers=("irradiance", "depth"))
            now = frame.irradiance @ LUMINANCE
            both = (own >= 0) & there
            off = change(now.ravel()[own[both]], then[both], float(now[np.isfinite(frame.depth)].mean(dtype=float)))
            squares, jumps, count = squares + float(off @ off), jumps + np.count_nonzero(off > JUMP), count + len(off)
    finally:
        splat.release()
        for texture in textures:
            texture.release()
    rms, share = float(np.sqrt(squares / max(count, 1.0))), float(jumps / max(count, 1.0))
    case = "frozen" if frozen else "film"
    return Flicker(renderer.scene.name, case, rms, share, float(np.median(ms)), renderer.cache.count)


def _luminance(
    renderer: Renderer, places: Places, splat: SplatPass, textures: Sequence[moderngl.Texture]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the luminance (H, W) of the records' irradiance at these points in their camera's view, and its coverage."""
    for texture, values in zip(textures, (places.position, places.normal, places.lit_normal), strict=True):
        texture.write(np.ascontiguousarray(values[::-1]).tobytes())
    seen = renderer.draw_gbuffer(places.camera)
    bent = textures[2] if seen.mapped_normal is not None else None
    gbuffer = replace(seen, position=textures[0], normal=textures[1], mapped_normal=bent)
    splat.clear(gbuffer)
    numbers = reaching(renderer.cache, 0, places.camera, renderer.size, renderer.settings)
    splat(renderer.cache.records, numbers, gbuffer, places.camera, renderer.settings)
    sums = pixels(splat.target(1).textures[0])
    return (sums[..., :3] @ LUMINANCE) / np.maximum(sums[..., 3], 1e-20), sums[..., 3] > 0.0
