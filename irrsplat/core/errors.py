"""The errors that irrsplat raises on purpose: each message is one line with cause, place and remedy."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable

from irrsplat.core.words import spelled

_ALIKE = 0.6  # least similarity of a word to a suggested name, 0..1 in difflib's measure


class IrrsplatError(Exception):
    """An error reported as one line instead of a traceback; the command line exits with 1."""


class InputError(IrrsplatError):
    """An error in the command line, a setting or a file; the command line exits with 2.

    `path` and `line` (1-based) precede the message as ``file:line: message``. Characters that a terminal would interpret are
    escaped, line ends included.
    """

    def __init__(self, message: str, path: str | os.PathLike[str] | None = None, line: int | None = None) -> None:
        where = "" if path is None else f"{os.fspath(path)}: " if line is None else f"{os.fspath(path)}:{line}: "
        super().__init__(spelled(where + message).replace("\n", "\\n"))


class GLError(IrrsplatError):
    """Missing or insufficient OpenGL; the message has the remedy."""


def nearest(word: str, names: Iterable[str]) -> str:
    """Return the most similar of `names`, ignoring case; empty if none is similar."""
    known = {name.lower().lstrip("-"): name for name in names}
    found = difflib.get_close_matches(word.lower().lstrip("-"), known, n=1, cutoff=_ALIKE)
    return known[found[0]] if found else ""


def did_you_mean(word: str, names: Iterable[str]) -> str:
    """Return the suggestion after a wrong `word` in an error; empty if none of `names` is similar."""
    found = nearest(word, names)
    return f" (did you mean '{found}'?)" if found else ""
