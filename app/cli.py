"""Entry point of the command line: run a command of app/grammar.py and report each error in one line."""

from __future__ import annotations

import argparse
import errno
import io
import logging
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

from irrsplat.app import grammar
from irrsplat.app.common.outputs import missing
from irrsplat.app.common.terminal import INTERRUPTED, fail
from irrsplat.core.errors import InputError, IrrsplatError


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (default: sys.argv) and return the exit status, as in docs/command-line.md."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed stream
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal without UTF-8 is no reason to fail
    debug = bool(os.environ.get("IRRSPLAT_DEBUG"))
    if argv is None:  # without it, waiting OpenBLAS threads occupy cores that software OpenGL needs
        os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "4")  # 2⁴ clock cycles; read when numpy is loaded
    try:
        with _quiet_libraries(debug), _ended_as_by_ctrl_c():
            args = grammar.parse(sys.argv[1:] if argv is None else argv)
            _check_scenes(args)
            status: int = args.run(args)
            sys.stdout.flush()
            return status
    except SystemExit as done:  # --help, --version
        return done.code if isinstance(done.code, int) else 0
    except InputError as error:
        return fail(str(error), 2)
    except IrrsplatError as error:
        return fail(str(error), 1)
    except KeyboardInterrupt as interrupted:
        return fail(str(interrupted) or "interrupted; nothing more was written", INTERRUPTED)
    except BrokenPipeError:  # `irrsplat info | head`: the reader closed the pipe
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        if debug:
            traceback.print_exc()
        if isinstance(error, MemoryError):
            return fail("out of memory; take a smaller --size, or fewer --buffers", 1)
        if isinstance(error, ModuleNotFoundError):
            return fail(missing(error), 1)
        if isinstance(error, OSError) and error.errno == errno.ENOSPC:  # of stdout, since files have errors of their own
            return fail("the disk is full; free some space, or write to another place", 1)
        return fail(f"internal error: {type(error).__name__}: {error}; IRRSPLAT_DEBUG=1 shows where", 1)


def _check_scenes(args: argparse.Namespace) -> None:
    scenes = args.scenes if hasattr(args, "scenes") else [getattr(args, "scene", None)]
    for scene in scenes:
        if scene is not None:
            from irrsplat.scene import located

            located(scene)


@contextmanager
def _quiet_libraries(debug: bool) -> Iterator[None]:
    """Keep library warnings off stderr, which has one line per error."""
    with warnings.catch_warnings():
        if not debug:
            warnings.simplefilter("ignore")
            logging.getLogger("trimesh").addHandler(logging.NullHandler())
        yield


@contextmanager
def _ended_as_by_ctrl_c() -> Iterator[None]:
    """Treat SIGTERM as Ctrl-C, which writes the last complete round."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    try:
        before = signal.signal(signal.SIGTERM, interrupt)
    except ValueError:  # only the main thread may set handlers
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


if __name__ == "__main__":
    sys.exit(main())
