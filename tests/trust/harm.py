"""Rendering processes on the command line under faults: killed, interrupted, or without disk space.

They are forked from a server with all modules but no OpenGL, so that hundreds take minutes.
"""

from __future__ import annotations

import faulthandler
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from irrsplat.app import cli
from tests.support.interrupts import run

ESCAPED = 77  # exit status for an interruption that escaped from main
LIMIT = 600.0  # seconds, after which a process counts as hanging
OURS = ".irrsplat-"  # prefix of temporary files


def rendered(
    folder: Path, argv: list[str], harm: Callable[..., Callable[[], int]] | None = None, *values: Any
) -> tuple[int, str]:
    """Run `irrsplat` with `argv` in `folder` as a process; return its status and stderr.

    A negative status is a signal's number. harm: called there with `argv` and `values`; it returns a replacement of the
    command.
    """
    forks = multiprocessing.get_context("forkserver")
    forks.set_forkserver_preload(["irrsplat.app.cli", "irrsplat.renderer", "irrsplat.app.film.frames", "OpenEXR", __name__])
    receiver, sender = forks.Pipe(duplex=False)
    process = forks.Process(target=_child, args=(str(folder), sender, argv, harm, values))
    process.start()
    sender.close()
    process.join(LIMIT)  # the pipe's buffer holds a line or two
    if process.exitcode is None:
        process.kill()
        raise AssertionError(f"{argv} hangs, with {harm} {values}")
    with open(receiver.fileno(), errors="replace", closefd=False) as stream:
        return process.exitcode, stream.read()


def _child(folder: str, sender: Connection, argv: list[str], harm: Any, values: tuple[Any, ...]) -> None:
    os.chdir(folder)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(sender.fileno(), 2)
    sys.stdout, sys.stderr = (open(number, "w", closefd=False) for number in (1, 2))  # noqa: SIM115
    faulthandler.enable()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    status = ESCAPED
    try:
        act = (lambda: cli.main(argv)) if harm is None else harm(argv, *values)
        status = act()
    except KeyboardInterrupt:
        pass
    finally:
        sys.stderr.flush()
        os._exit(status)


# ---- harms -------------------------------------------------------------------------------------------------------------------


def killed(argv: list[str], event: int) -> Callable[[], int]:
    """Return a command that SIGKILL ends at the n-th opening, renaming or removal of a temporary file."""
    left = event

    def hook(name: str, args: tuple[Any, ...]) -> None:
        nonlocal left
        if name in ("open", "os.rename", "os.remove", "os.mkdir", "os.rmdir") and OURS in str(args[0]):
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)
    return lambda: cli.main(argv)


def limited(argv: list[str], most: int) -> Callable[[], int]:
    """Return a command with a limit of `most` bytes per file."""
    import resource

    resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
    return lambda: cli.main(argv)


def at_line(argv: list[str], line: int) -> Callable[[], int]:
    """Return a command that Ctrl-C interrupts before this line number of irrsplat's execution."""
    status = ESCAPED

    def main() -> None:
        nonlocal status
        status = cli.main(argv)

    return lambda: ESCAPED if run(main, line)[1] else status


def signalled(argv: list[str], number: int, seconds: float) -> Callable[[], int]:
    """Return a command that a signal interrupts after this time."""
    ended = threading.Event()

    def send() -> None:
        time.sleep(seconds)
        if not ended.is_set():
            os.kill(os.getpid(), number)

    def act() -> int:
        threading.Thread(target=send, daemon=True).start()
        status = cli.main(argv)
        ended.set()
        return status

    return act
