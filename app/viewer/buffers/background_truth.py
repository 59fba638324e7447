"""The path-traced truth of the view on show: traced in a thread, coarser than the window, and kept for the last few views."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from threading import Event, Thread

import moderngl
import numpy as np

from irrsplat.app.common.error_colours import FULL
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import table_texture
from irrsplat.reference.truth import Traced, in_words, traced
from irrsplat.scene.model import Camera, Scene

SAMPLES = 512  # of each kind per pixel
HEIGHT = 200  # rows that are traced at most, about
KEPT = 4  # views
_JOIN = 2.0  # seconds that closing waits for a thread that was told to stop


@dataclass(frozen=True)
class Lattice:
    """The pixels of a view that are traced: the middle one of every square of `stride`² pixels.

    count: squares across and down. margin: pixels by which they overlap the view on either side, in x and y.
    """

    stride: int
    count: tuple[int, int]
    margin: tuple[int, int]

    @staticmethod
    def of(size: tuple[int, int]) -> Lattice:
        """The lattice of a view of size (W, H)."""
        stride = -(-size[1] // HEIGHT)
        stride += 1 - stride % 2  # odd, so that a pixel is in the middle
        least = [-(-pixels // stride) for pixels in size]
        # both margins are whole pixels where the squares' pixels are even or odd as the view's are
        across, down = (n + (n * stride - pixels) % 2 for n, pixels in zip(least, size, strict=True))
        return Lattice(stride, (across, down), ((across * stride - size[0]) // 2, (down * stride - size[1]) // 2))

    def camera(self, camera: Camera, size: tuple[int, int]) -> Camera:
        """The camera whose pixel centres, in a picture of `count`, are those of the traced pixels in `camera`'s of (W, H)."""
        if self.stride == 1:
            return camera
        screen = camera.screen * self.stride * self.count[1] / size[1]
        return replace(camera, fov=math.degrees(2.0 * math.atan(screen / 2.0)))

    def cell(self, x: int, y: int) -> tuple[int, int]:
        """The square that the view's pixel (x, y) lies in, both from the upper left (or both from the lower left)."""
        return (x + self.margin[0]) // self.stride, (y + self.margin[1]) // self.stride

    def middle(self, cell: tuple[int, int], size: tuple[int, int]) -> tuple[int, int]:
        """The traced pixel of a square; of one whose middle lies outside the view, the nearest pixel inside."""
        places = (c * self.stride + self.stride // 2 - m for c, m in zip(cell, self.margin, strict=True))
        x, y = (min(max(place, 0), pixels - 1) for place, pixels in zip(places, size, strict=True))
        return x, y


@dataclass(frozen=True)
class Truth:
    """The truth of one view on the GPU.

    values: RGBA32F texture of a texel per square of the lattice, bottom row first: rgb indirect irradiance of so many `bounces`
    in W/m², a 1 where there is a surface, else 0. full: the error shown in full colour, W/m². about: how it was traced.
    """

    scene: Scene
    camera: Camera
    size: tuple[int, int]
    bounces: int | str
    lattice: Lattice
    values: moderngl.Texture
    full: float
    about: str

    def is_of(self, scene: Scene, camera: Camera, size: tuple[int, int], bounces: int | str) -> bool:
        """Whether this is what `camera` sees of `scene` as it is lit now, by so many bounces, in a picture of `size`; names do
        not count."""
        mine, other = ((c.eye, c.target, c.up, c.fov) for c in (self.camera, camera))
        mine_lit, other_lit = ((s.lights, s.sky, s.sky_gradient, s.up, s.environment) for s in (self.scene, scene))
        lit = mine_lit == other_lit
        return self.scene.meshes is scene.meshes and lit and (self.size, self.bounces) == (size, bounces) and mine == other


class _Stopped(Exception):
    """Tracing was stopped."""


class _Tracing(Thread):
    """Traces one view. When it has ended, `found` or `error` is set; neither, if it was stopped."""

    def __init__(self, scene: Scene, camera: Camera, size: tuple[int, int], bounces: int | str) -> None:
        super().__init__(name="truth", daemon=True)
        self.scene, self.camera, self.size, self.bounces = scene, camera, size, bounces
        self.lattice = Lattice.of(size)
        self.traced = 0.0  # the fraction that is traced
        self.notices: list[str] = []
        self.found: Traced | None = None
        self.error: Exception | None = None
        self.stopped = Event()

    def run(self) -> None:
        """Trace; `collect` raises in the main thread what goes wrong here."""
        try:
            camera = self.lattice.camera(self.camera, self.size)
            count, say = self.lattice.count, self.notices.append
            self.found = traced(self.scene, camera, count, self.bounces, SAMPLES, self._progress, say)
        except _Stopped:
            pass
        except Exception as error:
            self.error = error

    def _progress(self, traced: float) -> None:
        if self.stopped.is_set():
            raise _Stopped
        self.traced = traced


class Truths(Owner):
    """The truths of the last KEPT views, and the one that is being traced; nothing waits for it."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.kept: list[Truth] = []
        self._tracing: _Tracing | None = None
        self._threads: list[_Tracing] = []  # the present one, and those that were stopped and have not ended yet

    def owned(self) -> tuple[Resource, ...]:
        """What this frees."""
        return tuple(truth.values for truth in self.kept)

    @property
    def traced(self) -> float | None:
        """The fraction of the present truth that is traced, 0..1; None while none is being traced."""
        return None if self._tracing is None else self._tracing.traced

    def of(self, scene: Scene, camera: Camera, size: tuple[int, int], bounces: int | str) -> Truth | None:
        """The truth of this view; None where it has not been traced."""
        return next((truth for truth in self.kept if truth.is_of(scene, camera, size, bounces)), None)

    def toggle(self, scene: Scene, camera: Camera, size: tuple[int, int], bounces: int | str) -> str:
        """Begin to trace this view, or stop tracing; a line that says which."""
        if self._tracing is not None:
            self.stop()
            return "tracing is stopped"
        if self.of(scene, camera, size, bounces) is not None:
            return "the truth of this view is here already"
        self._tracing = _Tracing(scene, camera, size, bounces)
        self._threads = [thread for thread in self._threads if thread.is_alive()] + [self._tracing]
        self._tracing.start()
        return "tracing the truth of this view"

    def stop(self) -> None:
        """Stop tracing; the path tracer's process ends a moment later."""
        if self._tracing is not None:
            self._tracing.stopped.set()
            self._tracing = None

    def collect(self, scene: Scene, say: Callable[[str], object]) -> None:
        """Take the truth that has been traced meanwhile, and drop those of other scenes.

        say: called with lines for the user. Raises IrrsplatError where tracing failed.
        """
        self._keep([truth for truth in self.kept if truth.scene.meshes is scene.meshes])
        tracing = self._tracing
        if tracing is not None and tracing.scene.meshes is not scene.meshes:
            self.stop()
        elif tracing is not None and not tracing.is_alive():
            self._tracing = None
            for notice in tracing.notices:
                say(notice)
            if tracing.error is not None:
                raise tracing.error
            assert tracing.found is not None
            self._keep([*self.kept, self._upload(tracing, tracing.found)][-KEPT:])
            say("the truth is traced: see the buffers reference and error")

    def _keep(self, truths: list[Truth]) -> None:
        """Keep these, and free the others."""
        for gone in self.kept:
            if all(gone is not truth for truth in truths):
                gone.values.release()
        self.kept = truths

    def _upload(self, tracing: _Tracing, found: Traced) -> Truth:
        E, seen = found.irradiance, found.seen
        values = table_texture(self.ctx, np.concatenate([E, seen[..., None]], axis=-1)[::-1])
        compared = found.valid if found.valid.any() else seen
        mean = float(E[compared].mean()) if compared.any() else 0.0
        n = tracing.lattice.stride
        about = f"{SAMPLES} samples a pixel" if n == 1 else f"{SAMPLES} samples in the middle of every {n} x {n} pixels"
        about = f"{in_words(tracing.bounces)}, {about}"
        if found.valid.any() and found.noise is not None:
            about += f", noise {100.0 * found.noise:.2g} %"
        return Truth(
            tracing.scene, tracing.camera, tracing.size, tracing.bounces, tracing.lattice, values, FULL * (mean or 1.0), about
        )

    def release(self) -> None:
        """Stop tracing, and free all that is kept."""
        self.stop()
        for thread in self._threads:
            thread.stopped.set()
            thread.join(_JOIN)
        self._keep([])
