"""Long work without OpenGL in a thread of its own, while a generator that ticks go on with waits for it in small steps."""

from __future__ import annotations

from collections.abc import Callable, Generator
from concurrent.futures import Future, wait
from threading import Lock, Thread
from typing import TypeVar

Result = TypeVar("Result")
Share = TypeVar("Share")

_STEP = 0.01  # seconds that one step waits at most
_one_at_a_time = Lock()  # so that what quick changes leave unfinished does not pile up


def beside(work: Callable[[], Result], share: Share) -> Generator[Share, None, Result]:
    """Do `work` in a thread; yield `share` about every 10 ms until it is done. Returns what it returns, raises what it raises.

    Where the generator is dropped, work that has begun goes on to its end, and other work never begins.
    """
    future: Future[Result] = Future()

    def run() -> None:
        with _one_at_a_time:
            if not future.set_running_or_notify_cancel():
                return
            try:
                future.set_result(work())
            except BaseException as error:  # it is raised where the generator is
                future.set_exception(error)

    Thread(target=run, daemon=True).start()
    try:
        while not wait([future], _STEP).done:
            yield share
    finally:
        future.cancel()
    return future.result()
