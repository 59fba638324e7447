"""Long work without OpenGL in a thread of its own, while something else goes on."""

from __future__ import annotations

from collections.abc import Callable, Generator
from concurrent.futures import Future
from threading import Semaphore, Thread
from typing import TypeVar

from irrsplat.core.timing.clock import wait_for

Result = TypeVar("Result")
Share = TypeVar("Share")

_STEP = 0.01  # seconds that one step waits at most
_AT_ONCE = 2  # works: a scene's tree is built while its surfaces are cut; more would be what quick changes leave unfinished
_free = Semaphore(_AT_ONCE)


def started(work: Callable[[], Result]) -> Future[Result]:
    """Begin `work` in a thread, once at most one other goes on; what it returns or raises is in the future."""
    future: Future[Result] = Future()

    def run() -> None:
        with _free:
            if not future.set_running_or_notify_cancel():
                return
            try:
                future.set_result(work())
            except BaseException as error:  # it is raised where it is waited for
                future.set_exception(error)

    Thread(target=run, daemon=True).start()
    return future


def done(work: Callable[[], Result]) -> Future[Result]:
    """Do `work` at once; what it returns is in the future, what it raises is raised."""
    future: Future[Result] = Future()
    future.set_result(work())
    return future


def beside(work: Callable[[], Result], share: Share) -> Generator[Share, None, Result]:
    """Do `work` in a thread; yield `share` about every 10 ms until it is done. Returns what it returns, raises what it raises.

    Where the generator is dropped, work that has begun goes on to its end, and other work never begins.
    """
    future = started(work)
    try:
        while not wait_for([future], _STEP):
            yield share
    finally:
        future.cancel()
    return future.result()
