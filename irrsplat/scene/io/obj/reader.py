"""Reader of the geometry of `.obj` files with whole-array operations: a million triangles take seconds."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from irrsplat.core.color import linear_from_srgb
from irrsplat.core.errors import InputError
from irrsplat.core.paths import MOST_GEOMETRY
from irrsplat.core.words import GREATEST, number
from irrsplat.scene.io.lines import text_bytes
from irrsplat.scene.io.obj.faces import Faces, explain_face, read_faces
from irrsplat.scene.io.obj.polygons import triangulate
from irrsplat.scene.io.obj.text import COORDINATE, NORMAL, OTHER, VERTEX, Lines, block, decoded, find_lines, floats

_NOT_SHOWN = {"l": "lines", "p": "points", "curv": "curves", "curv2": "curves", "surf": "surfaces"}
_OTHER_WORDS = {*_NOT_SHOWN, "o", "g", "s", "vp", "usemtl", "mtllib", "v", "vn", "vt", "f"}
_USAGE = {VERTEX: "v X Y Z", NORMAL: "vn X Y Z", COORDINATE: "vt U V"}


@dataclass(frozen=True)
class Shape:
    """Triangles of an .obj file before any transform; indices count from 0.

    positions: (V, 3) float64. colors: (V, 3) linear, or None. normals: (N, 3) float64, as written. uvs: (T, 2) float64, v down
    from the image's top. corners: (F, 3) int64 into positions. corner_normals, corner_uvs: (F, 3) int64, -1 for none.
    materials: (F,) int64 into names; names[0] is "" (none). groups: (F,) into group_names, likewise. flat: (F,) bool, True where
    smoothing is off. libraries: the mtllib lines, as written. notices: omissions, in lines without the file's name.
    """

    positions: np.ndarray
    colors: np.ndarray | None
    normals: np.ndarray
    uvs: np.ndarray
    corners: np.ndarray
    corner_normals: np.ndarray
    corner_uvs: np.ndarray
    materials: np.ndarray
    groups: np.ndarray
    flat: np.ndarray
    names: tuple[str, ...] = ("",)
    group_names: tuple[str, ...] = ("",)
    libraries: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()


def load_obj(path: Path, strict: bool = True) -> Shape:
    """Read the triangles of the file at `path`, in file order; convex polygons become fans about their first corner.

    Commands are `v`, `vn`, `vt`, `f` with corners a, a/t, a//n, a/t/n (negative indices count back from the face), `usemtl`,
    `mtllib`, `o`, `g` and `s`; other lines are ignored. Raises InputError for a file that is missing, empty or not text.
    strict: also, with file and line, for a malformed line, corners of several kinds in a face, and invalid indices. Otherwise
    malformed lines are left out with a notice, any encoding is accepted, and `v` may have colours.
    """
    lines = find_lines(path, text_bytes(path, strict, MOST_GEOMETRY))
    others = np.flatnonzero(lines.kind == OTHER)
    spans = zip(lines.start[others].tolist(), lines.end[others].tolist(), strict=True)
    table = _State(others, [lines.data[a:b].split(None, 1) for a, b in spans])
    if len(others) == len(lines.kind) > 0 and not set(map(decoded, table.keys)) & _OTHER_WORDS:
        raise InputError("no line of this file is an OBJ command; expected 'v', 'vn' and 'f' lines", path)
    remarks: list[str] = []
    vertices = _vectors(lines, VERTEX, (3, 4, 6, 7), strict, remarks)
    normals = _vectors(lines, NORMAL, (3,), strict, remarks)[:, :3]
    coordinates = _vectors(lines, COORDINATE, (1, 2, 3), False, [] if strict else remarks)
    positions = vertices[:, :3]

    faces = read_faces(lines, strict)
    if strict and len(faces.bad):
        raise InputError(explain_face(lines, int(faces.bad[0])), path, lines.number(faces.bad[0]))
    faces = _without_bad_vertices(lines, faces, positions, remarks)
    at, polygon = triangulate(positions, faces.corners[:, 0], faces.sides)
    line = faces.lines[polygon]
    if not strict:
        table.report_not_shown(remarks)
    names, materials = table.names(b"usemtl", line)
    group_names, groups = table.names(b"g o", line)
    corners, corner_uvs, corner_normals = (np.ascontiguousarray(faces.corners[:, i])[at] for i in range(3))
    return Shape(
        np.nan_to_num(positions),
        None if strict else _colors(vertices),
        np.nan_to_num(normals, posinf=0.0, neginf=0.0),
        _uvs_from_top(coordinates),
        corners,
        corner_normals,
        corner_uvs,
        materials,
        groups,
        table.flat(line),
        names,
        group_names,
        tuple(decoded(table.rests[i]).strip() for i in table.lines_of(b"mtllib") if table.rests[i]),
        tuple(remarks),
    )


def _vectors(lines: Lines, kind: int, counts: tuple[int, ...], strict: bool, remarks: list[str]) -> np.ndarray:
    """Return (N, 3 or more) float64: the numbers of each line of one kind, in file order; NaN for missing ones.

    The first three are NaN in invalid lines, which raise InputError if `strict`; otherwise a remark counts them.
    """
    text = block(lines, np.flatnonzero(lines.kind == kind))
    values, least = floats(text.code.tobytes(), len(text.word)), counts[0]
    width = min(7, max(3, int(text.count.max(initial=0))))
    if (text.count == width).all():
        table = values.reshape(-1, width)
    else:
        table = np.full((len(text.lines), width), np.nan)
        for axis in range(width):
            has = text.count > axis
            table[has, axis] = values[text.first[has] + axis]
    with np.errstate(invalid="ignore"):
        bad = (text.count < least) | ~(np.abs(table[:, : min(least, 2 if kind == COORDINATE else 3)]) < np.inf).all(1)
        bad |= ~np.isin(text.count, counts) if strict else (np.abs(table[:, :least]) > GREATEST).any(1)
    if bad.any():
        first = text.lines[np.argmax(bad)]
        reason = _number_error(lines, first, counts if strict else (), kind)
        if strict:
            raise InputError(reason, lines.path, lines.number(first))
        remarks.append(_counted(int(bad.sum()), f"'{_USAGE[kind].split()[0]}' line", f"line {lines.number(first)}: {reason}"))
        table = table.copy()
        table[bad] = np.nan
    return table


def _counted(count: int, what: str, first: str) -> str:
    return f"{count} {what}{'s' * (count > 1)} can't be read and {'are' if count > 1 else 'is'} left out; the first is {first}"


def _number_error(lines: Lines, line: int, counts: tuple[int, ...], kind: int) -> str:
    """Return the error in the numbers of the `line`-th line."""
    usage, args = _USAGE[kind], lines.words(line)
    if (counts and len(args) not in counts) or len(args) < (1 if kind == COORDINATE else 3):
        return f"'{usage.split()[0]}' has {len(args)} values; expected: {usage}"
    for word in args[:3]:
        try:
            number(word)
        except ValueError as error:
            return f"{error}; expected: {usage}"
    return f"a malformed line; expected: {usage}"


def _without_bad_vertices(lines: Lines, faces: Faces, positions: np.ndarray, remarks: list[str]) -> Faces:
    """Return the faces with valid vertices; remarks count the others, and the invalid lines."""
    broken = np.isnan(positions[:, 0])
    lost = np.zeros(0, int)
    if broken.any() and len(faces.corners):
        owner = np.repeat(np.arange(len(faces.lines)), faces.sides)
        wrong = np.zeros(len(faces.lines), bool)
        wrong[owner[broken[faces.corners[:, 0]]]] = True
        lost = faces.lines[wrong]
        faces = Faces(faces.lines[~wrong], faces.sides[~wrong], faces.corners[~wrong[owner]], faces.bad, faces.loose)
    all_lost = np.sort(np.concatenate([faces.bad, lost]))
    if len(all_lost):
        first = all_lost[0]
        reason = "one of its vertices can't be read" if first in lost else explain_face(lines, int(first))
        remarks.append(_counted(len(all_lost), "face", f"line {lines.number(first)}: {reason}"))
    if faces.loose:
        remarks.append(
            f"{faces.loose} corners refer to texture coordinates or normals that do not exist, and are read without these"
        )
    return faces


def _colors(vertices: np.ndarray) -> np.ndarray | None:
    """Return (V, 3) linear colours from sRGB in 0..1 or 0..255 after the positions, white if missing; None for none at all."""
    if vertices.shape[1] < 6:
        return None
    rgb = vertices[:, 3:6]
    there = np.isfinite(rgb).all(1)
    if not there.any() or rgb[there].min() < 0.0 or rgb[there].max() > 255.0:
        return None  # normals, or other data of some programs
    scale = 255.0 if rgb[there].max() > 2.0 else 1.0
    colors = np.ones((len(vertices), 3))
    colors[there] = linear_from_srgb(np.minimum(rgb[there] / scale, 1.0))
    return None if (colors == 1.0).all() else colors


def _uvs_from_top(coordinates: np.ndarray) -> np.ndarray:
    """Return (T, 2) texture coordinates with v downward from the image's top; 0 for missing ones."""
    out: np.ndarray = np.nan_to_num(coordinates[:, :2], posinf=0.0, neginf=0.0)
    out[:, 1] = 1.0 - out[:, 1]
    return out


class _State:
    """State lines between the faces, in file order. lines: (K,) their numbers. keys, rests: their keywords and other words."""

    def __init__(self, lines: np.ndarray, words: list[list[bytes]]) -> None:
        self.lines, self.keys = lines, [word[0].lower() for word in words]
        self.rests = [word[1] if len(word) > 1 else b"" for word in words]

    def lines_of(self, keys: bytes) -> list[int]:
        """Return the lines with one of the keywords in `keys`."""
        requested = set(keys.split())
        return [i for i, key in enumerate(self.keys) if key in requested]

    def names(self, keys: bytes, line: np.ndarray) -> tuple[tuple[str, ...], np.ndarray]:
        """Return the distinct names in these lines, "" first, and the name in effect at each of the lines (F,)."""
        lines_of = self.lines_of(keys)
        number: dict[bytes, int] = {b"": 0}
        index = [0]
        for i in lines_of:
            index.append(number.setdefault(b" ".join(self.rests[i].split()), len(number)))
        return tuple(map(decoded, number)), np.array(index)[np.searchsorted(self.lines[lines_of], line)]

    def flat(self, line: np.ndarray) -> np.ndarray:
        """Return (F,) bool: True where smoothing is off at these lines."""
        lines_of = self.lines_of(b"s")
        off = [False, *(self.rests[i].strip().lower() in (b"off", b"0") for i in lines_of)]
        return np.array(off)[np.searchsorted(self.lines[lines_of], line)]

    def report_not_shown(self, remarks: list[str]) -> None:
        """Add one remark on elements that are not shown."""
        found = Counter(_NOT_SHOWN[key.decode("latin-1")] for key in self.keys if key.decode("latin-1") in _NOT_SHOWN)
        if found:
            remarks.append(f"{' and '.join(f'{count} {what}' for what, count in found.items())} are not shown; only faces are")
