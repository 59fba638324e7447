"""Flicker in flight: change of irradiance at points of the world between consecutive frames."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from irrsplat.app.bench.fly_through import route
from irrsplat.app.common.terminal import columns, doing, out
from irrsplat.core.color import LUMINANCE
from irrsplat.gpu.target import pixels
from irrsplat.image.view import View
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera, Scene

FRAMES = 60
SIZE = [800, 600]
TICK = 0.08  # seconds per frame, as in the viewer
JUMP = 0.05  # relative change of irradiance that counts as a jump
LEGEND = """\
changes of irradiance at fixed places between frames of 80 ms: RMS of the relative change, share of pixels that change by over 5 %
first: flight without records; second: the same flight with the records of the first
settled: flight with all records along the path, which gives the floor of the measure\
"""
_DARK = 0.02  # share of a frame's mean luminance: lower bound for relative changes
_ALIKE = 0.95  # least cosine between the normals of one point in two frames


@dataclass(frozen=True)
class Flicker:
    """One flight: rms relative change of luminance between frames, share of `jumps`, median frame milliseconds, final records."""

    scene: str
    case: str
    rms: float
    jumps: float
    median_ms: float
    records: int


@dataclass(frozen=True)
class _Seen:
    """One frame: luminance of irradiance (H, W), position and depth (H, W, 4), normal (H, W, 3), top row first."""

    camera: Camera
    luminance: np.ndarray
    position: np.ndarray
    normal: np.ndarray

    @classmethod
    def of(cls, view: View) -> _Seen:
        sums = pixels(view.sums)
        luminance = (sums[..., :3] @ LUMINANCE) / np.maximum(sums[..., 3], 1e-20)
        position, normal = pixels(view.gbuffer.position).copy(), pixels(view.gbuffer.normal)[..., :3].copy()
        return cls(view.camera, luminance, position, normal)

    def since(self, before: _Seen) -> np.ndarray:
        """Return the relative change (N,) of luminance since the frame `before`, at pixels visible in both frames.

        All four pixels around the reprojected point must lie within a pixel's size of its plane and have a similar normal.
        """
        height, width = self.luminance.shape
        camera, seen = before.camera, self.position[..., 3] > 0.0
        p, n, now = self.position[seen][:, :3], self.normal[seen], self.luminance[seen]
        right, up, backward = camera.axes
        away = p - np.asarray(camera.eye)
        depth = -(away @ backward)
        scale = height / (camera.screen * np.maximum(depth, 1e-9))  # pixels per metre
        x = away @ right * scale + 0.5 * width - 0.5
        y = 0.5 * height - 0.5 - away @ up * scale
        left, top = np.floor(x).astype(int), np.floor(y).astype(int)
        here = (depth > 0.0) & (left >= 0) & (top >= 0) & (left < width - 1) & (top < height - 1)
        p, n, now, x, y, left, top = (v[here] for v in (p, n, now, x, y, left, top))
        tolerance = 1.0 / scale[here]
        same, then = np.ones(len(p), bool), np.zeros(len(p))
        for j in (0, 1):
            for i in (0, 1):
                row, column = top + j, left + i
                q, m = before.position[row, column], before.normal[row, column]
                off = np.abs(((q[:, :3] - p) * n).sum(-1))
                same &= (q[:, 3] > 0.0) & (off < tolerance) & ((m * n).sum(-1) > _ALIKE)
                then += np.abs(1 - i - (x - left)) * np.abs(1 - j - (y - top)) * before.luminance[row, column]
        floor = _DARK * float(self.luminance[seen].mean(dtype=float)) + 1e-20
        change: np.ndarray = np.abs(now - then) / np.maximum(0.5 * (now + then), floor)
        return change[same]


def run(scenes: Sequence[Scene], size: tuple[int, int], preset: str) -> list[dict[str, object]]:
    """Measure every scene, print a table, and return its rows for JSON."""
    out(f"flights of {FRAMES} frames, {size[0]}x{size[1]}")
    out(LEGEND)
    found = [flicker for scene in scenes for flicker in measure(scene, size, preset)]
    rows = [("scene", "flight", "rms", "above 5 %", "median ms", "records")]
    rows += [(f.scene, f.case, f"{f.rms:.2%}", f"{f.jumps:.3%}", f"{f.median_ms:.0f}", str(f.records)) for f in found]
    out("\n".join(columns(rows, left=2)))
    return [asdict(flicker) for flicker in found]


def measure(scene: Scene, size: tuple[int, int], preset: str) -> Iterator[Flicker]:
    """Yield the flights "first", "second" and "settled" through `scene` in views of `size`."""
    path = route(scene)
    cameras = [path.camera(t) for t in np.linspace(0.0, path.frames - 1, FRAMES)]
    with Renderer(scene, size, preset, tile_size=0) as renderer:
        doing(f"{scene.name}: compiling, and the surface cache")
        renderer.converge(cameras[0])
        renderer.forget(lights=False)
        for case in ("first", "second"):
            doing(f"{scene.name}: {case} flight")
            yield _flight(case, renderer, cameras, TICK)
        doing(f"{scene.name}: gathering along the way")
        for camera in cameras:
            renderer.converge(camera)
        doing(f"{scene.name}: settled flight")
        yield _flight("settled", renderer, cameras, None)
    doing("")


def _flight(case: str, renderer: Renderer, cameras: Sequence[Camera], seconds: float | None) -> Flicker:
    """Measure one flight with a frame budget in seconds; None: no limit."""
    squares = jumps = count = 0.0
    ms: list[float] = []
    before: _Seen | None = None
    for camera in cameras:
        start = time.perf_counter()
        view, _ = renderer.frame(camera, seconds)
        renderer.ctx.finish()
        ms.append(1e3 * (time.perf_counter() - start))
        seen = _Seen.of(view)
        if before is not None:
            off = seen.since(before)
            squares, jumps, count = squares + float(off @ off), jumps + np.count_nonzero(off > JUMP), count + len(off)
        before = seen
    rms, share = float(np.sqrt(squares / max(count, 1.0))), jumps / max(count, 1.0)
    return Flicker(renderer.scene.name, case, rms, share, float(np.median(ms)), renderer.cache.count)
