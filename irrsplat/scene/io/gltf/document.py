"""The JSON of a glTF file, the data it refers to, and the record of damaged and unsupported parts."""

from __future__ import annotations

import base64
import json
import math
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.paths import MOST_GEOMETRY, read_bytes
from irrsplat.core.words import GREATEST, spelled
from irrsplat.scene.io.images import find_file

_JSON, _BIN = 0x4E4F534A, 0x004E4942
_UPGRADE = "convert it, for example with gltf-pipeline"


class Damaged(ValueError):
    """A damaged part of the file; the message is the reason, in words that follow a colon."""


class Missing(Damaged):
    """A missing file, called `name`."""

    def __init__(self, name: str) -> None:
        super().__init__(f"{name} is missing")
        self.name = name


READ_ERRORS = (InputError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, MemoryError, struct.error)


@dataclass
class Document:
    """A glTF file, whose buffers are read at their first use.

    tree: the JSON. chunk: the binary chunk of a GLB. size: bytes of all files read. contents: of those apart from `path`.
    lost: names of the parts that are left out, by reason. absent: names of missing images. unshown: unsupported features.
    unpacked: the bytes of compressed buffer views, by index. per_unit: watts of a unit of light.
    """

    path: Path
    tree: dict[str, Any]
    chunk: bytes | None = None
    per_unit: float = 1.0
    size: int = 0
    contents: dict[Path, bytes] = field(default_factory=dict)
    lost: dict[str, list[str]] = field(default_factory=dict)
    absent: dict[str, None] = field(default_factory=dict)
    unshown: dict[str, None] = field(default_factory=dict)
    unpacked: dict[object, np.ndarray] = field(default_factory=dict)
    _buffers: dict[int, memoryview | Damaged] = field(default_factory=dict)

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """A `with` block that reads one part of the scene; an error loses only that part, and `notices` reports it."""
        try:
            yield
        except READ_ERRORS as error:
            known = isinstance(error, (Damaged, InputError))
            self.leave_out(name, (str(error) if known else "its description is damaged"))

    def leave_out(self, name: str, reason: str) -> None:
        """Record that the part called `name` is left out."""
        parts = self.lost.setdefault(reason, [])
        if name not in parts[-1:]:
            parts.append(name)

    def notices(self) -> list[str]:
        """Return a line for each reason of losses, one for missing images, and one for unsupported features."""
        lines = [f"{self.path}: {self.loss(reason)}" for reason in self.lost]
        if self.absent:
            first, *others = self.absent
            more = f" and {len(others)} more images are missing; surfaces are shown without them" if others else " is missing"
            lines.append(f"{self.path}: {first}{more}")
        if self.unshown:
            lines.append(f"{self.path}: not shown: {', '.join(self.unshown)}")
        return lines

    def loss(self, reason: str) -> str:
        """Return the parts that are left out for this reason, in words."""
        first, *others = self.lost[reason]
        more = f" and {len(others)} more part{'s' * (len(others) > 1)} are" if others else " is"
        return f"{first}{more} left out: {reason}"

    def entries(self, kind: str, inside: object = None) -> list[Any]:
        """Return the list called `kind` of the file or of one of its objects; empty if missing."""
        holder = self.tree if inside is None else inside
        found = holder.get(kind) if isinstance(holder, dict) else None
        return found if isinstance(found, list) else []

    def entry(self, kind: str, index: object, inside: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Return the object at `index` of the list called `kind`; raise Damaged if missing."""
        entries, one = self.entries(kind, inside), kind.replace("meshes", "mesh").removesuffix("s")
        if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(entries):
            raise Damaged(f"there is no {one} {index!r:.20}")
        found = entries[index]
        if not isinstance(found, dict):
            raise Damaged(f"{one} {index} is damaged")
        return found

    def buffer(self, index: int) -> memoryview:
        """Return the bytes of a buffer, from the GLB's chunk, a data URI or a file; raise Damaged if missing."""
        if index not in self._buffers:
            try:
                self._buffers[index] = memoryview(self._buffer(index))
            except Damaged as error:
                self._buffers[index] = error
        found = self._buffers[index]
        if isinstance(found, Damaged):
            raise found
        return found

    def _buffer(self, index: int) -> bytes:
        uri = self.entry("buffers", index).get("uri")
        if uri is None:
            if self.chunk is None or index:
                raise Damaged("its binary chunk is missing" if not index else f"buffer {index} has no data")
            return self.chunk
        return self.resource(uri)[0]

    def resource(self, uri: object) -> tuple[bytes, str]:
        """Return the data of a URI, and a name for messages; raise Damaged if missing."""
        if not isinstance(uri, str):
            raise Damaged("a URI is damaged")
        if uri[:5].lower() == "data:":
            head, _, body = uri.partition(",")
            try:
                # padding may be missing, as in browsers; surplus padding is ignored
                return (base64.b64decode(unquote(body) + "==") if head.endswith("base64") else unquote_to_bytes(body)), "data"
            except ValueError:
                raise Damaged("a data URI is damaged") from None
        name = printable(unquote(uri))
        file = find_file(self.path.parent, uri)
        if file is None:
            raise Missing(name)
        if file not in self.contents:
            self.contents[file] = read_bytes(file, MOST_GEOMETRY)
            self.size += len(self.contents[file])
        return self.contents[file], name

    def buffer_name(self, index: int) -> str:
        """Return the name of a buffer's file for messages."""
        uri = self.entry("buffers", index).get("uri")
        return printable(unquote(uri)) if isinstance(uri, str) and uri[:5].lower() != "data:" else "the file"


def printable(text: object) -> str:
    """Return a name from the file, made safe for a one-line message."""
    return spelled(str(text)[:80]).replace("\n", "\\n")


def extension(entry: Mapping[str, Any], name: str) -> dict[str, Any] | None:
    """Return an object's extension with this name, or None."""
    extensions = entry.get("extensions")
    found = extensions.get(name) if isinstance(extensions, dict) else None
    return found if isinstance(found, dict) else None


def number(entry: Mapping[str, Any], key: str, default: float) -> float:
    """Return a finite number of an object, or the default if missing; raise Damaged for other values."""
    return numbers(entry, key, (default,))[0]


def numbers(entry: Mapping[str, Any], key: str, default: tuple[float, ...]) -> tuple[float, ...]:
    """Return finite numbers of an object, as many as in the default, or the default if missing; raise Damaged for others."""
    if key not in entry:
        return default
    values = entry[key] if isinstance(entry[key], list) else [entry[key]]
    if len(values) != len(default) or not all(_is_number(value) for value in values):
        raise Damaged(f"its {key} is damaged")
    return tuple(float(value) for value in values)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) and abs(value) <= GREATEST


def view(document: Document, index: object) -> tuple[np.ndarray, int | None, str]:
    """Return the bytes of a buffer view as (N,) uint8, its byteStride or None, and the name of its buffer for messages.

    Raises Damaged for missing data.
    """
    entry = document.entry("bufferViews", index)
    buffer, start, length = (natural_number(entry, key, 0) for key in ("buffer", "byteOffset", "byteLength"))
    data, stride = np.frombuffer(document.buffer(buffer), np.uint8)[start : start + length], entry.get("byteStride")
    return data, stride if isinstance(stride, int) and stride > 0 else None, document.buffer_name(buffer)


def natural_number(entry: Mapping[str, Any], key: str, default: int | None = None) -> int:
    """Return a non-negative integer of an object; raise Damaged for other values."""
    found = entry.get(key, default)
    if isinstance(found, float) and found.is_integer():
        found = int(found)
    if isinstance(found, bool) or not isinstance(found, int) or found < 0:
        raise Damaged(f"its {key} is damaged")
    return found


def read(path: Path) -> Document:
    """Return the glTF file at `path`; raise InputError for a truncated file and for no glTF 2.0."""
    data = read_bytes(path, MOST_GEOMETRY)
    chunk = None
    try:
        text = data
        if data[:4] == b"glTF":
            text, chunk = _chunks(path, data)
        elif path.suffix.lower() == ".glb" and not data.lstrip().startswith(b"{"):
            raise InputError("this is no GLB file (it does not begin with 'glTF'); export it again", path)
        tree = json.loads(text.decode(json.detect_encoding(text), "replace").removeprefix("\ufeff"))
        version = str(tree["asset"]["version"])
    except (ValueError, KeyError, TypeError, AttributeError, IndexError, struct.error, RecursionError):
        raise InputError("this is no glTF 2.0 file, or a damaged one; export it again", path) from None
    if not version.startswith("2"):
        raise InputError(f"this is glTF {printable(version)}; expected version 2.0; {_UPGRADE}", path)
    return Document(path, tree, chunk, size=len(data))


def _chunks(path: Path, data: bytes) -> tuple[bytes, bytes | None]:
    """Return the JSON and the binary chunk or None of a GLB; raise InputError for a truncated file and for no glTF 2.0."""
    _, version, length = struct.unpack_from("<4sII", data)
    if version != 2:
        raise InputError(f"this is glTF {version}.0; expected version 2.0; {_UPGRADE}", path)
    if length > len(data):
        raise InputError(f"the file is truncated: {len(data)} of {length} bytes are there", path)
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        chunks.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    return chunks[_JSON], chunks.get(_BIN)
