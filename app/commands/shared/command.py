"""What a command is to the grammar and to main."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from irrsplat.app.common.parser import Mistakes


def _nothing(args: argparse.Namespace, mistakes: Mistakes) -> None:
    """Nothing is wrong."""


@dataclass(frozen=True)
class Command:
    """A command: what its file in app/commands/ has to tell.

    add: adds its parser, named as in app/grammar.py, to argparse's subparsers. run: does the work, and returns the exit status.
    check: adds to the mistakes which flags do not go together; check_files: which files cannot be written or read. What was
    given wrongly is None in their args, and named in `Mistakes.arguments`.
    """

    add: Callable[[Any], None]
    run: Callable[[argparse.Namespace], int]
    check: Callable[[argparse.Namespace, Mistakes], None] = _nothing
    check_files: Callable[[argparse.Namespace, Mistakes], None] = _nothing
