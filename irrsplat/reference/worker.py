"""The path tracer in its own process: its libraries print, and some versions of LLVM abort, which no command may."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from irrsplat.core.errors import IrrsplatError
from irrsplat.core.timing import other_process
from irrsplat.core.timing.other_process import OnShare
from irrsplat.scene.model import Camera, Scene

_MAIN = "from irrsplat.reference.trace_view import main; main()"
_REFINE = "from irrsplat.reference.trace_view import main_refine; main_refine()"
_AT_POINTS = "from irrsplat.reference.trace_view import main_at_points; main_at_points()"
INSTALL = "pip install 'irrsplat[reference]'"
_FAILURE = "the path tracer failed ({why}); with LLVM older than 19 it may: install libllvm19, then try again"


@dataclass(frozen=True)
class Pass:
    """Samples of irradiance for every pixel of a camera's picture of `size` (W, H): side² of each kind, twice.

    number: unique within a view; it selects the samples.
    """

    camera: Camera
    size: tuple[int, int]
    side: int
    number: int

    @property
    def samples(self) -> int:
        """Samples of each kind per pixel, by both halves."""
        return 2 * self.side * self.side

    @property
    def pixels(self) -> int:
        """Number of the picture's pixels."""
        return self.size[0] * self.size[1]


def is_installed() -> bool:
    """Return True if Mitsuba is installed; only `trace` finds out if it runs."""
    return importlib.util.find_spec("mitsuba") is not None


def require() -> None:
    """Raise IrrsplatError if Mitsuba is not installed."""
    if not is_installed():
        raise IrrsplatError(f"there is no path tracer here (Mitsuba 3); run: {INSTALL}")


def trace(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    side: int,
    bounces: int,
    progress: OnShare | None = None,
) -> dict[str, np.ndarray]:
    """Return `irrsplat.reference.trace_view.trace`, computed in another process; see `call`."""
    return cast("dict[str, np.ndarray]", call(_MAIN, (scene, camera, size, side, bounces), progress))


def refining(
    scene: Scene, passes: Sequence[Pass], bounces: int, take: Callable[[dict[str, np.ndarray]], object]
) -> other_process.Calling:
    """Trace a view pass by pass in another process and the background by `irrsplat.reference.trace_view.refine`.

    take: called with the arrays of each pass in turn.
    """
    require()
    return other_process.Calling(_REFINE, (scene, list(passes), bounces), _FAILURE, take)


def at_points(
    scene: Scene,
    points: tuple[np.ndarray, np.ndarray, np.ndarray],
    shadowed: tuple[np.ndarray, np.ndarray, np.ndarray],
    side: int,
    bounces: int,
    progress: OnShare | None = None,
) -> dict[str, np.ndarray]:
    """Return `irrsplat.reference.trace_view.at_points`, computed in another process; see `call`."""
    return cast("dict[str, np.ndarray]", call(_AT_POINTS, (scene, points, shadowed, side, bounces), progress))


def call(
    code: str,
    arguments: tuple[object, ...],
    progress: OnShare | None = None,
    take: Callable[[dict[str, np.ndarray]], object] | None = None,
) -> object:
    """Return `other_process.call`'s result; raise IrrsplatError, one line, if Mitsuba or LLVM is missing too."""
    require()
    return other_process.call(code, arguments, progress, take, _FAILURE)


def serve(work: Callable[..., object]) -> None:
    """Serve `work`, in the other process, with a variant of Mitsuba chosen first; see `other_process.serve`."""
    from irrsplat.reference.path_tracer import choose_variant

    def traced(*arguments: object) -> object:
        choose_variant()
        return work(*arguments)

    other_process.serve(traced)
