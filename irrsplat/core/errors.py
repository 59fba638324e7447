"""The errors that irrsplat raises on purpose: each message is one line that says what, where and what to do."""

from __future__ import annotations

import os


class IrrsplatError(Exception):
    """Anything irrsplat reports as one line instead of a traceback; the command line exits with 1."""


class InputError(IrrsplatError):
    """The command line, a setting or a file is wrong; the command line exits with 2.

    `path` and `line` (1-based) say where, and stand in front of the message as ``file:line: message``.
    """

    def __init__(self, message: str, path: str | os.PathLike[str] | None = None, line: int | None = None) -> None:
        where = "" if path is None else f"{os.fspath(path)}: " if line is None else f"{os.fspath(path)}:{line}: "
        super().__init__(where + message)


class GLError(IrrsplatError):
    """There is no OpenGL here, or less of it than is needed; the message says how to mend that."""
