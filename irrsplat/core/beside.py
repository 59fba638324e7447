"""Long work without OpenGL in a thread of its own, while a generator that ticks go on with waits for it in small steps."""

from __future__ import annotations

from collections.abc import Callable, Generator
from concurrent.futures import Future, wait
from threading import Thread
from typing import TypeVar

Result = TypeVar("Result")
Share = TypeVar("Share")

_STEP = 0.01  # seconds that one step waits at most


def beside(work: Callable[[], Result], share: Share) -> Generator[Share, None, Result]:
    """Do `work` in a thread; yield `share`, at least once in 10 ms, until it is done. Returns what it returns, raises what it
    raises. A generator that is dropped leaves the thread to end by itself."""
    future: Future[Result] = Future()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:  # it is raised where the generator is
            future.set_exception(error)

    Thread(target=run, daemon=True).start()
    while not wait([future], _STEP).done:
        yield share
    return future.result()
