"""--on: a flight filled and its frames rendered by the workers of a Dask scheduler, as by one process."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from irrsplat.app import cli
from irrsplat.app.farm import cluster as farm
from irrsplat.app.farm import waiting, work
from irrsplat.core.errors import IrrsplatError
from tests.app.film.test_fill import FAST
from tests.support.in_time import ends_within
from tests.support.viewing import write_room

distributed = pytest.importorskip("distributed")
FLIGHT = [*FAST, "--path", "a.path", "--cache", "film.cache"]
FILL, RENDER = ["fill", "room.scene", *FLIGHT], ["render", "room.scene", *FLIGHT, "--cache-mode", "frozen"]


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a room in it, and a flight of six frames."""
    write_room(tmp_path)
    (tmp_path / "a.path").write_text("frames 6\ncam -0.3 0 0.9 0 0 -1 0 1 0\ncam 0.2 0.1 0.7 0.4 0 -1 0 1 0\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(autouse=True)
def limit() -> Iterator[None]:
    """Each test fails after a minute, where a command would wait for ever."""
    with ends_within(60.0):
        yield


@contextmanager
def workers(count: int) -> Iterator[str]:
    """The address of a scheduler with so many workers in this process."""
    options: dict[str, Any] = {"dashboard_address": ":0", "threads_per_worker": 1, "memory_limit": 0}
    made = distributed.LocalCluster(n_workers=count, processes=False, protocol="tcp://", **options)
    try:
        yield made.scheduler_address
    finally:
        with suppress(TimeoutError):  # a slow goodbye is no failure of what was tested
            made.close(timeout=20)


@contextmanager
def processes(address: str, count: int) -> Iterator[dict[int, subprocess.Popen[bytes]]]:
    """So many workers, by their process numbers, as a user starts them, but that none is started again when it dies."""
    command = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    found = [subprocess.Popen(command, stderr=subprocess.DEVNULL) for _ in range(count)]
    try:
        yield {process.pid: process for process in found}
    finally:
        for process in found:
            process.kill()
            process.wait()


@pytest.fixture
def address() -> Iterator[str]:
    """A scheduler with two workers in this process; what they draw with is freed at the end."""
    with workers(2) as found:
        yield found
        work.release()


def stats(name: str) -> dict[str, Any]:
    return dict(json.loads(Path(name).read_text()))


def pictures(names: str) -> list[bytes]:
    return [Path(names.format(number)).read_bytes() for number in range(6)]


def test_workers_fill_what_one_process_fills_and_render_the_same_bytes(
    place: Path, address: str, refused: Callable[..., str]
) -> None:
    """All frames have their records, at most 1.15 times as many as of one process; and from the frozen cache each frame is the
    same to the byte. Then what cannot be: a worker with another scene, and frames without a frozen cache."""
    assert cli.main([*FILL, "--stats", "one.json"]) == 0
    one = stats("one.json")["records"]
    (place / "film.cache").unlink()
    assert cli.main([*FILL, "--stats", "two.json", "--on", address]) == 0
    two = stats("two.json")
    assert [frame["coverage"] for frame in two["frames"]] == [1.0] * 6 and one < 1.15 * two["records"] < 1.15**2 * one
    assert cli.main([*RENDER, "-o", "a{frame}.png", "-o", "a{frame}.exr"]) == 0
    assert cli.main([*RENDER, "-o", "b{frame}.png", "-o", "b{frame}.exr", "-o", "c{frame}", "--on", address]) == 0
    for ending in ("png", "exr"):
        assert pictures("a{}." + ending) == pictures("b{}." + ending)
    assert (place / "c5" / "image.png").is_file()
    assert "--cache-mode frozen" in refused(["render", "room.scene", *FLIGHT, "-o", "d{frame}.png", "--on", address])


def test_a_worker_with_another_scene_is_told(
    place: Path, address: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Here the scene changes between what the command has read and what its workers read."""
    send, lamp = farm.split, place / "lamp.light"

    def changed(numbers: range, parts: int) -> list[range]:
        lamp.write_text(lamp.read_text().replace("3 3 3", "4 3 3"))
        return send(numbers, parts)

    monkeypatch.setattr(farm, "split", changed)
    assert cli.main([*FILL, "--on", address]) == 2
    said = capsys.readouterr().err
    assert "the scene of this worker was made for other lights" in said and said.count("\n") == 1
    assert not (place / "film.cache").exists()


@contextmanager
def web_server() -> Iterator[str]:
    """The address of a program that answers, though not as a scheduler does: its words are a length of 10^18 bytes to Dask."""
    with socket.create_server(("127.0.0.1", 0)) as there:

        def answer() -> None:
            with suppress(OSError):
                while True:
                    caller, _ = there.accept()
                    with caller:
                        caller.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        threading.Thread(target=answer, daemon=True).start()
        yield f"tcp://127.0.0.1:{there.getsockname()[1]}"
        there.shutdown(socket.SHUT_RDWR)


def test_what_is_said_where_there_is_no_farm(
    place: Path, refused: Callable[..., str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """No address, nobody there, another program, no worker; each in one line. What is waited for is told meanwhile."""
    awaited: list[str] = []
    monkeypatch.setattr(farm, "doing", awaited.append)
    assert farm._PATIENCE <= 5.0
    assert "expected a scheduler's address such as tcp://farm:8786, not 'farm'" in refused([*FILL, "--on", "farm"])
    assert "fill once without --on" in refused([*FILL, "--on", "tcp://127.0.0.1:9", "--cache-mode", "update"])
    monkeypatch.setattr(farm, "_PATIENCE", 0.5)
    monkeypatch.setattr(farm, "_MANNED", 0.5)
    with web_server() as other:
        for nobody in ("tcp://127.0.0.1:9", other):
            awaited.clear()
            assert cli.main([*FILL, "--on", nobody]) == 1
            said = capsys.readouterr().err
            assert said == f"irrsplat: --on {nobody}: no Dask scheduler answers there; start one with: dask scheduler\n"
            assert awaited == [f"waiting for a Dask scheduler at {nobody}", ""]
    with workers(0) as found:
        assert cli.main([*FILL, "--on", found]) == 1
    assert f"the scheduler has no workers; start some with: dask worker {found}" in capsys.readouterr().err
    assert awaited[-2:] == [f"waiting for the first worker of {found}", ""]
    assert not (place / "film.cache").exists()


def test_a_flight_is_split_into_parts_that_are_alike() -> None:
    for count, parts in ((90, 4), (7, 3), (3, 8), (1, 1)):
        found = farm.split(range(5, 5 + count), parts)
        assert [number for part in found for number in part] == list(range(5, 5 + count))
        assert len(found) == min(count, parts) and max(map(len, found)) - min(map(len, found)) <= 1


def test_a_worker_that_leaves_before_it_answers_is_left_out(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is counted and gone when it is asked: a task that is for it alone would wait for ever."""
    monkeypatch.setattr(waiting, "_LOOK", 0.1)
    gone, there, counted = "tcp://127.0.0.1:9", waiting.present, list[set[str]]()
    monkeypatch.setattr(waiting, "present", lambda client: counted.pop(0) if counted else there(client))
    with distributed.Client(address, set_as_default=False) as client:
        all_answers = dict.fromkeys(there(client), 0)
        counted += [{gone, *all_answers}]
        assert waiting.answers(client, int) == all_answers
        counted += [{gone}]  # all that are asked first
        assert waiting.answers(client, int) == all_answers
        counted += [{gone}, set(all_answers)] * 3
        with pytest.raises(IrrsplatError, match="workers die as soon as they are to draw"):
            waiting.answers(client, int)


def test_a_farm_that_goes_away_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """No worker for a while, and then no scheduler, each while a task waits."""
    monkeypatch.setattr(waiting, "_LOOK", 0.1)
    monkeypatch.setattr(waiting, "_ALONE", 0.3)
    with workers(0) as address, distributed.Client(address, set_as_default=False) as client:
        with pytest.raises(IrrsplatError, match=r"all workers have left, and none has come for 0\.3 s"):
            list(waiting.collected(client, [client.submit(int)]))
        with pytest.raises(IrrsplatError, match="all workers have left"):
            waiting.answers(client, int)
    monkeypatch.setattr(waiting, "_ALONE", 30.0)
    with workers(0) as address:
        client = distributed.Client(address, set_as_default=False)
        task = client.submit(int)
        stop = threading.Timer(0.3, client.run_on_scheduler, [_close])
        stop.start()
        with pytest.raises(IrrsplatError, match="the scheduler has gone"):
            list(waiting.collected(client, [task]))
        stop.join()
        client.close()


async def _close(dask_scheduler: Any) -> None:
    for comm in dask_scheduler.client_comms.values():
        comm.abort()
    dask_scheduler.stop()


@pytest.mark.slow
def test_a_worker_that_is_killed_loses_nothing(place: Path) -> None:
    """One of three is killed while it fills, and another while it renders. The frames are those of this process."""
    with workers(0) as found, processes(found, 3) as started:
        fill = killing("fill", found, started, lambda: cli.main([*FILL, "--on", found, "--stats", "fill.json"]))
        assert fill == 0 and [frame["coverage"] for frame in stats("fill.json")["frames"]] == [1.0] * 6
        assert killing("render", found, started, lambda: cli.main([*RENDER, "-o", "b{frame}.exr", "--on", found])) == 0
        assert sum(process.poll() == -signal.SIGKILL for process in started.values()) == 2
    assert cli.main([*RENDER, "-o", "a{frame}.exr"]) == 0
    assert pictures("a{}.exr") == pictures("b{}.exr")


def killing(task: str, address: str, started: dict[int, subprocess.Popen[bytes]], act: Callable[[], int]) -> int:
    """What `act` returns, while the first worker that has begun such a task is killed."""
    with distributed.Client(address, set_as_default=False) as client:
        client.wait_for_workers(sum(process.poll() is None for process in started.values()), timeout=40)
        pids, until = client.run(os.getpid), time.monotonic() + 20.0
        killed: list[int] = []

        def kill() -> None:
            while not killed and time.monotonic() < until:
                busy = [pids[worker] for worker, keys in client.processing().items() if any(key.startswith(task) for key in keys)]
                for pid in busy[:1]:
                    killed.append(pid)
                    started[pid].kill()
                time.sleep(0.01)

        thread = threading.Thread(target=kill)
        thread.start()
        status = act()
        thread.join()
    assert killed
    return status
