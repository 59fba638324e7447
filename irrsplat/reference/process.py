"""The path tracer in a process of its own: its libraries print, and with some versions of LLVM abort, as no command may."""

from __future__ import annotations

import importlib.util
import os
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from irrsplat.errors import IrrsplatError
from irrsplat.scene.model import Camera, Scene

_MAIN = "from irrsplat.reference.view import main; main()"
INSTALL = "pip install 'irrsplat[reference]'"


def require() -> None:
    """Raises IrrsplatError where Mitsuba is not installed; whether it runs, only `trace` tells."""
    if importlib.util.find_spec("mitsuba") is None:
        raise IrrsplatError(f"there is no path tracer here (Mitsuba 3); run: {INSTALL}")


def trace(
    scene: Scene, camera: Camera, size: tuple[int, int], side: int, progress: Callable[[float], object] | None = None
) -> dict[str, np.ndarray]:
    """What `irrsplat.reference.view.trace` returns, from another process; progress is called with the share done, 0..1.

    Raises IrrsplatError, one line, where Mitsuba or LLVM is missing, and where the process fails.
    """
    require()
    paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
    environment = os.environ | {"PYTHONPATH": paths, "PYTHONSAFEPATH": "1"}
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            [sys.executable, "-c", _MAIN], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said, env=environment
        )
        assert process.stdin is not None and process.stdout is not None
        try:
            with suppress(BrokenPipeError):  # it ended before it had read all: that shows in its answer
                pickle.dump((scene, camera, size, side), process.stdin)
                process.stdin.close()
            kind, value = _answer(process.stdout, progress)
            if kind is None:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(10.0)  # its own exit status tells why
        finally:
            process.kill()
            process.wait()
            with suppress(BrokenPipeError):
                process.stdin.close()
            process.stdout.close()
        if kind == "error":
            raise IrrsplatError(value)
        if kind is None:
            raise IrrsplatError(_obituary(process.returncode, said))
    return value


def _answer(stream: Any, progress: Callable[[float], object] | None) -> tuple[str | None, Any]:
    """The last message of the process; (None, None) where it ended without one."""
    while True:
        try:
            kind, value = pickle.load(stream)
        except (EOFError, pickle.UnpicklingError):
            return None, None
        if kind != "progress":
            return kind, value
        if progress is not None:
            progress(value)


def _obituary(status: int, said: Any) -> str:
    """Why the process ended without an answer, from its exit status and the last line on its stderr."""
    said.seek(0)
    lines = said.read().decode("utf-8", "replace").split("\n")
    last = next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")
    how = f"status {status}"
    if status < 0:
        with suppress(ValueError):
            how = signal.Signals(-status).name
    return f"the path tracer failed ({how}: {last[:200]}); with LLVM older than 19 it may: install libllvm19, then try again"
