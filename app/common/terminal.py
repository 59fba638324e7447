"""Terminal output: results on stdout, errors, notices and progress on stderr, and tables in columns.

All output goes through this module, which escapes control characters: names may come from foreign files.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Protocol

from irrsplat.core.words import spelled

INTERRUPTED = 130  # the exit status after Ctrl-C


class OnShare(Protocol):
    """Callback of a progress line: completed share 0..1 and a message. stage: the task of the share and of the time left."""

    def __call__(self, share: float, words: str, stage: str = "") -> None: ...


def out(text: str = "") -> None:
    """Print lines to stdout."""
    print(spelled(text), flush=True)


def say(line: str) -> None:
    """Print one line to stderr."""
    print(spelled(" ".join(line.split())), file=sys.stderr, flush=True)


def fail(message: str, status: int) -> int:
    """Print an error in one line to stderr; return the exit status."""
    with suppress(OSError):
        print("irrsplat:", spelled(" ".join(message.split())), file=sys.stderr, flush=True)
    return status


def doing(words: str) -> None:
    """Show the current activity in a replaceable line, if stderr is a terminal."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{spelled(words)}", end="", file=sys.stderr, flush=True)


def wrote(path: str | os.PathLike[str]) -> None:
    """Report a written file, if stderr is a terminal."""
    if sys.stderr.isatty():
        doing("")
        say(f"wrote {os.fspath(path)}")


def columns(rows: Sequence[Sequence[str]], left: int) -> Iterator[str]:
    """Yield the lines of a table, its first `left` columns aligned to the left, the others to the right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        cells = (c.ljust(w) if i < left else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True)))
        yield "  ".join(cells).rstrip()


@contextmanager
def progress(first: str = "") -> Iterator[OnShare | None]:
    """Provide a progress line with the time left; None if stderr is no terminal. first: initial message."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskProgressColumn, TextColumn
    from rich.text import Text

    class TimeLeft(ProgressColumn):
        """Time left in words, if known."""

        max_refresh = 0.5  # seconds

        def render(self, task: Task) -> Text:
            seconds = task.time_remaining
            return Text("" if seconds is None or task.finished else f"{seconds // 60:.0f}:{seconds % 60:02.0f} left")

    parts = TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn(), TimeLeft()
    with Progress(*parts, console=Console(stderr=True), transient=True) as bar:
        task, now = bar.add_task(first, total=None if first else 1.0), ""

        def show(share: float, words: str, stage: str = "") -> None:
            nonlocal now
            if stage != now:
                now = stage
                bar.reset(task, total=1.0)
            bar.update(task, total=1.0, completed=float(share), description=spelled(words))

        yield show
