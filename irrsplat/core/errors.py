"""The errors that irrsplat raises on purpose: each message is one line that says what, where and what to do."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable

from irrsplat.core.words import spelled

_ALIKE = 0.6  # how much a word has of a name, 0..1 as difflib counts it, where that is probably meant


class IrrsplatError(Exception):
    """Anything irrsplat reports as one line instead of a traceback; the command line exits with 1."""


class InputError(IrrsplatError):
    """The command line, a setting or a file is wrong; the command line exits with 2.

    `path` and `line` (1-based) say where, and stand in front of the message as ``file:line: message``. What a terminal would not
    show as it is, ends of lines above all, is spelled out.
    """

    def __init__(self, message: str, path: str | os.PathLike[str] | None = None, line: int | None = None) -> None:
        where = "" if path is None else f"{os.fspath(path)}: " if line is None else f"{os.fspath(path)}:{line}: "
        super().__init__(spelled(where + message).replace("\n", "\\n"))


class GLError(IrrsplatError):
    """There is no OpenGL here, or less of it than is needed; the message says how to mend that."""


def nearest(word: str, names: Iterable[str]) -> str:
    """The one of `names` that `word` is most like, whatever its case; empty where none is like it."""
    known = {name.lower().lstrip("-"): name for name in names}
    found = difflib.get_close_matches(word.lower().lstrip("-"), known, n=1, cutoff=_ALIKE)
    return known[found[0]] if found else ""


def did_you_mean(word: str, names: Iterable[str]) -> str:
    """What stands behind a wrong `word` in an error: the one of `names` that was probably meant; empty where none is like it."""
    found = nearest(word, names)
    return f" (did you mean '{found}'?)" if found else ""
