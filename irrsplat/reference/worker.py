"""The path tracer in its own process: its libraries print, and some versions of LLVM abort, which no command may."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np

from irrsplat.core.errors import IrrsplatError
from irrsplat.core.timing import other_process
from irrsplat.core.timing.other_process import OnShare

_CODE = "from irrsplat.reference.trace_view import {} as work; from irrsplat.reference.worker import serve; serve(work)"
INSTALL = "pip install 'irrsplat[reference]'"
_FAILURE = "the path tracer failed ({why}); with LLVM older than 19 it may: install libllvm19, then try again"


def require() -> None:
    """Raise IrrsplatError if Mitsuba is not installed; only `call` finds out if it runs."""
    if importlib.util.find_spec("mitsuba") is None:
        raise IrrsplatError(f"there is no path tracer here (Mitsuba 3); run: {INSTALL}")


def background(
    function: str, arguments: tuple[object, ...], take: Callable[[dict[str, np.ndarray]], object]
) -> other_process.Calling:
    """Begin a `call` in the background. take: called with the arrays of each part of the result in turn."""
    require()
    return other_process.Calling(_CODE.format(function), arguments, _FAILURE, take)


def call(function: str, arguments: tuple[object, ...], progress: OnShare | None = None) -> Any:
    """Return the result of a function of irrsplat.reference.trace_view, computed in another process by `other_process.call`.

    The function gets a progress function as its last argument. Raises IrrsplatError, one line, if Mitsuba or LLVM is missing.
    """
    require()
    return other_process.call(_CODE.format(function), arguments, progress, failure=_FAILURE)


def serve(work: Callable[..., object]) -> None:
    """Serve `work`, in the other process, with a variant of Mitsuba chosen first; see `other_process.serve`."""
    from irrsplat.reference.path_tracer import choose_variant

    def traced(*arguments: object) -> object:
        choose_variant()
        return work(*arguments)

    other_process.serve(traced)
