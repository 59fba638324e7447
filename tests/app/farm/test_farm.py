"""--on: a flight filled and its frames rendered by the workers of a Dask scheduler, as by one process."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from irrsplat.app import cli
from irrsplat.app.farm import cluster as farm
from irrsplat.app.farm import waiting, work
from tests.app.farm.test_work import FILL, RENDER
from tests.support.viewing import write_room

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")
PATIENCE = 300.0  # seconds: a limit for what would hang, which decides no outcome


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a room in it, and a flight of six frames."""
    write_room(tmp_path)
    (tmp_path / "a.path").write_text("frames 6\ncam -0.3 0 0.9 0 0 -1 0 1 0\ncam 0.2 0.1 0.7 0.4 0 -1 0 1 0\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(farm, "_PATIENCE", PATIENCE)
    monkeypatch.setattr(farm, "_MANNED", PATIENCE)
    monkeypatch.setattr(waiting, "_ALONE", PATIENCE)
    return tmp_path


@pytest.fixture(autouse=True)
def patience() -> Iterator[None]:
    """Let Dask's own limits be as generous, and its profiler be off: in Python 3.11 a collection of garbage locks it up."""
    limits: dict[str, Any] = {f"distributed.comm.timeouts.{name}": f"{PATIENCE:g}s" for name in ("connect", "tcp")}
    with dask.config.set({**limits, "distributed.worker.profile.enabled": False}):
        yield


@contextmanager
def cluster(count: int) -> Iterator[Any]:
    """A scheduler with so many workers in this process."""
    options: dict[str, Any] = {"dashboard_address": ":0", "threads_per_worker": 1, "memory_limit": 0}
    made = distributed.LocalCluster(n_workers=count, processes=False, protocol="tcp://", **options)
    try:
        yield made
    finally:
        with suppress(TimeoutError):  # a slow goodbye is no failure of what was tested
            made.close(timeout=PATIENCE)


@contextmanager
def workers(count: int) -> Iterator[str]:
    """The address of such a scheduler."""
    with cluster(count) as made:
        yield made.scheduler_address


@contextmanager
def processes(address: str, *befores: str) -> Iterator[dict[int, subprocess.Popen[bytes]]]:
    """A worker for each of these lines of Python, which it runs first, by their process numbers; a dead one is not restarted."""
    more = [address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    start = "; from distributed.cli.dask_worker import main; main()"
    found = [subprocess.Popen([sys.executable, "-c", line + start, *more], stderr=subprocess.DEVNULL) for line in befores]
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


def test_workers_fill_what_one_process_fills_and_render_the_same_bytes(place: Path, address: str) -> None:
    """All frames have their records, about as many as of one process (1.12 times); frozen frames are the same to the byte."""
    assert cli.main([*FILL, "--stats", "one.json"]) == 0
    one = stats("one.json")["records"]
    (place / "film.cache").unlink()
    assert cli.main([*FILL, "--stats", "two.json", "--on", address]) == 0
    two = stats("two.json")
    assert [frame["coverage"] for frame in two["frames"]] == [1.0] * 6 and 0.9 * one < two["records"] < 1.3 * one
    assert cli.main([*RENDER, "-o", "a{frame}.png", "-o", "a{frame}.exr"]) == 0
    assert cli.main([*RENDER, "-o", "b{frame}.png", "-o", "b{frame}.exr", "-o", "c{frame}", "--on", address]) == 0
    for ending in ("png", "exr"):
        assert pictures("a{}." + ending) == pictures("b{}." + ending)
    assert (place / "c5" / "image.png").is_file()


def test_a_sick_worker_is_named_and_others_do_its_tasks(
    place: Path, address: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The disk of one of two is full while it fills; the other draws otherwise. Where all are sick, the command ends."""
    in_thread, full = work._in_thread, list[str]()

    def failing(task: Any) -> Any:
        here = distributed.get_worker().address
        full.extend([] if full else [here])
        if here in full:
            raise OSError(28, "No space left on device")
        return in_thread(task)

    with monkeypatch.context() as patched:
        patched.setattr(work, "_in_thread", failing)
        assert cli.main([*FILL, "--stats", "a.json", "--on", address]) == 0
        assert (
            capsys.readouterr().err == f"notice: the worker {full[0]} is left out: OSError: [Errno 28] No space left on device\n"
        )
        with distributed.Client(address, set_as_default=False) as client:
            full += [worker for worker in client.ncores() if worker not in full]
        assert cli.main([*FILL, "--on", address]) == 1 and "No space left" in capsys.readouterr().err
    assert [frame["coverage"] for frame in stats("a.json")["frames"]] == [1.0] * 6
    first = min(full)
    with monkeypatch.context() as patched, distributed.Client(address, set_as_default=False) as client:
        patched.setattr(work, "_in_thread", lambda task: "a" if distributed.get_worker().address == first else in_thread(task))
        crew = waiting.Crew(client)
        assert farm._one_driver(crew) == "a" < in_thread(work._driver) and crew.well() == {first}


def test_a_worker_that_cannot_load_irrsplat_is_named_and_others_do_its_tasks(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One process has no irrsplat, in one it fails to import. Alone they end a command; a third worker does their tasks."""
    (place / "irrsplat.py").write_text("raise RuntimeError('damaged')")  # the workers' working folder
    causes = {"import sys; sys.modules['irrsplat'] = None": "ModuleNotFound", "pass": "Runtime"}
    with cluster(0) as made, processes(made.scheduler_address, *causes):
        with distributed.Client(made.scheduler_address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=PATIENCE)
            assert cli.main([*FILL, "--on", made.scheduler_address]) == 1
            assert capsys.readouterr().err.splitlines()[-1].endswith("install the same irrsplat on all machines")
            made.scale(1)
            client.wait_for_workers(3, timeout=PATIENCE)
        assert cli.main([*FILL, "--stats", "a.json", "--on", made.scheduler_address]) == 0
        work.release()
    notices = capsys.readouterr().err
    assert [notices.count(f"irrsplat cannot be loaded there ({cause}Error") for cause in causes.values()] == [1, 1]
    assert [frame["coverage"] for frame in stats("a.json")["frames"]] == [1.0] * 6


def test_a_worker_is_silent_that_gives_no_sign_for_a_minute() -> None:
    """Signs are by the scheduler's clock, which is 1000 s ahead."""
    silence = waiting.Silence()
    assert not silence.of({"a": 1000.0, "b": 1000.0}, 0.0) and not silence.of({"a": 1050.0, "b": 1000.0}, 59.0)
    assert silence.of({"a": 1050.0, "b": 1000.0}, 61.0) == {"b"}
    assert silence.of({"a": 1050.0, "b": 1061.0}, 120.0) == {"a"}


@pytest.mark.long
def test_a_farm_that_is_not_there_is_one_line(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody at the address, or no worker."""
    monkeypatch.setattr(farm, "_PATIENCE", 0.5)
    nobody = "tcp://127.0.0.1:9"
    assert cli.main([*FILL, "--on", nobody]) == 1
    said = capsys.readouterr().err
    assert said == f"irrsplat: --on {nobody}: no Dask scheduler answers there; start one with: dask scheduler\n"
    monkeypatch.setattr(farm, "_PATIENCE", PATIENCE)
    monkeypatch.setattr(farm, "_MANNED", 0.5)
    with workers(0) as found:
        assert cli.main([*FILL, "--on", found]) == 1
    assert f"the scheduler has no workers; start some with: dask worker {found}" in capsys.readouterr().err
    assert not (place / "film.cache").exists()


class Killer(distributed.SchedulerPlugin):  # type: ignore[name-defined]
    """Kills the first worker that gets a task whose name begins with `task`, as soon as the scheduler hands it out."""

    def __init__(self, scheduler: Any, pids: dict[str, int], task: str) -> None:
        self.scheduler, self.pids, self.task = scheduler, pids, task
        self.killed: list[int] = []

    def transition(self, key: Any, start: str, finish: str, *args: Any, **more: Any) -> None:
        if finish == "processing" and str(key).startswith(self.task) and not self.killed:
            self.killed.append(self.pids[self.scheduler.tasks[key].processing_on.address])
            os.kill(self.killed[0], signal.SIGKILL)


@pytest.mark.long
def test_a_worker_that_is_killed_loses_nothing(place: Path) -> None:
    """One of three is killed while it fills, and another while it renders. The frames are those of this process."""
    commands = {"fill": [*FILL, "--stats", "fill.json"], "render": [*RENDER, "-o", "b{frame}.exr"]}
    with cluster(0) as made, processes(made.scheduler_address, *["pass"] * 3) as started:
        with distributed.Client(made.scheduler_address, set_as_default=False) as client:
            client.wait_for_workers(3, timeout=PATIENCE)
            pids = client.run(os.getpid)
        for task, command in commands.items():
            killer = Killer(made.scheduler, pids, task)
            made.scheduler.add_plugin(killer, name=task)
            assert cli.main([*command, "--on", made.scheduler_address]) == 0
            assert started[killer.killed[0]].wait() == -signal.SIGKILL
    assert [frame["coverage"] for frame in stats("fill.json")["frames"]] == [1.0] * 6
    assert cli.main([*RENDER, "-o", "a{frame}.exr"]) == 0
    assert pictures("a{}.exr") == pictures("b{}.exr")
