"""What is said on stderr beside errors: notices, a line each, and a progress line where it is a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


def say(line: str) -> None:
    """Print one line to stderr."""
    print(" ".join(line.split()), file=sys.stderr, flush=True)


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
