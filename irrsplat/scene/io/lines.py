"""Line-by-line reading of text files, with errors that name file and line."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from irrsplat.core.errors import InputError
from irrsplat.core.paths import MOST_TEXT, may_read, name_of, read_bytes, refusal
from irrsplat.core.words import number, quote


def text_bytes(path: Path, strict: bool = True, most: int = MOST_TEXT) -> bytes:
    """Return the bytes of a UTF-8 text file without byte-order mark, lines ended by ``\\n``.

    Raises InputError for another encoding and for more than `most` bytes. Not strict: UTF-16 becomes UTF-8, other encodings are
    kept, and only binary data is refused.
    """
    data = read_bytes(path, most)
    if b"\0" in data:
        data = _without_zeros(path, data, strict)
    data = data.removeprefix(b"\xef\xbb\xbf")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if strict:
        try:
            data.decode()
        except UnicodeDecodeError as error:
            line = data.count(b"\n", 0, error.start) + 1
            raise InputError("this is not UTF-8 text (binary data, or another encoding); save it as UTF-8", path, line) from None
    return data


def _without_zeros(path: Path, data: bytes, strict: bool) -> bytes:
    """Return the same text in UTF-8 or another encoding without zero bytes; raise InputError for binary data."""
    marked = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    even, odd = data[0::2].count(0), data[1::2].count(0)
    if marked or (max(even, odd) > 0.4 * (len(data) // 2) and min(even, odd) < 0.1 * max(even, odd)):
        if strict:
            raise InputError("the text is UTF-16; save it as UTF-8", path)
        encoding = "utf-16" if marked else "utf-16-be" if even > odd else "utf-16-le"
        return data.decode(encoding, "replace").replace("\0", " ").encode()
    if strict or even + odd > 8 + 0.01 * len(data):
        raise InputError("this is binary data; expected a text file in UTF-8", path)
    return data.replace(b"\0", b" ")


@dataclass(frozen=True)
class Line:
    """One command of a text file: its first word, the words after it, and its place."""

    path: Path
    number: int
    word: str
    args: tuple[str, ...]
    rest: str

    def error(self, message: str) -> InputError:
        """Return an error with this line's file and number."""
        return InputError(message, self.path, self.number)

    @contextmanager
    def named_in_errors(self) -> Iterator[None]:
        """A `with` block whose InputErrors get this line's file and number."""
        try:
            yield
        except InputError as error:
            raise self.error(str(error)) from None

    def numbers(self, usage: str, args: tuple[str, ...] | None = None) -> tuple[float, ...]:
        """Return the finite values of a command with the syntax `usage`, such as ``sky R G B``; else raise InputError.

        args: the words to read, if not all that follow the command.
        """
        args = self.args if args is None else args
        names = [name for name in usage.split()[1:] if name != "NAME"]
        if len(args) != len(names):
            raise self.error(f"'{self.word}' has {len(args)} values; expected: {usage}")
        try:
            return tuple(number(word) for word in args)
        except ValueError as error:
            raise self.error(f"{error}; expected: {usage}") from None

    def file(self, usage: str) -> Path:
        """Return the path after the command, relative to this line's file; raise InputError where no such file exists."""
        if not self.rest:
            raise self.error(f"'{self.word}' names no file; expected: {usage}")
        path = self.path.parent / name_of(self.rest)
        if not may_read(path):
            raise self.error(f"{quote(self.rest)} is not read: {refusal(path)}")
        if os.path.isdir(path):
            raise self.error(f"{quote(self.rest)} is a directory; expected: {usage}")
        if not os.path.exists(path):
            raise self.error(f"there is no file {quote(self.rest)}; paths are relative to {self.path.name}")
        return path


def lines(path: Path) -> Iterator[Line]:
    """Yield the commands of a text file, without blank lines and comments from ``#``; raise InputError as `text_bytes`."""
    for i, text in enumerate(text_bytes(path).decode().split("\n"), 1):
        words = text.split("#", 1)[0].strip().split(maxsplit=1)
        if words:
            rest = words[1] if len(words) > 1 else ""
            yield Line(path, i, words[0], tuple(rest.split()), rest)
