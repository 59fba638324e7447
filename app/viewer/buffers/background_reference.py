"""The path-traced reference of the view on show: coarse at first, refined in the background, and kept for the last few views."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from threading import Event, Thread

import moderngl
import numpy as np

from irrsplat.app.common.error_colours import FULL
from irrsplat.core.errors import InputError
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import table_texture
from irrsplat.reference import worker
from irrsplat.reference.truth import in_words, noise, vertices
from irrsplat.reference.worker import Pass
from irrsplat.scene.model import Camera, Scene

COARSE = (50, 200)  # rows of the pictures that come first, a pass each, about; then all pixels are traced
SIDES = (*(2,) * 4, *(4,) * 15, *(8,) * 12)  # of the passes over all pixels: side² samples of each kind, twice; 2048 in all
KEPT = 4  # views
_JOIN = 2.0  # seconds that closing waits for a stopped thread


@dataclass(frozen=True)
class Lattice:
    """The pixels of a view that are traced: the middle one of every square of `stride`² pixels.

    count: squares across and down. margin: pixels by which they overlap the view on either side, in x and y.
    """

    stride: int
    count: tuple[int, int]
    margin: tuple[int, int]

    @staticmethod
    def of(size: tuple[int, int], rows: int) -> Lattice:
        """The lattice of a view of size (W, H) that has about so many rows, at most."""
        stride = -(-size[1] // rows)
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
class Subject:
    """A view of `scene` by `camera` in a picture of `size` (W, H), with so many bounces."""

    scene: Scene
    camera: Camera
    size: tuple[int, int]
    bounces: int | str

    def same(self, other: Subject) -> bool:
        """Return True if both have one reference; names do not count."""
        mine, others = ((c.eye, c.target, c.up, c.fov) for c in (self.camera, other.camera))
        lit, others_lit = ((s.lights, s.sky, s.sky_gradient, s.up, s.environment) for s in (self.scene, other.scene))
        view = (self.size, self.bounces) == (other.size, other.bounces) and mine == others
        return self.scene.meshes is other.scene.meshes and view and lit == others_lit

    def plan(self) -> list[tuple[Lattice, Pass]]:
        """The passes that are made of it, in order, and the pixels that each one traces."""
        every = Lattice.of(self.size, self.size[1])
        coarse = [found for rows in COARSE if (found := Lattice.of(self.size, rows)) != every]
        lattices = [*((one, SIDES[0]) for one in dict.fromkeys(coarse)), *((every, side) for side in SIDES)]
        return [
            (one, Pass(one.camera(self.camera, self.size), one.count, side, number))
            for number, (one, side) in enumerate(lattices)
        ]


@dataclass(frozen=True)
class Estimate:
    """The result of the passes over one lattice, top row first.

    halves: (2, rows, columns, 3) float32 W/m², by two independent halves of the `samples`. seen, valid: (rows, columns) bool, as
    `irrsplat.reference.truth.Traced` has them. noise: the standard error of `irradiance` over its mean; None in the
    dark. passes: those of the plan that are made, the ones over other lattices too.
    """

    lattice: Lattice
    halves: np.ndarray
    seen: np.ndarray
    valid: np.ndarray
    samples: int
    noise: float | None
    passes: int

    @property
    def irradiance(self) -> np.ndarray:
        """(rows, columns, 3) W/m², by all samples."""
        mean: np.ndarray = self.halves.mean(axis=0)
        return mean

    @staticmethod
    def after(before: Estimate | None, lattice: Lattice, made: Pass, found: dict[str, np.ndarray]) -> Estimate:
        """Return the estimate after a pass: the mean of all samples of its lattice. before: the one before it."""
        halves, samples = found["halves"], made.samples
        if before is not None and before.lattice == lattice:
            samples += before.samples
            halves = before.halves + (halves - before.halves) * np.float32(made.samples / samples)
        seen, valid = found["seen"], found["valid"]
        return Estimate(lattice, halves, seen, valid, samples, noise(halves, valid), made.number + 1)

    @property
    def progress(self) -> str:
        """Samples and noise in words."""
        n = self.lattice.stride
        where = "" if n == 1 else f" in the middle of every {n} x {n} pixels"
        return f"{self.samples} samples{where}" + ("" if self.noise is None else f", noise about {100.0 * self.noise:.2g} %")


@dataclass(frozen=True)
class TracedReference:
    """The reference of one view on the GPU, as far as it is traced.

    values: RGBA32F texture of a texel per square of the lattice, bottom row first: rgb indirect irradiance in W/m², a 1 where
    there is a surface, else 0. full: the error shown in full colour, W/m². complete: whether no further pass is made.
    """

    subject: Subject
    estimate: Estimate
    values: moderngl.Texture
    full: float
    about: str
    complete: bool

    @property
    def lattice(self) -> Lattice:
        """The pixels that are traced."""
        return self.estimate.lattice

    @property
    def size(self) -> tuple[int, int]:
        """(W, H) of the view."""
        return self.subject.size


class _Stopped(Exception):
    """Tracing was stopped."""


class _Tracing(Thread):
    """Traces one view pass by pass, beginning after what is known of it. `latest` is what all passes so far have found.

    When it has ended, `error` is set where it failed.
    """

    def __init__(self, subject: Subject, known: Estimate | None) -> None:
        super().__init__(name="reference", daemon=True)
        self.subject, self.latest = subject, known
        self.ready: tuple[Estimate, np.ndarray] | None = None  # that, and the texels to show it by
        self.traced = 0.0  # the fraction of the passes here that is made
        self.error: Exception | None = None
        self.stopped = Event()

    def run(self) -> None:
        """Trace; `References.update` raises in the main thread what goes wrong here."""
        try:
            subject = self.subject
            if not subject.scene.triangles:
                raise InputError("the scene has no surfaces, so there is nothing to trace")
            plan = subject.plan()[0 if self.latest is None else self.latest.passes :]
            left = iter(plan)

            def take(found: dict[str, np.ndarray]) -> None:
                lattice, made = next(left)
                latest = Estimate.after(self.latest, lattice, made, found)
                texels = np.concatenate([latest.irradiance, latest.seen[..., None]], axis=-1, dtype=np.float32)[::-1]
                self.latest, self.ready = latest, (latest, np.ascontiguousarray(texels))

            worker.refine(subject.scene, [one for _, one in plan], vertices(subject.bounces), take, self._progress)
        except _Stopped:
            pass
        except Exception as error:
            self.error = error

    def _progress(self, traced: float) -> None:
        if self.stopped.is_set():
            raise _Stopped
        self.traced = traced


class References(Owner):
    """The references of the last KEPT views, and the one that is being traced; nothing waits for it.

    on: whether the view on show is traced wherever it rests. version: another number with every pass that is shown.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.kept: list[TracedReference] = []
        self.on, self.version = False, 0
        self._tracing: _Tracing | None = None
        self._threads: list[_Tracing] = []  # the present one, and those that were stopped and have not ended yet
        self._last: Subject | None = None  # of the last update

    def owned(self) -> tuple[Resource, ...]:
        return tuple(reference.values for reference in self.kept)

    @property
    def traced(self) -> float | None:
        """The fraction of the present reference that is traced, 0..1; None while none is being traced."""
        return None if self._tracing is None else self._tracing.traced

    @property
    def progress(self) -> str:
        """The progress of the present reference in words; "" while none is traced."""
        if not self.on:
            return ""
        tracing = self._tracing
        if tracing is None:
            complete = self._last is not None and self.complete(self._last)
            return "" if complete else "reference: begins when the view is at rest"
        latest = tracing.latest
        return "reference: " + ("the first samples" if latest is None else latest.progress)

    def of(self, subject: Subject) -> TracedReference | None:
        """The reference of this view as far as it is traced; None where it is not."""
        return next((reference for reference in self.kept if reference.subject.same(subject)), None)

    def complete(self, subject: Subject) -> bool:
        """Return True if the reference of this view has all its samples."""
        reference = self.of(subject)
        return reference is not None and reference.complete

    def toggle(self, subject: Subject) -> str:
        """Trace what is on show, or leave that; a line that says which."""
        self.on = not self.on
        if not self.on:
            self.stop()
            return "tracing is stopped; the traced samples stay"
        self._last = subject
        self._begin(subject)
        return "the reference of this view is complete" if self._tracing is None else "tracing the reference of this view"

    def stop(self) -> None:
        """Stop tracing; the path tracer's process ends a moment later."""
        if self._tracing is not None:
            self._tracing.stopped.set()
            self._tracing = None

    def update(self, subject: Subject, say: Callable[[str], object]) -> None:
        """Take what was traced meanwhile, drop the references of other scenes, and trace `subject`, the view on show.

        Nothing begins while the view changes from call to call. say: called with lines for the user. Raises IrrsplatError if
        tracing failed.
        """
        self._keep([reference for reference in self.kept if reference.subject.scene.meshes is subject.scene.meshes])
        rests, self._last = self._last is not None and self._last.same(subject), subject
        tracing = self._tracing
        if tracing is not None and not tracing.subject.same(subject):
            self.stop()
        elif tracing is not None:
            ended = not tracing.is_alive()  # before `_take`: a thread that has ended has all its results
            self._take(tracing)
            if ended:
                self._end(tracing, say)
        elif self.on and rests:
            self._begin(subject)

    def _begin(self, subject: Subject) -> None:
        """Trace a view on from what is known of it, where anything is left to be done."""
        if self.complete(subject):
            return
        known = self.of(subject)
        self._tracing = _Tracing(subject, None if known is None else known.estimate)
        self._threads = [thread for thread in self._threads if thread.is_alive()] + [self._tracing]
        self._tracing.start()

    def _end(self, tracing: _Tracing, say: Callable[[str], object]) -> None:
        """Report the end of a thread."""
        self._tracing = None
        if tracing.error is not None:
            self.on = False
            raise tracing.error
        assert tracing.latest is not None
        say(f"the reference is traced: {tracing.latest.progress}; see the buffers reference and error")

    def _take(self, tracing: _Tracing) -> None:
        """Show what a thread has found since the last time."""
        ready, shown = tracing.ready, self.of(tracing.subject)
        if ready is not None and (shown is None or shown.estimate is not ready[0]):
            self.version += 1
            others = [reference for reference in self.kept if not reference.subject.same(tracing.subject)]
            self._keep([*others, self._upload(tracing.subject, *ready)][-KEPT:])

    def _keep(self, references: list[TracedReference]) -> None:
        """Keep these, and free the others."""
        for gone in self.kept:
            if all(gone is not reference for reference in references):
                gone.values.release()
        self.kept = references

    def _upload(self, subject: Subject, found: Estimate, texels: np.ndarray) -> TracedReference:
        compared = found.valid if found.valid.any() else found.seen
        mean = float(found.irradiance[compared].mean()) if compared.any() else 0.0
        complete = found.passes == len(subject.plan())
        about = f"{in_words(subject.bounces)}, {found.progress}"
        return TracedReference(subject, found, table_texture(self.ctx, texels), FULL * (mean or 1.0), about, complete)

    def release(self) -> None:
        """Stop tracing, and free all that is kept."""
        self.on = False
        self.stop()
        for thread in self._threads:
            thread.stopped.set()
            thread.join(_JOIN)
        self._keep([])
