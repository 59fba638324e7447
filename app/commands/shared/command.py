"""Interface of a command to the grammar and to main."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


def _nothing(args: argparse.Namespace) -> None:
    """Accept all arguments."""


@dataclass(frozen=True)
class Command:
    """Functions of a command.

    add: adds its parser, named as in app/grammar.py, to argparse's subparsers. run: does the work, and returns the exit
    status. check: refuses incompatible flags; check_files: unusable files.
    """

    add: Callable[[Any], None]
    run: Callable[[argparse.Namespace], int]
    check: Callable[[argparse.Namespace], None] = _nothing
    check_files: Callable[[argparse.Namespace], None] = _nothing
