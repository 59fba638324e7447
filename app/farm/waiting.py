"""Waiting for the workers of a Dask scheduler: for as long as there are some, and never for one that has left.

Dask itself waits without end where a task has no worker to go to: https://distributed.dask.org/en/stable/resilience.html
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Coroutine, Iterator, Mapping, Sequence
from concurrent import futures as threads
from contextlib import suppress
from typing import Any

from irrsplat.core.errors import IrrsplatError

_LOOK = 1.0  # seconds between two looks at which workers are there
_ALONE = 30.0  # seconds without any worker until a farm is given up; one that died may be started again meanwhile
_ROUNDS = 3  # of asking all workers, where all of those that were asked have left


def present(client: Any) -> set[str]:
    """The addresses of the workers that are there now; raises IrrsplatError where the scheduler is not."""
    try:
        asked = _begun(client, client.scheduler.ncores())
    except AttributeError as error:  # a client that lost its scheduler has None for it
        raise _lost() from error
    try:
        return set(asked.result(_ALONE))
    except (threads.CancelledError, TimeoutError, OSError) as error:
        asked.cancel()
        raise _lost() from error


def collected(client: Any, futures: Sequence[Any]) -> Iterator[Any]:
    """What the tasks `futures` give, as each is done; a worker that dies has its task done by another.

    Raises the first error, as one of a worker, and IrrsplatError where the scheduler has gone or no worker is left. The tasks
    that are not done are cancelled then, and also where the iterator is closed.
    """
    yield from (result for _, result in _finished(client, dict.fromkeys(futures)))


def answers(client: Any, question: Callable[[], Any]) -> dict[str, Any]:
    """What each worker answers, by its address; at least one does, and workers that leave before are left out.

    Raises as `collected`.
    """
    for _ in range(_ROUNDS):
        with suppress(TimeoutError):
            client.wait_for_workers(1, timeout=_ALONE)
        asked = {client.submit(question, workers=[worker], pure=False): worker for worker in present(client)}
        if not asked:
            raise _alone()
        if found := {asked[future]: answer for future, answer in _finished(client, asked)}:
            return found
    raise IrrsplatError("--on: workers die as soon as they are to draw; their logs say more")


def _finished(client: Any, futures: Mapping[Any, str | None]) -> Iterator[tuple[Any, Any]]:
    """Each of the tasks and what it gives, as it is done. Those with an address are for that worker alone, and are left out once
    it has left."""
    awaited = {_begun(client, client.gather(future, asynchronous=True)): future for future in futures}
    manned = time.monotonic()  # when there was a worker last
    try:
        while awaited:
            done, _ = threads.wait(awaited, timeout=_LOOK, return_when=threads.FIRST_COMPLETED)
            for result in done:
                yield awaited.pop(result), _result(result)
            if done:
                continue
            there, now = present(client), time.monotonic()
            manned = now if there else manned
            left = [result for result, future in awaited.items() if futures[future] not in (None, *there)]
            _drop(client, {result: awaited.pop(result) for result in left})
            if awaited and now - manned > _ALONE:
                raise _alone()
    finally:
        _drop(client, awaited)


def _begun(client: Any, work: Coroutine[Any, Any, Any]) -> threads.Future[Any]:
    """What the client's own thread does, to be waited for with a limit; Dask's own limits would begin a transfer anew."""
    return asyncio.run_coroutine_threadsafe(work, client.loop.asyncio_loop)


def _drop(client: Any, awaited: Mapping[threads.Future[Any], Any]) -> None:
    """Cancel these tasks, which ends the wait for them as well."""
    try:
        client.cancel(list(awaited.values()))
    except Exception:  # a client that is closed cancels nothing
        for result in awaited:
            result.cancel()


def _result(done: threads.Future[Any]) -> Any:
    from distributed import KilledWorker

    try:
        return done.result()
    except KilledWorker as error:
        words = "several workers have died at one task, of too little memory perhaps; their logs say more"
        raise IrrsplatError(f"--on: {words}") from error
    except ModuleNotFoundError as error:
        raise IrrsplatError(f"--on: a worker lacks '{error.name}'; install the same irrsplat on all machines") from error
    except threads.CancelledError as error:  # Dask's own, for tasks of a scheduler whose connection is lost
        raise _lost() from error


def _lost() -> IrrsplatError:
    return IrrsplatError("--on: the scheduler has gone; start it and its workers, and this command, again")


def _alone() -> IrrsplatError:
    return IrrsplatError(f"--on: all workers have left, and none has come for {_ALONE:g} s; start some, and this command again")
