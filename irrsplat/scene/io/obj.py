"""Reads the geometry of an `.obj` file with whole-array operations: a million triangles take seconds."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.scene.io.lines import number, quote, text_bytes

_SPACE = np.isin(np.arange(256), list(b" \t\n\v\f"))
_KINDS = (b"v", b"vn", b"f", b"usemtl", b"mtllib")
_VERTEX, _NORMAL, _FACE, _USE, _LIBRARY = range(5)
_FORMS = {0: ("v",), 1: ("v", "t"), 2: ("v", "t", "n"), 3: ("v", "n")}  # by the slashes of a corner; 3 is a//n
_CORNER = re.compile(r"[+-]?[0-9]{1,18}(?:/[+-]?[0-9]{1,18}|//[+-]?[0-9]{1,18}|(?:/[+-]?[0-9]{1,18}){2})?")


@dataclass(frozen=True)
class Shape:
    """Triangles as an .obj file has them, before any transform; indices count from 0.

    positions: (V, 3) float64. normals: (N, 3) float64, as written. corners: (F, 3) int64 into positions.
    corner_normals: (F, 3) int64 into normals, -1 for none. materials: (F,) int64 into names; names[0] is "" (none yet).
    libraries: the mtllib files, as written.
    """

    positions: np.ndarray
    normals: np.ndarray
    corners: np.ndarray
    corner_normals: np.ndarray
    materials: np.ndarray
    names: tuple[str, ...] = ("",)
    libraries: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Lines:
    """The bytes of a file and, for each line that is not blank: start, end, count of words, and kind (or -1)."""

    path: Path
    data: bytes
    start: np.ndarray
    end: np.ndarray
    words: np.ndarray
    kind: np.ndarray
    form: np.ndarray

    def text(self, which: np.ndarray) -> bytes:
        """The lines that `which` (a mask) picks, one after another."""
        if not which.any():
            return b""
        mark = np.zeros(len(self.data) + 1, np.int8)
        mark[self.start[which]] += 1
        mark[self.end[which]] -= 1  # a line ends before the next begins: its newline is left out, so put one back
        mask = np.cumsum(mark[:-1], dtype=np.int8).astype(bool)
        mask[np.minimum(self.end[which], len(self.data) - 1)] = True
        return bytes(np.frombuffer(self.data, np.uint8)[mask])

    def fail(self, line: int | np.integer, message: str) -> NoReturn:
        """Raises InputError at the `line`-th of these lines; a continued line (its break is a \\v) counts as several."""
        at = int(self.start[line])
        raise InputError(message, self.path, self.data.count(b"\n", 0, at) + self.data.count(b"\v", 0, at) + 1)

    def args(self, line: int | np.integer) -> list[str]:
        """The words after the keyword of the `line`-th of these lines."""
        return [word.decode() for word in self.data[self.start[line] : self.end[line]].split()[1:]]


def load_obj(path: Path) -> Shape:
    """The triangles of the file at `path`; polygons become fans about their first corner, in file order.

    Reads `v`, `vn`, `f a`, `f a/t`, `f a//n`, `f a/t/n` (negative indices count back from the last one above the face),
    `usemtl` and `mtllib`; other lines are ignored. Raises InputError with file and line for a malformed line, an index
    that is 0 or beyond what the file has, and a file that is missing, empty or no text.
    """
    lines = _scan(path)
    if len(lines.kind) and not (lines.kind >= 0).any():
        _refuse_other_text(lines)
    positions = _vectors(lines, _VERTEX, (3, 4, 6, 7), "v X Y Z")
    normals = _vectors(lines, _NORMAL, (3,), "vn X Y Z")
    corners, corner_normals, line = _faces(lines, len(positions), len(normals))

    used = np.flatnonzero(lines.kind == _USE)
    words = [" ".join(lines.args(i)) for i in used]
    names = tuple(dict.fromkeys(["", *words]))
    index = np.array([0, *(names.index(word) for word in words)])
    materials = index[np.searchsorted(used, line)]
    libraries = tuple(" ".join(lines.args(i)) for i in np.flatnonzero(lines.kind == _LIBRARY))
    return Shape(positions, normals, corners, corner_normals, materials, names, libraries)


def _scan(path: Path) -> _Lines:
    data = text_bytes(path)
    if b"#" in data:
        data = re.sub(rb"#[^\n]*", b"", data)
    if b"\\\n" in data:
        data = data.replace(b"\\\n", b" \v")
    data += b"\n"
    code = np.frombuffer(data, np.uint8)
    gap = _SPACE[code]
    begins = np.flatnonzero(~gap & np.concatenate([[True], gap[:-1]]))  # of each word
    breaks = np.flatnonzero(code == 10)
    line = np.searchsorted(breaks, begins)
    first = np.flatnonzero(np.diff(line, prepend=-1))  # the words that open a line
    start, end = begins[first], breaks[line[first]]
    words = np.diff(first, append=len(begins))

    kind = np.full(len(start), -1, np.int8)
    for i, keyword in enumerate(_KINDS):
        same = gap[np.minimum(start + len(keyword), len(code) - 1)]
        for k, letter in enumerate(keyword):
            same &= code[np.minimum(start + k, len(code) - 1)] == letter
        kind[same] = i

    slash = np.flatnonzero(code == ord("/"))
    word = np.searchsorted(begins, slash, "right") - 1
    double = slash[code[slash + 1] == ord("/")]
    form = np.bincount(word, minlength=len(begins))
    form += np.bincount(np.searchsorted(begins, double, "right") - 1, minlength=len(begins))
    form[first] = form[np.minimum(first + 1, len(form) - 1)]  # the keyword has no form of its own
    form = form.astype(np.int32)
    alike = np.minimum.reduceat(form, first) == np.maximum.reduceat(form, first) if len(first) else np.zeros(0, bool)
    form = np.where(alike & (kind == _FACE), form[first], -1)
    return _Lines(path, data, start, end, words, kind, form)


def _refuse_other_text(lines: _Lines) -> None:
    """Raises InputError unless some line begins with a word that OBJ files have, if none that is read here."""
    words = {lines.data[a:b].split()[0] for a, b in zip(lines.start.tolist(), lines.end.tolist(), strict=True)}
    if not words & {b"o", b"g", b"s", b"vt", b"vp", b"l", b"p"}:
        raise InputError("no line of this file is OBJ; expected 'v', 'vn' and 'f' lines", lines.path)


def _vectors(lines: _Lines, kind: int, counts: tuple[int, ...], usage: str) -> np.ndarray:
    """(N, 3) float64: the first three numbers of each line of one kind, in file order."""
    which = lines.kind == kind
    out = np.empty((int(which.sum()), 3))
    rank = np.cumsum(which) - 1
    done = 0
    for count in counts:
        group = which & (lines.words == count + 1)
        if group.any():
            text = lines.text(group)
            if b"_" in text:  # Python would read 1_0 as 10
                _explain_vector(lines, which, counts, usage)
            words = text.split()
            for axis in range(3):
                try:
                    out[rank[group], axis] = np.fromiter(map(float, words[axis + 1 :: count + 1]), float)
                except ValueError:
                    _explain_vector(lines, which, counts, usage)
            done += int(group.sum())
    if done < len(out) or not np.isfinite(out).all():
        _explain_vector(lines, which, counts, usage)
    return out


def _explain_vector(lines: _Lines, which: np.ndarray, counts: tuple[int, ...], usage: str) -> NoReturn:
    for line in np.flatnonzero(which):
        args = lines.args(line)
        if len(args) not in counts:
            lines.fail(line, f"'{usage.split()[0]}' has {len(args)} values; expected: {usage}")
        for word in args[:3]:
            try:
                number(word)
            except ValueError as error:
                lines.fail(line, f"{error}; expected: {usage}")
    raise InputError(f"a malformed line; expected: {usage}", lines.path)


def _faces(lines: _Lines, vertices: int, normals: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(F, 3) corners, (F, 3) normals of the corners (-1: none) and (F,) the line each triangle stands in."""
    which = lines.kind == _FACE
    bad = which & ((lines.words < 4) | ~np.isin(lines.form, list(_FORMS)))
    if bad.any():
        _explain_face(lines, int(np.argmax(bad)))
    above_v, above_n = np.cumsum(lines.kind == _VERTEX), np.cumsum(lines.kind == _NORMAL)
    corners, corner_normals, owners = [np.zeros((0, 3), int)], [np.zeros((0, 3), int)], [np.zeros(0, int)]
    keys = np.where(which, lines.words * len(_FORMS) + lines.form, -1)
    for key in np.unique(keys[which]):
        group, sides, form = keys == key, int(key) // len(_FORMS) - 1, _FORMS[int(key) % len(_FORMS)]
        try:
            text = lines.text(group)
            if b"_" in text:  # Python would read 1_0 as 10
                raise ValueError
            words = text.replace(b"/", b" ").replace(b"f", b" ").split()
            table = np.fromiter(map(int, words), np.int64).reshape(-1, sides, len(form))
        except (ValueError, OverflowError):
            _explain_first_face(lines, group)
        at = np.flatnonzero(group)
        if len(table) != len(at):
            _explain_first_face(lines, group)
        v = _resolve(lines, at, table[:, :, 0], vertices, above_v, "vertex", "v")
        n = np.full_like(v, -1)
        if "n" in form:
            n = _resolve(lines, at, table[:, :, -1], normals, above_n, "normal", "vn")
        fan = np.stack([np.zeros(sides - 2, int), np.arange(1, sides - 1), np.arange(2, sides)], 1)
        corners.append(v[:, fan].reshape(-1, 3))
        corner_normals.append(n[:, fan].reshape(-1, 3))
        owners.append(np.repeat(at, sides - 2))
    line = np.concatenate(owners)
    order = np.argsort(line, kind="stable")
    return np.concatenate(corners)[order], np.concatenate(corner_normals)[order], line[order]


def _resolve(lines: _Lines, at: np.ndarray, index: np.ndarray, count: int, above: np.ndarray, what: str, word: str) -> np.ndarray:
    """Indices from 0 for OBJ's, which count from 1, or back from the last one above the face where negative."""
    resolved = np.where(index < 0, above[at][:, None] + index, index - 1)
    bad = (index == 0) | (resolved < 0) | (resolved >= count)
    if bad.any():
        row, corner = np.argwhere(bad)[0]
        i = int(index[row, corner])
        have = int(above[at[row]]) if i < 0 else count
        reason = "indices start at 1" if i == 0 else f"there are {have} '{word}' lines" + (" above it" if i < 0 else "")
        lines.fail(at[row], f"the face refers to {what} {i}, but {reason}")
    return resolved


def _explain_first_face(lines: _Lines, group: np.ndarray) -> NoReturn:
    for line in np.flatnonzero(group):
        if not all(_CORNER.fullmatch(word) for word in lines.args(line)):
            _explain_face(lines, int(line))
    raise InputError("a malformed face; expected: f A B C", lines.path)


def _explain_face(lines: _Lines, line: int) -> NoReturn:
    args = lines.args(line)
    usage = "expected at least three of a, a/t, a//n or a/t/n, all of one kind"
    if len(args) < 3:
        lines.fail(line, f"a face has {len(args)} corners; {usage}")
    for word in args:
        if not _CORNER.fullmatch(word):
            lines.fail(line, f"{quote(word)} is no corner of a face; {usage}")
    lines.fail(line, f"the corners of this face are of different kinds; {usage}")
