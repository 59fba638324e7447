"""Waiting for the workers of a Dask scheduler, without waiting for failed workers.

Dask itself waits forever if a task has no worker: https://distributed.dask.org/en/stable/resilience.html
"""

from __future__ import annotations

import asyncio
import inspect
import pickle
import time
from collections.abc import Callable, Coroutine, Iterator, Mapping, Sequence
from concurrent import futures as threads
from contextlib import suppress
from typing import Any, NamedTuple

from irrsplat.app.common.terminal import say
from irrsplat.core.errors import IrrsplatError

_LOOK = 1.0  # seconds between two checks of the workers
_ALONE = 30.0  # seconds without any worker until the farm is given up; a dead worker may restart meanwhile
_SILENT = 60.0  # seconds without a heartbeat; workers send several per minute
_ROUNDS = 3  # attempts to query all workers, if all queried ones have left

Task = Callable[[list[str] | None], Any]  # submits a task to one of these workers; None: to any


class Outcome(NamedTuple):
    """Result or error of a task, and the address of its worker."""

    worker: str
    result: Any = None
    error: IrrsplatError | None = None


def attempt(call: bytes, data: list[object]) -> tuple[str, object, object]:
    """Return this worker's address, the result of the pickled `call` for `data`, and its error.

    Workers receive the source of this function: Dask ends a worker that cannot import a task's function.
    """
    import pickle

    from distributed import get_worker

    here = str(get_worker().address)
    try:
        work = pickle.loads(call)
    except Exception as error:  # irrsplat is missing or fails to import
        cause = f"{type(error).__name__}: {error}"
        return here, None, f"irrsplat cannot be loaded there ({cause}); install the same irrsplat on all machines"
    try:
        return here, work(*data), None
    except Exception as error:  # a full disk, too little memory, or a driver failure
        ours = type(error).__module__.startswith("irrsplat.")
        return here, None, error if ours else f"{type(error).__name__}: {error}"


def submit(client: Any, call: Callable[..., object], *data: object, **options: object) -> Any:
    """Return a future of `attempt` for a call and its data. options: Dask's own."""
    names = {"source": inspect.getsource(attempt), "call": pickle.dumps(call), "data": [*data]}
    return client.submit(eval, "exec(source) or attempt(call, data)", names, pure=False, **options)


class Silence:
    """Detector of workers without a heartbeat."""

    def __init__(self) -> None:
        self._heard: dict[str, tuple[float, float]] = {}  # by worker: last heartbeat by the scheduler's clock, and its arrival

    def of(self, signs: Mapping[str, float], now: float) -> set[str]:
        """Return the workers without a heartbeat for a minute.

        signs: the last heartbeat of each, by any clock; now: seconds.
        """
        for worker, sign in signs.items():
            if worker not in self._heard or self._heard[worker][0] != sign:
                self._heard[worker] = sign, now
        return {worker for worker in signs if now - self._heard[worker][1] > _SILENT}


class Crew:
    """Healthy workers of a scheduler; a failed worker is reported once, and others take over its tasks."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._sick: set[str] = set()
        self._silence = Silence()

    def well(self) -> set[str]:
        """Return the addresses of the healthy workers; raise IrrsplatError if the scheduler is gone."""
        return set(self._signs()) - self._sick

    def leave_out(self, worker: str, why: object) -> None:
        """Exclude a worker from further tasks, with a notice."""
        if worker not in self._sick:
            self._sick.add(worker)
            say(f"notice: the worker {worker} is left out: {why}")

    def collected(self, tasks: Sequence[Task]) -> Iterator[Any]:
        """Yield the results of the tasks as they finish; repeat failed tasks and tasks of silent workers elsewhere.

        Raises the task's error without another worker; IrrsplatError without a scheduler or, for a while, without workers.
        Then, and when the iterator is closed, unfinished tasks are cancelled.
        """
        awaited: dict[threads.Future[Any], tuple[Task, Any, list[str] | None]] = {}

        def begin(task: Task) -> None:
            workers = sorted(self.well()) if self._sick else None
            future = task(workers)
            awaited[_begun(self._client, self._client.gather(future, asynchronous=True))] = task, future, workers

        try:
            for task in tasks:
                begin(task)
            manned = time.monotonic()  # time of the last check with a worker
            while awaited:
                done, _ = threads.wait(awaited, timeout=_LOOK, return_when=threads.FIRST_COMPLETED)
                for one in done:
                    task, _, _ = awaited.pop(one)
                    outcome = _outcome(one)
                    if outcome.error is None:
                        yield outcome.result
                        continue
                    if not self.well() - {outcome.worker}:
                        raise outcome.error
                    self.leave_out(outcome.worker, outcome.error)
                    begin(task)
                if done:
                    continue
                silent, there = self._silent(), self.well()
                manned = time.monotonic() if there else manned
                if time.monotonic() - manned > _ALONE:
                    raise _alone()
                # other tasks may depend on data of a silent worker: restart all
                stuck = [one for one, (_, _, workers) in awaited.items() if silent or not there.intersection(workers or there)]
                for task in [awaited[one][0] for one in stuck if there]:
                    begin(task)
                _drop(self._client, {one: awaited.pop(one)[1] for one in stuck if there})
        finally:
            _drop(self._client, {one: future for one, (_, future, _) in awaited.items()})

    def answers(self, question: Callable[[], object]) -> dict[str, Any]:
        """Return the answer of each worker, by its address; at least one answers.

        Workers that leave, fail, or send no heartbeat for a minute are left out. Raises as `collected`.
        """
        failed: IrrsplatError | None = None
        for _ in range(_ROUNDS):
            with suppress(TimeoutError):
                self._client.wait_for_workers(1, timeout=_ALONE)
            queries = {worker: submit(self._client, question, workers=[worker]) for worker in self.well()}
            if not queries:
                raise failed or _alone()
            awaited = {_begun(self._client, self._client.gather(future, asynchronous=True)): w for w, future in queries.items()}
            found, begun = dict[str, Any](), time.monotonic()
            try:
                while awaited:
                    for one in threads.wait(awaited, timeout=_LOOK, return_when=threads.FIRST_COMPLETED).done:
                        outcome = _outcome(one)
                        if outcome.error is None:
                            found[awaited.pop(one)] = outcome.result
                        else:
                            failed = outcome.error
                            self.leave_out(awaited.pop(one), failed)
                    there, late = self.well(), time.monotonic() - begun > _SILENT
                    for one in [one for one, worker in awaited.items() if late or worker not in there]:
                        worker = awaited.pop(one)
                        _drop(self._client, {one: queries[worker]})
                        if late:
                            self.leave_out(worker, f"no answer for {_SILENT:g} s")
            finally:
                _drop(self._client, {one: queries[worker] for one, worker in awaited.items()})
            if found:
                return found
        raise failed or IrrsplatError("--on: workers end as soon as they draw; see their logs")

    def _silent(self) -> set[str]:
        """Leave out the workers without a heartbeat, and return the new ones among them."""
        found = self._silence.of(self._signs(), time.monotonic()) - self._sick
        for worker in found:
            self.leave_out(worker, f"no sign of life for {_SILENT:g} s")
        return found

    def _signs(self) -> dict[str, float]:
        """Return the last heartbeat of each worker by the scheduler's clock; raise IrrsplatError without a scheduler."""
        try:
            identity = _begun(self._client, self._client.scheduler.identity(n_workers=-1))
        except AttributeError as error:  # a client without a connection has None as its scheduler
            raise _lost() from error
        try:
            return {worker: float(known["last_seen"]) for worker, known in identity.result(_ALONE)["workers"].items()}
        except (threads.CancelledError, TimeoutError, OSError) as error:
            identity.cancel()
            raise _lost() from error


def _begun(client: Any, work: Coroutine[Any, Any, Any]) -> threads.Future[Any]:
    """Start work in the client's thread, for a wait with a time limit; Dask's own limits would restart a transfer."""
    return asyncio.run_coroutine_threadsafe(work, client.loop.asyncio_loop)


def _drop(client: Any, awaited: Mapping[threads.Future[Any], Any]) -> None:
    """Cancel these tasks, which also ends the wait for them."""
    try:
        client.cancel(list(awaited.values()))
    except Exception:  # a closed client cannot cancel
        for result in awaited:
            result.cancel()


def _outcome(done: threads.Future[Any]) -> Outcome:
    """Return the outcome of a finished task; raise IrrsplatError if no worker can do it."""
    from distributed import KilledWorker

    try:
        worker, result, failure = done.result()
    except KilledWorker as error:
        words = "several workers have ended at one task, perhaps for lack of memory; see their logs"
        raise IrrsplatError(f"--on: {words}") from error
    except threads.CancelledError as error:  # Dask's own, for tasks of a scheduler with a lost connection
        raise _lost() from error
    return Outcome(worker, result, IrrsplatError(failure) if isinstance(failure, str) else failure)


def _lost() -> IrrsplatError:
    return IrrsplatError("--on: the scheduler has gone; start it and its workers, and this command, again")


def _alone() -> IrrsplatError:
    return IrrsplatError(f"--on: all workers have left, and none has come for {_ALONE:g} s; start some, and this command again")
