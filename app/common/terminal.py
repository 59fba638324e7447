"""What a terminal is told: notices and a progress line on stderr, beside errors; and columns of a table."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any


def say(line: str) -> None:
    """Print one line to stderr."""
    print(" ".join(line.split()), file=sys.stderr, flush=True)


def doing(words: str) -> None:
    """Show what goes on in one line that changes, where stderr is a terminal."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{words}", end="", file=sys.stderr, flush=True)


def columns(rows: Sequence[Sequence[str]], left: int) -> Iterator[str]:
    """Lines of columns, the first `left` of them set to the left, the others to the right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        cells = (c.ljust(w) if i < left else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True)))
        yield "  ".join(cells).rstrip()


@contextmanager
def progress() -> Iterator[Callable[[float, str], None] | None]:
    """What is called with the share done, 0..1, and words: a line that moves where stderr is a terminal, None where it is not."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    columns: Any = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda share, words: bar.update(task, completed=float(share), description=words)
