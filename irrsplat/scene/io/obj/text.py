"""Finds the lines of an `.obj` file by kind, and reads the numbers of all lines of a kind at once."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

VERTEX, NORMAL, COORDINATE, FACE, OTHER = range(5)
KEYWORDS = (b"v", b"vn", b"vt", b"f")
_DEEPEST = 64  # characters of indentation that are skipped for all lines at once
_BLANKS = bytes(c if c > 32 else 32 for c in range(256))  # every control character is a blank


@dataclass(frozen=True)
class Lines:
    """The bytes of a file and, for each line that is neither blank nor a comment: first letter, end, and kind."""

    path: Path
    data: bytes
    start: np.ndarray
    end: np.ndarray
    kind: np.ndarray

    def number(self, line: int | np.integer) -> int:
        """The place in the file, from 1, of the `line`-th of these lines."""
        at = int(self.start[line])  # a continued line, whose break has become a \v, counts as several
        return self.data.count(b"\n", 0, at) + self.data.count(b"\v", 0, at) + 1

    def words(self, line: int | np.integer) -> list[str]:
        """The words after the keyword of the `line`-th of these lines, without a comment behind them."""
        text = self.data[self.start[line] : self.end[line]].split(b"#", 1)[0]
        return [decoded(word) for word in text.split()[1:]]


def decoded(text: bytes) -> str:
    """`text` as UTF-8, else as Windows' western encoding; bytes that mean nothing there stay as Latin-1's."""
    try:
        return text.decode()
    except UnicodeDecodeError:
        return "".join(_CP1252[byte] for byte in text)


_CP1252 = [bytes([byte]).decode("cp1252", "ignore") or chr(byte) for byte in range(256)]


def find_lines(path: Path, data: bytes) -> Lines:
    """The lines of `data`, the text of the file at `path`, whose lines end by ``\\n``."""
    if b"\\\n" in data:
        data = data.replace(b"\\\n", b" \v")
    data += b"\n\n\n"  # so that a look at three letters never leaves it
    code = np.frombuffer(data, np.uint8)
    end = np.flatnonzero(code == 10)
    start = np.concatenate([[0], end[:-1] + 1])
    indented = np.flatnonzero((code[start] <= 32) & (start < end))
    for _ in range(_DEEPEST):
        if not len(indented):
            break
        start[indented] += 1
        indented = indented[(code[start[indented]] <= 32) & (start[indented] < end[indented])]
    for i in indented.tolist():
        rest = data[start[i] : end[i]].translate(_BLANKS)
        start[i] += len(rest) - len(rest.lstrip(b" "))
    first = code[start]
    kept = (start < end) & (first != ord("#"))
    start, end, first = start[kept], end[kept], first[kept]
    second, third = code[start + 1], code[start + 2]
    kind = np.full(len(start), OTHER, np.int8)
    kind[(first == ord("v")) & (second <= 32)] = VERTEX
    kind[(first == ord("v")) & (second == ord("n")) & (third <= 32)] = NORMAL
    kind[(first == ord("v")) & (second == ord("t")) & (third <= 32)] = COORDINATE
    kind[(first == ord("f")) & (second <= 32)] = FACE
    return Lines(path, data, start, end, kind)


@dataclass(frozen=True)
class Block:
    """The text of some lines of one kind, without their keyword; comments are blank.

    lines: (L,) their numbers among all. code: (B,) uint8. offset: (L,) where each begins in it. word: (W,) where each word
    begins. first, count: (L,) each line's first word, and how many it has.
    """

    lines: np.ndarray
    code: np.ndarray
    offset: np.ndarray
    word: np.ndarray
    first: np.ndarray
    count: np.ndarray


def block(lines: Lines, which: np.ndarray) -> Block:
    """The lines that `which`, ascending indices of lines of one kind, picks."""
    start, end = lines.start[which], lines.end[which]
    apart = np.flatnonzero(start[1:] != end[:-1] + 1)  # neighbours are copied as one
    runs = zip(start[np.append(0, apart + 1)].tolist(), end[np.append(apart, -1)].tolist(), strict=True) if len(which) else ()
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
    """(count,) float64: what each word of `text` spells, as Python's `float` reads it; NaN for what is no number.

    Words are what control characters and blanks part.
    """
    values = _read(text, np.float64, count)
    if values is not None:
        return values
    words = text.translate(_BLANKS).split()
    return np.fromiter(map(_float, words), float, len(words))


def integers(text: bytes, count: int) -> np.ndarray | None:
    """(count,) int64: the numbers in `text`, blanks between them; None where they are not as many, or something else is there."""
    return _read(text, np.int64, count)


def _read(text: bytes, kind: type[np.float64] | type[np.int64], count: int) -> np.ndarray | None:
    if text.isspace():  # numpy takes blanks for a number
        return None if count else np.zeros(0, kind)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # it stops, and warns, at the first that is no number
        try:
            values = np.fromstring(text, kind, sep=" ")
        except ValueError:
            return None
    return values if len(values) == count else None  # 1.2.3 gives two: so none has failed where there is one for each word


def _float(word: bytes) -> float:
    try:
        return float("nan") if b"_" in word else float(word)
    except ValueError:
        return float("nan")
