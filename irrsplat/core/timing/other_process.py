"""Work in another Python process: arguments, progress, parts and the result are pickled messages on its pipes."""

from __future__ import annotations

import os
import pickle
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import IO, Protocol, cast

import numpy as np

from irrsplat.core.errors import IrrsplatError

_BEAT = 0.1  # seconds between two calls of `progress`, at most
_JOIN = 5.0  # seconds that the end of a stopped call is waited for, at most
_TRIES = 20  # of pickling
_ON_THE_WAY = ("progress", "part")  # messages that are followed by others

OnShare = Callable[[float], object]  # called with the finished share, 0..1


class Report(Protocol):
    """Progress reports of work in another process."""

    def __call__(self, share: float, part: dict[str, np.ndarray] | None = None) -> object:
        """Report the finished share, 0..1, and a part of the result if one is ready."""


def call(
    code: str,
    arguments: tuple[object, ...],
    progress: OnShare | None = None,
    take: Callable[[dict[str, np.ndarray]], object] | None = None,
    failure: str = "{why}",
) -> object:
    """Return the result of another process that runs Python `code`, ending in `serve`, with these arguments.

    progress: called with the finished share, 0..1, several times a second; take: called with each early part of the result. An
    exception from either ends the process and is raised here. Raises IrrsplatError, one line, if the process does, and if it
    fails: `failure` with the reason as {why}.
    """
    given = _pickled(arguments)
    paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
    environment = os.environ | {"PYTHONPATH": paths, "PYTHONSAFEPATH": "1"}
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said, env=environment
        )
        assert process.stdin is not None and process.stdout is not None
        try:
            with suppress(BrokenPipeError):  # the process ended before reading everything, which its result shows
                process.stdin.write(given)
                process.stdin.close()
            kind, value = _answer(process.stdout, progress, take)
            if kind is None:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(10.0)  # its own exit status has the reason
        finally:
            process.kill()
            process.wait()
            with suppress(BrokenPipeError):
                process.stdin.close()
            process.stdout.close()
        if kind == "error":
            raise IrrsplatError(str(value))
        if kind is None:
            raise IrrsplatError(failure.format(why=_why_it_failed(process.returncode, said)))
    return value


def code(work: Callable[..., object]) -> str:
    """Return the code of a process that serves `work`, a function at the top of its module."""
    return f"from {work.__module__} import {work.__name__} as work; from {__name__} import serve; serve(work)"


def _pickled(arguments: tuple[object, ...]) -> bytes:
    """Return the arguments as bytes; try again if another thread adds a cached property to one of them meanwhile."""
    for _ in range(_TRIES):
        with suppress(RuntimeError):  # dictionary changed size during iteration
            return pickle.dumps(arguments)
    return pickle.dumps(arguments)


class _Stopped(Exception):
    """The call was stopped."""


class Calling(threading.Thread):
    """A call in the background, begun at once; see `call`. share: finished so far, 0..1. Once the thread has ended, `error` has
    the exception of a call that failed, and `result` the result of any other. take: called in this thread."""

    def __init__(
        self,
        code: str,
        arguments: tuple[object, ...],
        failure: str,
        take: Callable[[dict[str, np.ndarray]], object] | None = None,
    ) -> None:
        super().__init__(name="calling", daemon=True)
        self.share, self.result = 0.0, cast(object, None)
        self.error: Exception | None = None
        self._stopped = threading.Event()
        self._call = partial(call, code, arguments, self._note, take, failure=failure)
        self.start()

    def run(self) -> None:
        """Wait for the other process."""
        try:
            self.result = self._call()
        except _Stopped:
            pass
        except Exception as error:  # read by the owner in its own thread
            self.error = error

    def _note(self, share: float) -> None:
        if self._stopped.is_set():
            raise _Stopped
        self.share = share

    def stop(self) -> None:
        """End the other process a moment later."""
        self._stopped.set()

    def release(self) -> None:
        """End the other process, and wait for its end."""
        self.stop()
        self.join(_JOIN)


def _answer(
    stream: IO[bytes], progress: OnShare | None, take: Callable[[dict[str, np.ndarray]], object] | None
) -> tuple[str | None, object]:
    """Return the last message of the process; (None, None) if it ended without one."""
    messages: queue.SimpleQueue[tuple[str | None, object]] = queue.SimpleQueue()

    def read() -> None:
        with suppress(EOFError, pickle.UnpicklingError, ValueError):  # ValueError: the waiting caller has closed the stream
            kind = "progress"
            while kind in _ON_THE_WAY:
                kind, value = pickle.load(stream)
                messages.put((kind, value))
        messages.put((None, None))

    threading.Thread(target=read, name="answers", daemon=True).start()
    share = 0.0
    while True:
        with suppress(queue.Empty):
            kind, value = messages.get(timeout=_BEAT)
            if kind not in _ON_THE_WAY:
                return kind, value
            if kind == "progress":
                share = cast(float, value)
            elif take is not None:
                take(cast("dict[str, np.ndarray]", value))
        if progress is not None:
            progress(share)


def _why_it_failed(status: int, said: IO[bytes]) -> str:
    """Return the reason why the process ended without a result, from its exit status and the last line on its stderr."""
    said.seek(0)
    lines = said.read().decode("utf-8", "replace").split("\n")
    last = next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")
    how = f"status {status}"
    if status < 0:
        with suppress(ValueError):
            how = signal.Signals(-status).name
    return f"{how}: {last[:200]}"


# ---- in the other process ----------------------------------------------------------------------------------------------


def serve(work: Callable[..., object]) -> None:
    """Call `work` with the pickled arguments from stdin and a progress function; write its result to stdout.

    The output consists of pickled messages (kind, value): ("progress", share) and ("part", a part of the result), and finally
    ("done", result) or ("error", reason).
    """
    with os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(2, 1)  # keeps output of libraries out of the messages

        def say(kind: str, value: object) -> None:
            pickle.dump((kind, value), answers)
            answers.flush()

        def report(share: float, part: dict[str, np.ndarray] | None = None) -> None:
            say("progress", share)
            if part is not None:
                say("part", part)

        try:
            arguments = pickle.load(sys.stdin.buffer)
            say("done", work(*arguments, report))
        except IrrsplatError as error:
            say("error", str(error))
