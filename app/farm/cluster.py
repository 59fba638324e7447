"""`--on tcp://…`: fill a flight or render its frames on the workers of a Dask scheduler."""

from __future__ import annotations

import argparse
import asyncio
import logging
import os
import secrets
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from itertools import pairwise
from pathlib import Path as File
from typing import TYPE_CHECKING, Any

from irrsplat.app.common.terminal import OnShare, doing, progress
from irrsplat.app.farm import work
from irrsplat.app.farm.waiting import Crew, Task, submit
from irrsplat.app.farm.work import Job, Part, Rendered
from irrsplat.app.film.fill import Filled
from irrsplat.app.film.kept import unwritten
from irrsplat.core import files
from irrsplat.core.errors import IrrsplatError
from irrsplat.image.frame import numbered
from irrsplat.records import cache_file
from irrsplat.records.merge import merge
from irrsplat.scene import bundled
from irrsplat.settings import preset

if TYPE_CHECKING:
    from irrsplat.app.common.outputs import Outputs
    from irrsplat.app.common.pictures import Pictures
    from irrsplat.app.film.flight import Flight
    from irrsplat.image.statistics import Statistics
    from irrsplat.scene.model import Scene

_PATIENCE = 5.0  # seconds until a scheduler answers
_MANNED = 10.0  # seconds until it has a first worker
_PARTS = 4  # parts of a flight per worker: short waits at the end, and little lost work after a failure


def job_of(args: argparse.Namespace, scene: Scene, flight: Flight) -> Job:
    """Return the job description of a command for workers."""
    name = args.scene if args.scene in bundled() else os.path.abspath(args.scene)
    key = cache_file.key(scene.recentred.local, preset(args.preset, **args.values))
    return Job(name, args.loading, key, tuple(args.size), args.preset, args.values, flight.path)


def fill(args: argparse.Namespace, job: Job, flight: Flight) -> tuple[bytes, Filled]:
    """Return the bytes of a cache file with the records of a flight, and the result of the filling.

    Each worker fills a part of the flight. The caches are merged, and one worker repeats the flight for missing records.
    After Ctrl-C, the complete parts are merged. Raises IrrsplatError without a scheduler or a worker.
    """
    start = File(args.cache).read_bytes() if os.path.exists(args.cache) else None
    with _client(args.on) as (client, workers), progress("filling") as line:
        parts: list[Part] = []
        crew, send = Crew(client), _sender(client, start)
        try:
            tasks = [_task(client, work.fill, send, job, part) for part in split(flight.numbers, workers)]
            for part in _with_progress(crew.collected(tasks), len(tasks), line, "parts of the flight are filled"):
                parts.append(part)
        except KeyboardInterrupt:
            return _merged([part.cache for part in parts], start), _summed(parts, interrupted=True)
        whole = _merged([part.cache for part in parts], start)
        if len(parts) == 1:
            return whole, parts[0].done
        try:
            doing("merged; gathering the remaining records of the flight")
            (last,) = crew.collected([_task(client, work.fill, _sender(client, whole), job, flight.numbers)])
        except KeyboardInterrupt:
            return whole, _summed(parts, interrupted=True)
        return last.cache, last.done


def render(
    args: argparse.Namespace,
    job: Job,
    flight: Flight,
    buffers: list[str] | None,
    files: Pictures,
    outputs: Outputs,
) -> tuple[list[Statistics], bool]:
    """Render the frames of a flight remotely from the frozen cache and write them here; as frames.render."""
    done: dict[int, Statistics] = {}
    pending = [number for number in flight.numbers if not args.resume or unwritten(flight.outputs, number)]
    if not pending:
        return [], True
    records = File(args.cache).read_bytes()
    with _client(args.on) as (client, workers), progress("rendering") as line:
        crew, send = Crew(client), _sender(client, records)
        more = {"outputs": flight.outputs, "buffers": buffers, "files": files, "drawn_by": _one_driver(crew)}
        tasks = [_task(client, work.render, send, job, numbers, **more) for numbers in runs(pending, _PARTS * workers)]
        try:
            for rendered in _with_progress(crew.collected(tasks), len(tasks), line, "parts of the flight are rendered"):
                _write(rendered, flight, outputs, args.resume)
                done |= {stats["frame"]: stats for stats in rendered.stats}
        except KeyboardInterrupt:
            return [done[number] for number in sorted(done)], False
    return [done[number] for number in sorted(done)], not outputs.failures


def count(data: bytes) -> int:
    """Return the number of records in a cache file's bytes."""
    return len(_contents([data])[0].state.records["id"]) if data else 0


def split(numbers: range, parts: int) -> list[range]:
    """Split the numbers into `parts` consecutive, non-empty ranges of about equal length."""
    count = len(numbers)
    cuts = [count * i // parts for i in range(parts + 1)]
    return [numbers[low:high] for low, high in pairwise(cuts) if high > low]


def runs(numbers: Sequence[int], parts: int) -> list[range]:
    """Split ascending numbers into about `parts` consecutive ranges, more if there are gaps."""
    longest, found = -(-len(numbers) // parts), list[range]()
    for number in numbers:
        if found and found[-1].stop == number and len(found[-1]) < longest:
            found[-1] = range(found[-1].start, number + 1)
        else:
            found.append(range(number, number + 1))
    return found


# ---- the scheduler -----------------------------------------------------------------------------------------------------


@contextmanager
def _client(address: str) -> Iterator[tuple[Any, int]]:
    """Provide a client of the scheduler at `address` and its number of workers; tasks end with the block."""
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise IrrsplatError(f"--on needs Dask's '{error.name}': pip install 'irrsplat[cluster]'") from error
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # its tracebacks repeat the one-line errors here
    nobody = f"--on {address}: no Dask scheduler answers there; start one with: dask scheduler"
    with _waiting_for(f"a Dask scheduler at {address}"):
        try:
            asyncio.run(_reach(address))
            client = Client(address, timeout=_PATIENCE, set_as_default=False)
        except ImportError:
            raise
        except Exception as error:  # any exception from Dask if another program answers
            raise IrrsplatError(nobody) from error
    try:
        with _waiting_for(f"the first worker of {address}"):
            try:
                client.wait_for_workers(1, timeout=_MANNED)
            except TimeoutError as error:
                words = f"the scheduler has no workers; start some with: dask worker {address} --nthreads 1"
                raise IrrsplatError(f"--on {address}: {words}") from error
        yield client, len(Crew(client).well())
    finally:
        with suppress(TimeoutError):  # the scheduler no longer answers
            client.close()


async def _reach(address: str) -> None:
    """Test the connection to the scheduler at `address`; raise Dask's error for a failure.

    A Dask client at a wrong address would block the exit of the process.
    """
    from distributed.comm.core import connect
    from distributed.security import Security

    async with asyncio.timeout(_PATIENCE):
        comm = await connect(address, timeout=_PATIENCE, **Security().get_connection_args("client"))
        await comm.close()


@contextmanager
def _waiting_for(what: str) -> Iterator[None]:
    """Show on a terminal what the process waits for."""
    doing(f"waiting for {what}")
    try:
        yield
    finally:
        doing("")


def _with_progress(results: Iterator[Any], count: int, line: OnShare | None, words: str) -> Iterator[Any]:
    """Yield the results as they arrive, with progress."""
    for done, result in enumerate(results, 1):
        if line is not None:
            line(done / count, f"{done} of {count} {words}")
        yield result


def _sender(client: Any, data: bytes | None) -> Task:
    """Return a function that sends `data` to tasks, once per choice of workers."""
    sent: dict[tuple[str, ...], Any] = {}

    def send(workers: list[str] | None) -> Any:
        if data is not None and (key := tuple(workers or ())) not in sent:
            # a task, because scattered data is lost with its workers
            sent[key] = client.submit(bytes, data, workers=workers, pure=False)
        return sent.get(tuple(workers or ()))

    return send


def _task(client: Any, what: Callable[..., object], send: Task, job: Job, numbers: range, **more: object) -> Task:
    """Return a task of work.fill or work.render for these frames."""

    def begin(workers: list[str] | None) -> Any:
        key = f"{what.__name__}-{secrets.token_hex(8)}"
        return submit(client, partial(what, job, numbers, **more), send(workers), key=key, workers=workers)

    return begin


def _one_driver(crew: Crew) -> str:
    """Return the driver of most workers; leave out the others, whose frames would differ in their bits."""
    kinds = crew.answers(work.driver)
    chosen: str = max(sorted(set(kinds.values())), key=list(kinds.values()).count)
    for worker, kind in sorted(kinds.items()):
        if kind != chosen:
            crew.leave_out(worker, f"it draws by '{kind}', and others by '{chosen}': its frames would differ in their bits")
    return chosen


# ---- results -----------------------------------------------------------------------------------------------------------


def _merged(caches: Sequence[bytes], start: bytes | None) -> bytes:
    """Merge several cache files; the common initial records occur once."""
    if len(caches) < 2:
        return caches[0] if caches else start or b""
    contents = _contents(caches)
    done = merge([content.state for content in contents], contents[0].settings())
    with tempfile.TemporaryDirectory() as folder:
        file = File(folder) / "merged.cache"
        cache_file.write(file, contents[0].key, done.state, contents[0].scene)
        return file.read_bytes()


def _contents(caches: Sequence[bytes]) -> list[cache_file.Content]:
    """Return the contents of these files' bytes."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for data in caches:
            file = File(folder) / "records.cache"
            file.write_bytes(data)
            found.append(cache_file.read_any(file))
    return found


def _summed(parts: Sequence[Part], interrupted: bool) -> Filled:
    frames = {number: coverage for part in parts for number, coverage in part.done.frames.items()}
    passes = max([0, *(part.done.passes for part in parts)])
    return Filled(frames, passes, sum(part.done.evicted for part in parts), interrupted)


def _write(rendered: Rendered, flight: Flight, outputs: Outputs, resume: bool) -> None:
    """Write these files; with `resume`, keep existing ones."""
    for (number, i), content in rendered.files.items():
        pattern = flight.outputs[i]
        name = numbered(pattern, number)
        if not resume or pattern in unwritten([pattern], number):
            outputs.write(name, partial(_write_files, name, content), pattern)


def _write_files(name: str, content: dict[str, bytes]) -> None:
    for part, data in content.items():
        path = File(name) / part if part else File(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        files.write_bytes(path, data)
