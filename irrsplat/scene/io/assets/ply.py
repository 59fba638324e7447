"""Reader of `.ply` files, text or binary: polygons with colours and normals of their vertices."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from irrsplat.core.color import linear_from_srgb
from irrsplat.core.errors import InputError
from irrsplat.core.load_options import LoadOptions
from irrsplat.core.paths import MOST_GEOMETRY, read_bytes
from irrsplat.core.words import GREATEST, quote
from irrsplat.scene.io.mesh_builder import Part, crease_normals
from irrsplat.scene.io.obj.polygons import triangulate
from irrsplat.scene.io.obj.text import decoded, floats

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
_INDICES = ("vertex_indices", "vertex_index")


@dataclass(frozen=True)
class _Property:
    """One column of an element: its name and type, and for a list the type of its count."""

    name: str
    type: str
    count: str = ""


@dataclass(frozen=True)
class _Element:
    name: str
    length: int
    properties: list[_Property] = field(default_factory=list)


@dataclass(frozen=True)
class _List:
    """Rows of different lengths: concatenated values, and the size of each."""

    values: np.ndarray
    sizes: np.ndarray


Columns = dict[str, "np.ndarray | _List"]


def read_ply(path: Path, notices: list[str], options: LoadOptions) -> list[Part]:
    """Read the faces of the file as one part; vertex colours are sRGB.

    Columns are x y z, nx ny nz, red green blue and `vertex_indices`. Missing normals are computed by the crease angle. Invalid
    faces are left out, and textures and colours of faces are not shown, with a notice. Raises InputError for a truncated file,
    for no PLY file, and for one without faces.
    """
    data = read_bytes(path, MOST_GEOMETRY)
    end = re.search(rb"end_header[ \t]*(\r\n|\n|\r)", data[:100_000])
    if not re.match(rb"ply\s", data) or end is None:
        raise InputError("this is no PLY file (it has no PLY header); export it again", path)
    order, elements, textured = _header(path, decoded(data[: end.start()]))
    body = data[end.end() :]
    tables: dict[str, Columns] = {}
    reader = _TextBody(body) if order == "ascii" else _BinaryBody(body, order)
    for element in elements:
        columns = reader.element(element)
        if columns is None:
            if tables.keys() >= {"vertex", "face"}:
                break  # all drawn elements have been read
            raise InputError(f"the file is truncated: its header declares {element.length} of '{element.name}'", path)
        tables[element.name] = columns
    vertex = tables.get("vertex", {})
    if not {"x", "y", "z"} <= vertex.keys():
        raise InputError("there are no vertices in this file; expected an element 'vertex' with x, y and z", path)
    positions, face = _stacked(vertex, ("x", "y", "z")), tables.get("face", {})
    corners, lost = _triangles(positions, face)
    if not len(corners):
        raise InputError("there are no faces in this file; a cloud of points can't be lit", path)
    if lost:
        reason = "they have fewer than three corners, or a vertex that is not there or not finite"
        notices.append(f"{path}: {lost} face{'s' * (lost > 1)} left out; {reason}")
    if textured:
        notices.append(f"{path}: the textures of this PLY file are not shown; save it as glTF or OBJ to keep them")
    colors = None
    if own := next((names for names in _COLORS if vertex.keys() >= set(names)), None):
        colors = _unit_colors(np.stack([np.asarray(vertex[name]) for name in own], 1))
    elif any(face.keys() >= set(names) for names in _COLORS):
        notices.append(f"{path}: the colours of the faces are not shown; save the file with colours of vertices to keep them")
    normals, corner_normals = None, None
    if vertex.keys() >= {"nx", "ny", "nz"}:
        normals = _stacked(vertex, ("nx", "ny", "nz"))
        corner_normals = corners
    positions = np.where(np.isfinite(positions), positions, 0.0)
    if normals is None and options.crease_angle > 0.0:
        normals, corner_normals = crease_normals(positions, corners, options.crease_angle)
    return [Part(positions, corners, normals, corner_normals, colors=colors, name=path.stem)]


def _header(path: Path, text: str) -> tuple[str, list[_Element], bool]:
    """Return a header's format ("ascii", "<" or ">"), its elements, and True if it names a texture; raise InputError for an
    invalid one."""
    order, elements, textured = "", [], False
    for i, line in enumerate(text.splitlines(), 1):
        words = line.split()
        try:
            if not words:
                continue
            if words[0] == "comment":
                textured |= words[1:2] == ["TextureFile"]
            elif words[0] == "format":
                order = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}[words[1]]
            elif words[0] == "element":
                elements.append(_Element(words[1], max(int(words[2]), 0)))
            elif words[0] == "property":
                name, kind, count = (words[4], words[3], _TYPES[words[2]]) if words[1] == "list" else (words[2], words[1], "")
                elements[-1].properties.append(_Property(name, _TYPES[kind], count))
        except (KeyError, IndexError, ValueError):
            raise InputError(f"this is no line of a PLY header: {quote(line.strip())}; export it again", path, i) from None
    if not order:
        raise InputError("this PLY file has no 'format' line; export it again", path)
    return order, elements, textured


class _TextBody:
    """Elements of a text file, read in order; a row is a line, whose surplus words are ignored."""

    def __init__(self, body: bytes) -> None:
        text = b"\n" + re.sub(rb"(?m)^[ \t]*(comment|obj_info)[^\n]*", b"", body) + b"\n"
        code = np.frombuffer(text, np.uint8)
        gap = code <= 32
        word = np.flatnonzero(gap[:-1] & ~gap[1:]) + 1
        line = np.searchsorted(np.flatnonzero((code == 10) | (code == 13)), word)
        self.first = np.flatnonzero(np.diff(line, prepend=-1))
        self.end = np.append(self.first[1:], len(word))
        self.values = floats(code.tobytes(), len(word))
        self.at = 0

    def element(self, element: _Element) -> Columns | None:
        """Return the columns of the next element; None where lines or words are missing."""
        rows = slice(self.at, self.at + element.length)
        at, end = self.first[rows], self.end[rows]
        if len(at) < element.length:
            return None
        columns: Columns = {}
        for one in element.properties:
            size = np.ones(len(at), np.int64)
            if (at >= end).any():
                return None
            if one.count:
                size = np.nan_to_num(self.values[at], nan=-1.0).astype(np.int64)
                at = at + 1
            if ((size < 0) | (at + size > end)).any():
                return None
            found = self.values[at if not one.count else _list_rows(at, size)]
            columns[one.name] = _List(found, size) if one.count else found.astype(one.type)
            at = at + size
        self.at += element.length
        return columns


class _BinaryBody:
    """Elements of a binary file, read in order."""

    def __init__(self, data: bytes, order: str) -> None:
        self.data, self.order, self.at = data, order, 0

    def element(self, element: _Element) -> Columns | None:
        """Return the columns of the next element; None where bytes are missing."""
        fields, at = [], self.at
        for one in element.properties:  # as if all rows were as long as the first
            if one.count:
                size = self._count(one, at) if element.length else 0
                if size is None:
                    return None
                fields += [(f"{one.name} count", self.order + one.count), (one.name, self.order + one.type, (size,))]
            else:
                fields += [(one.name, self.order + one.type)]
            at = self.at + np.dtype(fields).itemsize
        row = np.dtype(fields)
        if self.at + row.itemsize * element.length <= len(self.data):
            table = np.frombuffer(self.data, row, element.length, self.at)
            lists = [one for one in element.properties if one.count]
            if all((table[f"{one.name} count"] == row[one.name].shape[0]).all() for one in lists):
                self.at += table.nbytes
                columns: Columns = {one.name: table[one.name] for one in element.properties if not one.count}
                for one in lists:
                    columns[one.name] = _List(table[one.name].reshape(-1), np.full(element.length, row[one.name].shape[0]))
                return columns
        return self._ragged(element) if any(one.count for one in element.properties) else None

    def _count(self, one: _Property, at: int) -> int | None:
        if at + np.dtype(one.count).itemsize > len(self.data):
            return None
        size = int(np.frombuffer(self.data, self.order + one.count, 1, at)[0])
        return size if 0 <= size <= len(self.data) else None

    def _ragged(self, element: _Element) -> Columns | None:
        starts: list[list[int]] = [[] for _ in element.properties]
        sizes: list[list[int]] = [[] for _ in element.properties]
        codes = [struct.Struct(self.order + np.dtype(one.count or "u1").char) for one in element.properties]
        widths = [np.dtype(one.type).itemsize for one in element.properties]
        data, at, end = self.data, self.at, len(self.data)
        for _ in range(element.length):  # each row defines the start of the next one
            for column, one in enumerate(element.properties):
                size = 1
                if one.count:
                    if at + codes[column].size > end:
                        return None
                    size = int(codes[column].unpack_from(data, at)[0])
                    at += codes[column].size
                if size < 0 or at + size * widths[column] > end:
                    return None
                starts[column].append(at)
                sizes[column].append(size)
                at += size * widths[column]
        code = np.frombuffer(data, np.uint8)
        columns: Columns = {}
        for one, places, counts, width in zip(element.properties, starts, sizes, widths, strict=True):
            place, count = np.array(places, np.int64), np.array(counts, np.int64)
            first = _list_rows(place, count, width)
            values = code[first[:, None] + np.arange(width)].reshape(-1).view(self.order + one.type)
            columns[one.name] = _List(values, count) if one.count else values
        self.at = at
        return columns


def _list_rows(start: np.ndarray, size: np.ndarray, step: int = 1) -> np.ndarray:
    """Return start, start + step, … for each of the lists, concatenated."""
    inside = np.arange(int(size.sum())) - np.repeat(np.cumsum(size) - size, size)
    return np.asarray(np.repeat(start, size) + step * inside)


def _stacked(columns: Columns, names: tuple[str, ...]) -> np.ndarray:
    """Return (N, len(names)) float64."""
    return np.stack([np.asarray(columns[name], float) for name in names], 1)


def _triangles(positions: np.ndarray, columns: Columns) -> tuple[np.ndarray, int]:
    """Return (F, 3) into positions, of the faces with these `columns`, and the number of lost faces."""
    lists = next((columns[name] for name in _INDICES if name in columns), None)
    if not isinstance(lists, _List) or not len(lists.values):
        return np.zeros((0, 3), np.int64), 0
    usable = np.isfinite(positions).all(1) & (np.abs(positions) < GREATEST).all(1)
    owner = np.repeat(np.arange(len(lists.sizes)), lists.sizes)
    index = np.nan_to_num(lists.values.astype(float), nan=-1.0).astype(np.int64)
    there = (index >= 0) & (index < len(positions))
    bad = lists.sizes < 3
    bad[owner[~there | ~usable[np.where(there, index, 0)]]] = True
    entries = np.flatnonzero(~bad[owner])
    local, _ = triangulate(positions, index[entries], lists.sizes[~bad])
    return index[entries][local], int(bad.sum())


def _unit_colors(values: np.ndarray) -> np.ndarray:
    """Return (N, 3) linear reflectance of sRGB colours, either integers of some width or floats in 0..1."""
    if values.dtype.kind in "ui":
        scale = float(np.iinfo(values.dtype).max)
    else:
        scale = 255.0 if float(np.nan_to_num(values).max(initial=0.0)) > 2.0 else 1.0
    return linear_from_srgb(np.clip(np.nan_to_num(values.astype(float) / scale), 0.0, 1.0))
