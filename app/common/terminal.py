"""What is written to the terminal: notices and a progress line on stderr, and tables in columns."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager


def say(line: str) -> None:
    """Print one line to stderr."""
    print(" ".join(line.split()), file=sys.stderr, flush=True)


def doing(words: str) -> None:
    """Show what goes on, in a line that the next one replaces, where stderr is a terminal."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{words}", end="", file=sys.stderr, flush=True)


def columns(rows: Sequence[Sequence[str]], left: int) -> Iterator[str]:
    """The lines of a table, its first `left` columns aligned to the left, the others to the right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        cells = (c.ljust(w) if i < left else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True)))
        yield "  ".join(cells).rstrip()


@contextmanager
def progress() -> Iterator[Callable[[float, str], None] | None]:
    """A function that shows the share done, 0..1, and words in a progress line; None where stderr is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    parts = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn()
    with Progress(*parts, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda share, words: bar.update(task, completed=float(share), description=words)
