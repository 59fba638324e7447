"""Decompression of buffer views (meshoptimizer) and primitives (Draco); the packages come with the extra `gltf`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from irrsplat.scene.io.gltf.document import Damaged, Document, extension, natural_number, view

MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
DRACO = "KHR_draco_mesh_compression"
_FREE, _PER_BYTE = 1 << 16, 256  # faces and points that a Draco header may declare; a plane has some 6 faces a byte
_INSTALL = "to read it: pip install 'irrsplat[gltf]'"


def plain_view(document: Document, index: object) -> tuple[np.ndarray, int | None, str]:
    """Return the bytes of a buffer view as (N,) uint8, decompressed, its byteStride or None, and its buffer's name for messages.

    Raises Damaged for missing or damaged data.
    """
    entry = document.entry("bufferViews", index)
    packed = next((found for name in MESHOPT if (found := extension(entry, name)) is not None), None)
    if packed is None:
        return view(document, index)
    if index not in document.unpacked:
        document.unpacked[index] = _meshopt(document, packed)
    return document.unpacked[index], natural_number(packed, "byteStride"), document.buffer_name(natural_number(packed, "buffer"))


def _meshopt(document: Document, packed: Mapping[str, Any]) -> np.ndarray:
    try:
        import meshopt
    except ImportError:
        raise Damaged(f"it is compressed with {MESHOPT[0]}; {_INSTALL}") from None
    start, length = natural_number(packed, "byteOffset", 0), natural_number(packed, "byteLength")
    count, stride = natural_number(packed, "count"), natural_number(packed, "byteStride")
    data = document.buffer(natural_number(packed, "buffer"))[start : start + length]
    if count * stride > 256 * max(len(data), 1) * 16:  # far above any compression ratio
        raise Damaged("its compressed data are damaged")
    try:
        plain = meshopt.decode_gltf_buffer(bytes(data), count, stride, packed["mode"], packed.get("filter"))
    except Exception:  # the decoder raises anything for damaged data
        raise Damaged("its compressed data are damaged") from None
    return np.ascontiguousarray(plain).reshape(-1).view(np.uint8)


def draco(document: Document, packed: Mapping[str, Any]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the triangles (F, 3) and the attributes (V, n) by name of a Draco primitive; raise Damaged."""
    try:
        import DracoPy
    except ImportError:
        raise Damaged(f"it is compressed with {DRACO}; {_INSTALL}") from None
    key = packed.get("bufferView")
    data, _, _ = view(document, key)
    try:
        if _declared_size(data.tolist()) > _FREE + _PER_BYTE * len(data):
            raise Damaged("its compressed data declare more than they can hold")
        mesh = DracoPy.decode(bytes(data))
        faces = np.asarray(mesh.faces).reshape(-1, 3)
        attributes = {
            name: np.asarray(mesh.get_attribute_by_unique_id(number)["data"]) for name, number in packed["attributes"].items()
        }
    except Damaged:
        raise
    except Exception:  # the decoder raises anything for damaged data
        raise Damaged("its compressed data are damaged") from None
    return faces, {name: array.reshape(len(array), -1) for name, array in attributes.items()}


def _declared_size(data: list[int]) -> int:
    """Return the number of faces and points that the header of a Draco mesh declares: bitstream 2.2, sections 3 and 4.

    Raises Damaged for metadata, ValueError and IndexError for other data, whose memory the decoder would allocate unchecked.
    """
    kind, method, flags = data[7], data[8], data[10] << 8 | data[9]
    if bytes(data[:5]) != b"DRACO" or data[5:7] < [2, 2] or kind != 1 or method > 1:
        raise ValueError("no mesh of Draco's bitstream 2.2")
    at = 11

    def number() -> int:  # LEB128
        nonlocal at
        found, shift = 0, 0
        while True:
            found |= (data[at] & 127) << shift
            at, shift = at + 1, shift + 7
            if data[at - 1] < 128:
                return found

    if flags & 0x8000:
        raise Damaged("its compressed data begin with metadata; export it again without them")
    at += method  # edgebreaker has a byte for its kind of traversal first
    return number() + number()
