"""Accessors of a glTF file as numpy arrays: strided, sparse, normalized, quantized."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from irrsplat.scene.io.gltf.document import Damaged, Document, natural_number
from irrsplat.scene.io.gltf.packed import plain_view

_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5124: "<i4", 5125: "<u4", 5126: "<f4", 5130: "<f8"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_FREE, _PER_BYTE = 1 << 16, 16  # elements allowed in any file, and further elements per byte, which may be compressed


def count(document: Document, index: object) -> int:
    """Return the number of elements of an accessor; raise Damaged if it is missing, or the number is implausible for the file's
    size."""
    entry = document.entry("accessors", index)
    number = natural_number(entry, "count")
    if "bufferView" in entry:
        plain_view(document, entry["bufferView"])  # the size includes its file from here on
    if number > _FREE + _PER_BYTE * document.size:
        raise Damaged(f"accessor {index} declares {number} elements in a file of {document.size} bytes")
    return number


def values(
    document: Document, index: object, widths: tuple[int, ...], rows: np.ndarray | None = None, shares: bool = False
) -> np.ndarray:
    """Return (N, width) float32: an accessor's elements, all or those of `rows`, normalized integers as 0..1 or -1..1.

    widths: allowed numbers of components. shares: all integers count as normalized.
    Raises Damaged for a missing accessor, and for one that exceeds its data.
    """
    entry = document.entry("accessors", index)
    return as_floats(_elements(document, entry, index, widths, rows), shares or entry.get("normalized") is True)


def as_floats(array: np.ndarray, normalized: bool) -> np.ndarray:
    """Return elements of an accessor as float32, normalized integers as 0..1 or -1..1."""
    if normalized and array.dtype.kind in "iu":
        array = np.maximum(array.astype(np.float32) / np.float32(np.iinfo(array.dtype).max), np.float32(-1.0))
    return np.asarray(array, np.float32)


def integers(document: Document, index: object, widths: tuple[int, ...] = (1,), rows: np.ndarray | None = None) -> np.ndarray:
    """Return (N, width) int64: an accessor's elements; raise Damaged as `values`, and for other types."""
    array = _elements(document, document.entry("accessors", index), index, widths, rows)
    if array.dtype.kind not in "iu":
        raise Damaged(f"accessor {index} holds no integers")
    return np.asarray(array, np.int64)


def _elements(
    document: Document, entry: Mapping[str, Any], index: object, widths: tuple[int, ...], rows: np.ndarray | None
) -> np.ndarray:
    width = _WIDTHS.get(str(entry.get("type")))
    kind = _TYPES.get(natural_number(entry, "componentType"))
    if width not in widths or kind is None:
        raise Damaged(f"accessor {index} has an unexpected type")
    number = count(document, index)
    plain = "bufferView" in entry
    array = _bytes(document, entry, number, width, np.dtype(kind), index) if plain else np.zeros((number, width), kind)
    sparse = entry.get("sparse")
    if isinstance(sparse, dict):
        array = _replaced(document, sparse, array, index)
    if rows is None:
        return np.asarray(array)
    if len(rows) and rows.max() >= number:
        raise Damaged(f"accessor {index} has {number} elements, and {rows.max() + 1} are needed")
    return np.asarray(array[rows])


def _bytes(
    document: Document, entry: Mapping[str, Any], number: int, width: int, kind: np.dtype[Any], index: object
) -> np.ndarray:
    """Return (number, width) elements in the buffer view of `entry`, without a copy; raise Damaged where they exceed it."""
    view, offset = entry["bufferView"], natural_number(entry, "byteOffset", 0)
    data, stride, name = plain_view(document, view)
    size = width * kind.itemsize
    stride = stride or size
    if not number:
        return np.zeros((0, width), kind)
    if offset + stride * (number - 1) + size > len(data):
        raise Damaged(f"accessor {index} reaches beyond its data; {name} is truncated")
    return np.ndarray((number, width), kind, data, offset, (stride, kind.itemsize))


def _replaced(document: Document, sparse: Mapping[str, Any], array: np.ndarray, index: object) -> np.ndarray:
    """Return the elements with those of a sparse accessor replaced."""
    number = natural_number(sparse, "count")
    at, new = sparse["indices"], sparse["values"]
    places = _bytes(document, at, number, 1, np.dtype(_TYPES[at["componentType"]]), index).astype(np.int64)[:, 0]
    if number and not 0 <= places.min() <= places.max() < len(array):
        raise Damaged(f"accessor {index} replaces elements that it does not have")
    array = array.copy()
    array[places] = _bytes(document, new, number, array.shape[1], array.dtype, index)
    return array
