"""Line index of `.obj` files by kind, and parsing of the numbers of all lines of a kind at once."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

VERTEX, NORMAL, COORDINATE, FACE, OTHER = range(5)
KEYWORDS = (b"v", b"vn", b"vt", b"f")
_BLANKS = bytes(c if c > 32 else 32 for c in range(256))  # every control character is a blank


@dataclass(frozen=True)
class Lines:
    """The bytes of a file and, for each line that is neither blank nor a comment, its first letter, end and kind."""

    path: Path
    data: bytes
    start: np.ndarray
    end: np.ndarray
    kind: np.ndarray

    def number(self, line: int | np.integer) -> int:
        """Return the line number in the file, from 1, of the `line`-th of these lines."""
        at = int(self.start[line])  # a continued line, whose break is now a \v, counts as several
        return self.data.count(b"\n", 0, at) + self.data.count(b"\v", 0, at) + 1

    def words(self, line: int | np.integer) -> list[str]:
        """Return the words after the keyword of the `line`-th of these lines, without comments."""
        text = self.data[self.start[line] : self.end[line]].split(b"#", 1)[0]
        return [decoded(word) for word in text.split()[1:]]


def decoded(text: bytes) -> str:
    """Return `text` decoded as UTF-8, else as Windows-1252, with Latin-1 for undefined bytes."""
    try:
        return text.decode()
    except UnicodeDecodeError:
        return "".join(_CP1252[byte] for byte in text)


_CP1252 = [bytes([byte]).decode("cp1252", "ignore") or chr(byte) for byte in range(256)]


def find_lines(path: Path, data: bytes) -> Lines:
    """Return the lines of `data`, the text of the file at `path`, with line ends ``\\n``; keywords may be in upper case."""
    data = _join_continued(data) if b"\\" in data else data
    data += b"\n\n\n"  # allows access to three letters from any start
    code = np.frombuffer(data, np.uint8)
    end = np.flatnonzero(code == 10)
    start = np.concatenate([[0], end[:-1] + 1])
    indented = np.flatnonzero((code[start] <= 32) & (start < end))
    if len(indented):
        word = np.append(np.flatnonzero((code[:-1] <= 32) & (code[1:] > 32)) + 1, len(code))
        start[indented] = np.minimum(word[np.searchsorted(word, start[indented])], end[indented])
    first = code[start]
    kept = (start < end) & (first != ord("#"))
    start, end, first = start[kept], end[kept], first[kept]
    second, third = code[start + 1], code[start + 2]
    kind = np.full(len(start), OTHER, np.int8)
    of_vertices = first | 32 == ord("v")  # | 32: lower case
    kind[of_vertices & (second <= 32)] = VERTEX
    kind[of_vertices & (second | 32 == ord("n")) & (third <= 32)] = NORMAL
    kind[of_vertices & (second | 32 == ord("t")) & (third <= 32)] = COORDINATE
    kind[(first | 32 == ord("f")) & (second <= 32)] = FACE
    return Lines(path, data, start, end, kind)


def _join_continued(data: bytes) -> bytes:
    r"""Return `data` with ``\v`` for the line ends after a backslash, which continue a line, except in comments.

    Blanks may follow the backslash in lines of numbers. In other lines, it may end a name.
    """
    joined, after = bytearray(data), -1  # after: the end of the last continued line
    for found in re.finditer(rb"\\[ \t]*\n", data):
        start, (end, after_blanks) = data.rfind(b"\n", 0, found.start()) + 1, found.span()
        line = data[start:end]
        of_numbers = start == after or next(iter(line.lower().split(None, 1)), b"") in KEYWORDS
        if b"#" not in line and (of_numbers or after_blanks == end + 2):
            after = after_blanks
            joined[end], joined[after - 1] = 32, 11
    return bytes(joined)


@dataclass(frozen=True)
class Block:
    """The text of some lines of one kind, without keywords; comments are blank.

    lines: (L,) their numbers. code: (B,) uint8. offset: (L,) start of each in it. word: (W,) start of each word.
    first, count: (L,) each line's first word and number of words.
    """

    lines: np.ndarray
    code: np.ndarray
    offset: np.ndarray
    word: np.ndarray
    first: np.ndarray
    count: np.ndarray


def block(lines: Lines, which: np.ndarray) -> Block:
    """Return the lines `which`, ascending indices of lines of one kind."""
    start, end = lines.start[which], lines.end[which]
    gaps = np.flatnonzero(start[1:] != end[:-1] + 1)  # neighbours are copied together
    runs = zip(start[np.append(0, gaps + 1)].tolist(), end[np.append(gaps, -1)].tolist(), strict=True) if len(which) else ()
    text = b"".join([lines.data[a : b + 1] for a, b in runs])
    if b"#" in text:
        text = re.sub(rb"#[^\n]*", lambda comment: b" " * len(comment[0]), text)
    code = np.frombuffer(bytearray(text), np.uint8)
    length = end - start + 1
    offset = np.cumsum(length) - length
    keyword = KEYWORDS[lines.kind[which[0]]] if len(which) else b""
    for i in range(len(keyword)):
        code[offset + i] = 32
    gap = code <= 32
    word = np.flatnonzero(gap[:-1] & ~gap[1:]) + 1
    first = np.searchsorted(word, offset)
    return Block(which, code, offset, word, first, np.diff(first, append=len(word)))


def floats(text: bytes, count: int) -> np.ndarray:
    """Return (count,) float64: the words of `text` as Python's `float` reads them; NaN for invalid ones.

    Control characters and blanks separate words.
    """
    values = numbers(text, np.float64, count)
    if values is not None:
        return values
    words = text.translate(_BLANKS).split()
    return np.fromiter(map(_float, words), float, len(words))


def numbers(text: bytes, kind: type[np.float64] | type[np.int64], count: int) -> np.ndarray | None:
    """Return (count,) the numbers in `text`, separated by blanks; None for another count or other words."""
    if text.isspace():  # numpy parses blanks as a number
        return None if count else np.zeros(0, kind)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # it stops, with a warning, at the first invalid word
        try:
            values = np.fromstring(text, kind, sep=" ")
        except ValueError:
            return None
    return values if len(values) == count else None  # 1.2.3 gives two: the count shows any invalid word


def _float(word: bytes) -> float:
    try:
        return float("nan") if b"_" in word else float(word)
    except ValueError:
        return float("nan")
