"""The path tracer in its own process: its libraries print, and some versions of LLVM abort, which no command may."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from irrsplat.core.errors import IrrsplatError
from irrsplat.core.timing import other_process
from irrsplat.core.timing.other_process import OnShare
from irrsplat.scene.model import Camera, Scene

_CODE = "from irrsplat.reference.{} import {} as work; from irrsplat.reference.worker import serve; serve(work)"
INSTALL = "pip install 'irrsplat[reference]'"
_FAILURE = "the path tracer failed ({why}); with LLVM older than 19 it may: install libllvm19, then try again"


def require() -> None:
    """Raise IrrsplatError if Mitsuba is not installed; only `call` finds out if it runs."""
    if importlib.util.find_spec("mitsuba") is None:
        raise IrrsplatError(f"there is no path tracer here (Mitsuba 3); run: {INSTALL}")


def refining(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    sides: Sequence[int],
    bounces: int,
    take: Callable[[dict[str, np.ndarray]], object],
) -> other_process.Calling:
    """Trace a view pass by pass in another process and the background by `irrsplat.reference.trace_view.refine`.

    take: called with the arrays of each pass in turn.
    """
    require()
    arguments = scene, camera, size, tuple(sides), bounces
    return other_process.Calling(_CODE.format("trace_view", "refine"), arguments, _FAILURE, take)


def call(module: str, function: str, arguments: tuple[object, ...], progress: OnShare | None = None) -> Any:
    """Return the result of a function of irrsplat.reference, computed in another process by `other_process.call`.

    The function gets a progress function as its last argument. Raises IrrsplatError, one line, if Mitsuba or LLVM is missing.
    """
    require()
    return other_process.call(_CODE.format(module, function), arguments, progress, failure=_FAILURE)


def serve(work: Callable[..., object]) -> None:
    """Serve `work`, in the other process, with a variant of Mitsuba chosen first; see `other_process.serve`."""
    from irrsplat.reference.path_tracer import choose_variant

    def traced(*arguments: object) -> object:
        choose_variant()
        return work(*arguments)

    other_process.serve(traced)
