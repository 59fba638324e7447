"""Long work without OpenGL in background threads."""

from __future__ import annotations

from collections.abc import Callable, Generator
from concurrent.futures import Future
from threading import Semaphore, Thread
from typing import Any, TypeVar

from irrsplat.core.timing.clock import wait_for

Result = TypeVar("Result")
Steps = Generator[Any, None, Result]  # work that pauses at each step, True at the end of a tick; returns its result

_STEP = 0.01  # seconds that one step waits, at most
_AT_ONCE = 2  # concurrent tasks: the BVH's build and the surfaces' layout; more would be leftovers of quick changes
_free = Semaphore(_AT_ONCE)


def start_thread(work: Callable[[], Result]) -> Future[Result]:
    """Start `work` in a thread when at most one other runs; the future has its result or exception."""
    future: Future[Result] = Future()

    def run() -> None:
        with _free:
            if not future.set_running_or_notify_cancel():
                return
            try:
                future.set_result(work())
            except BaseException as error:  # raised where the future is read
                future.set_exception(error)

    Thread(target=run, daemon=True).start()
    return future


def run_now(work: Callable[[], Result]) -> Future[Result]:
    """Run `work` now; the future has its result, an exception is raised here."""
    future: Future[Result] = Future()
    future.set_result(work())
    return future


def in_background(work: Callable[[], Result]) -> Steps[Result]:
    """Run `work` in a thread; pause about every 10 ms until it is done. Returns its result, raises its exception.

    If the generator is dropped, running work continues to its end, and waiting work never starts.
    """
    future = start_thread(work)
    try:
        while not wait_for([future], _STEP):
            yield
    finally:
        future.cancel()
    return future.result()
