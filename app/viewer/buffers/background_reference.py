"""The path-traced reference of one view, refined in the background."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import moderngl
import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import table_texture
from irrsplat.image.tonemap import FULL
from irrsplat.reference import worker
from irrsplat.reference.truth import in_words, noise, vertices
from irrsplat.scene.model import Camera, Scene

SIDES = (*(2,) * 4, *(4,) * 15, *(8,) * 12)  # by pass: two times side² samples of each kind in a pixel; 2048 samples in total


@dataclass(frozen=True)
class Subject:
    """A view of `scene` by `camera` in a picture of `size` (W, H) pixels, with a number of bounces."""

    scene: Scene
    camera: Camera
    size: tuple[int, int]
    bounces: int | str

    def same(self, other: Subject) -> bool:
        """Return True if one reference is valid for both views. Names do not count."""
        cameras = ((v.size, v.bounces, v.camera.eye, v.camera.target, v.camera.up, v.camera.fov) for v in (self, other))
        lights = ((s.lights, s.sky, s.sky_gradient, s.up, s.environment) for s in (self.scene, other.scene))
        return self.scene.meshes is other.scene.meshes and all(one == another for one, another in (cameras, lights))


@dataclass(frozen=True)
class Estimate:
    """The result of some passes, top row first.

    halves: (2, rows, columns, 3) float32 W/m², from two independent halves of the `samples`. seen, valid: (rows, columns) bool,
    see `irrsplat.reference.truth.Traced`.
    """

    halves: np.ndarray
    seen: np.ndarray
    valid: np.ndarray
    samples: int

    @property
    def irradiance(self) -> np.ndarray:
        """The irradiance from all samples, (rows, columns, 3) W/m²."""
        mean: np.ndarray = self.halves.mean(axis=0)
        return mean

    def and_pass(self, samples: int, halves: np.ndarray) -> Estimate:
        """Return the mean of all samples, with the samples of a further pass included."""
        share = np.float32(samples / (self.samples + samples))
        return replace(self, halves=self.halves + (halves - self.halves) * share, samples=self.samples + samples)

    @cached_property
    def progress(self) -> str:
        """The number of samples, and the noise in words: the standard error of `irradiance` over its mean."""
        found = noise(self.halves, self.valid)
        return f"{self.samples} samples" + ("" if found is None else f", noise about {100.0 * found:.2g} %")


@dataclass(frozen=True)
class TracedReference:
    """The reference of one view on the GPU, from the passes so far.

    values: RGBA32F texture of the view's size, bottom row first: rgb indirect irradiance in W/m²; a 1 at a surface, else 0.
    full: the error in full colour, W/m². about: bounces, samples and noise in words.
    """

    subject: Subject
    estimate: Estimate
    values: moderngl.Texture
    full: float
    about: str


class _Tracing:
    """The tracing of one view, pass by pass. latest: the mean of all passes so far, None before the first one."""

    def __init__(self, subject: Subject) -> None:
        if not subject.scene.triangles:
            raise InputError("the scene has no surfaces, so there is nothing to trace")
        self.subject, self.latest = subject, cast(Estimate | None, None)
        self._left, view = iter(SIDES), (subject.scene, subject.camera, subject.size)
        self.calling = worker.background("refine", (*view, SIDES, vertices(subject.bounces)), self._take)

    def _take(self, found: dict[str, np.ndarray]) -> None:
        samples, before = 2 * next(self._left) ** 2, self.latest
        self.latest = Estimate(**found, samples=samples) if before is None else before.and_pass(samples, found["halves"])


class Reference(Owner):
    """The reference of the last traced view. Tracing runs in the background, and no frame waits for it."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.shown: TracedReference | None = None
        self._tracing: _Tracing | None = None
        self._last: _Tracing | None = None  # the last tracing, which may still be ending

    def owned(self) -> tuple[Resource, ...]:
        return () if self.shown is None else (self.shown.values,)

    @property
    def traced(self) -> float | None:
        """The traced fraction, 0..1; None while no view is being traced."""
        return None if self._tracing is None else self._tracing.calling.share

    @property
    def progress(self) -> str:
        """The progress in words; "" while no view is being traced."""
        if self._tracing is None:
            return ""
        return "reference: " + ("the first samples" if self._tracing.latest is None else self._tracing.latest.progress)

    def of(self, subject: Subject) -> TracedReference | None:
        """Return the reference of this view from the passes so far; None for another view."""
        return self.shown if self.shown is not None and self.shown.subject.same(subject) else None

    def toggle(self, subject: Subject) -> str:
        """Start tracing a view, or stop tracing. Return a line for the user."""
        if self._tracing is not None:
            self.stop()
            return "tracing is stopped; the traced samples stay"
        self._tracing = self._last = _Tracing(subject)
        return "tracing the reference of this view"

    def stop(self) -> None:
        """Stop tracing. The path tracer's process ends a moment later."""
        tracing, self._tracing = self._tracing, None
        if tracing is not None:
            tracing.calling.stop()

    def update(self, subject: Subject, say: Callable[[str], object]) -> None:
        """Show the passes that have ended. Stop tracing if the view on show, `subject`, has changed.

        say: called with lines for the user. Raises IrrsplatError if tracing failed.
        """
        tracing = self._tracing
        if self.shown is not None and self.shown.subject.scene.meshes is not subject.scene.meshes:
            self._show(None)
        if tracing is None:
            return
        if not tracing.subject.same(subject):
            self.stop()
            say("tracing is stopped, since the view is another one; Y traces it")
            return
        ended = not tracing.calling.is_alive()  # read before `latest`: an ended thread has delivered all its results
        latest = tracing.latest
        if latest is not None and (self.shown is None or self.shown.estimate is not latest):
            self._show(self._upload(tracing.subject, latest))
        if ended:
            self._tracing = None
            if tracing.calling.error is not None:
                raise tracing.calling.error
            assert latest is not None
            say(f"the reference is traced: {latest.progress}; see the buffers reference and error")

    def _show(self, reference: TracedReference | None) -> None:
        """Replace the shown reference, and free the previous one."""
        if self.shown is not None:
            self.shown.values.release()
        self.shown = reference

    def _upload(self, subject: Subject, found: Estimate) -> TracedReference:
        texels = np.concatenate([found.irradiance, found.seen[..., None]], axis=-1, dtype=np.float32)[::-1]
        compared = found.valid if found.valid.any() else found.seen
        mean = float(found.irradiance[compared].mean()) if compared.any() else 0.0
        values = table_texture(self.ctx, np.ascontiguousarray(texels))
        about = f"{in_words(subject.bounces)}, {found.progress}"
        return TracedReference(subject, found, values, FULL * (mean or 1.0), about)

    def release(self) -> None:
        self.stop()
        if self._last is not None:
            self._last.calling.release()
        self._show(None)
