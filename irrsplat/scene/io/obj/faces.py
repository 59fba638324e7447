"""Parser for the faces of an `.obj` file, with any mixture of corners a, a/t, a//n and a/t/n."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from irrsplat.core.words import quote
from irrsplat.scene.io.obj.text import COORDINATE, FACE, NORMAL, VERTEX, Block, Lines, block, numbers

_CORNER = re.compile(r"[+-]?[0-9]{1,18}(?:/[+-]?[0-9]{1,18}|//[+-]?[0-9]{1,18}|(?:/[+-]?[0-9]{1,18}){2})?")
_USAGE = "expected at least three of a, a/t, a//n or a/t/n, all of one kind"
_COMMON = b"0123456789/ \t\n\v\f\r"
_SLASH_TO_BLANK = bytes(32 if c < 32 or c == ord("/") else c for c in range(256))


@dataclass(frozen=True)
class Faces:
    """The valid faces: lines (P,), the number of corners of each (P,), and the corners' indices (C, 3).

    corners: vertex, texture coordinate, normal; from 0, -1 for none. bad: numbers of invalid lines.
    loose: number of corners with an invalid texture coordinate or normal, which is dropped.
    """

    lines: np.ndarray
    sides: np.ndarray
    corners: np.ndarray
    bad: np.ndarray
    loose: int


def read_faces(lines: Lines, strict: bool) -> Faces:
    """Read the faces of the file. strict: mixed forms in a face, and invalid normals, make the face invalid."""
    which = np.flatnonzero(lines.kind == FACE)
    text = block(lines, which)
    bad = _odd_lines(text)
    if bad.any():
        text = block(lines, which[~bad])
    table, form = _table(text)
    wrong = np.zeros(len(text.lines), bool)
    if len(form):
        owner = np.repeat(np.arange(len(text.lines)), text.count)
        table, missing = _resolve(lines, text, owner, table)
        wrong[owner[missing[:, 0] | (form < 0)]] = True
        if strict:
            filled = np.flatnonzero(text.count)
            lowest = np.minimum.reduceat(form, text.first[filled])
            wrong[filled[lowest != np.maximum.reduceat(form, text.first[filled])]] = True
            wrong[owner[missing[:, 2] | (form > 3) | ((form > 1) & (table[:, 2] < 0))]] = True
    wrong |= text.count < 3
    corner_is_good = np.repeat(~wrong, text.count)
    loose = int(missing[corner_is_good, 1:].sum()) if len(form) else 0
    rejected = np.sort(np.concatenate([which[bad], text.lines[wrong]]))
    good = table if corner_is_good.all() else table[corner_is_good]
    return Faces(text.lines[~wrong], text.count[~wrong], good, rejected, loose)


def explain_face(lines: Lines, line: int) -> str:
    """Return the error in the face in the `line`-th line."""
    words = lines.words(line)
    if len(words) < 3:
        return f"a face has {len(words)} corners; {_USAGE}"
    for word in words:
        if not _CORNER.fullmatch(word):
            return f"{quote(word)} is no corner of a face; {_USAGE}"
    if len({"//" in word or -word.count("/") for word in words}) > 1:
        return f"the corners of this face are of different kinds; {_USAGE}"
    for word in words:
        parts = word.split("/")
        for kind, what, part in ((VERTEX, "vertex", parts[0]), (NORMAL, "normal", parts[2] if len(parts) == 3 else "")):
            if part:
                reason = _explain_index(lines, line, kind, int(part))
                if reason:
                    return f"the face refers to {what} {int(part)}, but {reason}"
    return f"a malformed face; {_USAGE}"


def _explain_index(lines: Lines, line: int, kind: int, index: int) -> str:
    has = int((lines.kind[: line if index < 0 else None] == kind).sum())
    if index == 0:
        return "indices start at 1"
    if abs(index) <= has:
        return ""
    return f"there are {has} '{'v' if kind == VERTEX else 'vn'}' lines" + (" above it" if index < 0 else "")


def _odd_lines(text: Block) -> np.ndarray:
    """Return (L,) bool: True for lines with a character that faces do not have, or with a sign within a number."""
    code = text.code
    if not code.tobytes().translate(None, _COMMON):
        return np.zeros(len(text.offset), bool)
    odd = np.flatnonzero((code > 57) | ((code > 32) & (code < 43)) | (code == 44) | (code == 46))
    sign = np.flatnonzero((code == 43) | (code == 45))
    before, after = code[sign - 1], code[sign + 1]
    astray = sign[((before > 32) & (before != 47)) | (after < 48) | (after > 57)]
    positions = np.concatenate([odd, astray])
    bad = np.zeros(len(text.offset), bool)
    bad[np.searchsorted(text.offset, positions, "right") - 1] = True
    return bad


def _table(text: Block) -> tuple[np.ndarray, np.ndarray]:
    """Return (C, 3) the numbers of each corner as written, 0 for missing ones, and (C,) its form.

    Forms: 0 a, 1 a/t, 2 a/t/n, 3 a//n; 4 with a slash at the end; -1 another.
    """
    count, slash = len(text.word), text.code == ord("/")
    gap = (text.code <= 32) | slash
    token = np.flatnonzero(gap[:-1] & ~gap[1:]) + 1
    before = np.cumsum(slash, dtype=np.int32) - slash  # slashes
    first = before[text.word]  # of each word
    word = np.repeat(np.arange(count), np.diff(np.searchsorted(token, text.word), append=len(token)))
    slot = before[token] - first[word]
    slashes = np.diff(first, append=int(np.count_nonzero(slash)))
    values = numbers(text.code.tobytes().translate(_SLASH_TO_BLANK), np.int64, len(token))
    assert values is not None  # `_odd_lines` has excluded other words
    table, there = np.zeros((count, 3), np.int64), np.zeros((count, 3), bool)
    fits = slot < 3
    there[word[fits], slot[fits]] = True
    table[word[fits], slot[fits]] = values[fits]
    forms = np.where(slashes < 2, slashes, np.where(there[:, 1], 2, 3))
    forms[np.where(slashes == 1, ~there[:, 1], (slashes == 2) & ~there[:, 2])] = 4
    forms[~there[:, 0] | (slashes > 2)] = -1
    return table, forms.astype(np.int8)


def _resolve(lines: Lines, text: Block, owner: np.ndarray, table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (C, 3) indices from 0, -1 for none, for OBJ's indices, which count from 1, or if negative back from the face.

    Also return (C, 3) bool: True for invalid indices. A missing vertex is invalid.
    """
    resolved = np.empty_like(table)
    missing = np.zeros(table.shape, bool)
    for column, kind in enumerate((VERTEX, COORDINATE, NORMAL)):
        index = table[:, column]
        has = int((lines.kind == kind).sum())
        least, greatest = int(index.min()), int(index.max())
        if least < 0:
            above = np.cumsum(lines.kind == kind)[text.lines]
            index = np.where(index < 0, np.maximum(above[owner] + index, -1) + 1, index)
            beyond = (index < 0) | (index > has) | ((index == 0) & (table[:, column] != 0))
            index = np.where(beyond, 0, index)
            missing[:, column] = beyond
        elif greatest > has:
            missing[:, column] = index > has
            index = np.where(missing[:, column], 0, index)
        if column == 0:
            missing[:, column] |= index == 0
        resolved[:, column] = index - 1
    return resolved, missing
