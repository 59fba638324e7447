"""Writer of small glTF files from arrays, and reader of one image."""

from __future__ import annotations

import base64
import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image

from irrsplat.core.errors import InputError
from irrsplat.scene.io.images import read_images
from irrsplat.scene.model import Image

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.uint32)  # a tetrahedron, wound outward
TRIANGLE = POINTS[:3]

_KINDS = {"b": 5120, "B": 5121, "h": 5122, "H": 5123, "I": 5125, "f": 5126}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class GltfFile:
    """Growing glTF tree, and the bytes of its single buffer."""

    def __init__(self) -> None:
        self.tree: dict[str, Any] = {"asset": {"version": "2.0"}}
        self.data = b""

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Add `entry` to the list `kind`; return its index."""
        self.tree.setdefault(kind, []).append(entry)
        return len(self.tree[kind]) - 1

    def view(self, data: bytes, **more: Any) -> int:
        """Add a buffer view of `data`; return its index."""
        self.data += b"\0" * (-len(self.data) % 4)
        index = self.add("bufferViews", {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more})
        self.data += data
        return index

    def accessor(self, array: np.ndarray, stride: int | None = None, **more: Any) -> int:
        """Add an accessor of an array (N,) or (N, n); return its index. stride: in bytes, padded with 255."""
        rows = np.ascontiguousarray(array).reshape(len(array), -1)
        size = rows.shape[1] * rows.itemsize
        padded = np.full((len(rows), stride or size), 255, np.uint8)
        padded[:, :size] = rows.view(np.uint8).reshape(len(rows), size)
        view = self.view(padded.tobytes(), **({"byteStride": stride} if stride else {}))
        kind = {"componentType": _KINDS[array.dtype.char], "count": len(rows), "type": _TYPES[rows.shape[1]]}
        return self.add("accessors", {"bufferView": view, **kind, **more})

    def mesh(self, material: dict[str, Any] | None = None, indices: np.ndarray | None = FACES, **attributes: Any) -> int:
        """Add a mesh, by default the tetrahedron; return its index. attributes: arrays or indices of accessors."""
        given = {"POSITION": POINTS, **attributes}
        found = {name: array if isinstance(array, int) else self.accessor(array) for name, array in given.items()}
        primitive: dict[str, Any] = {"attributes": found}
        if indices is not None:
            primitive["indices"] = self.accessor(np.asarray(indices).reshape(-1))
        if material is not None:
            primitive["material"] = self.add("materials", material)
        return self.add("meshes", {"primitives": [primitive]})

    def node(self, **entry: Any) -> int:
        """Add a node; return its index."""
        return self.add("nodes", entry)

    def texture(self, pixels: np.ndarray, kind: str = "PNG", **sampler: Any) -> int:
        """Add a texture of an image (H, W, 3 or 4) in a buffer view; return its index."""
        image = self.add("images", {"bufferView": self.view(encoded(pixels, kind)), "mimeType": f"image/{kind.lower()}"})
        return self.add("textures", {"source": image, **({"sampler": self.add("samplers", sampler)} if sampler else {})})

    def used(self, *extensions: str) -> None:
        """Register extensions as used."""
        self.tree.setdefault("extensionsUsed", []).extend(extensions)

    def inline(self) -> dict[str, Any]:
        """Return the tree with its buffer in a data URI."""
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        return {**self.tree, "buffers": [{"byteLength": len(self.data), "uri": uri}]} if self.data else self.tree

    def gltf(self, path: Path) -> Path:
        """Write the file as one .gltf and return `path`."""
        path.write_text(json.dumps(self.inline()))
        return path

    def packed(self) -> bytes:
        """Return the file as a GLB, with its buffer in a chunk."""
        text = json.dumps({**self.tree, "buffers": [{"byteLength": len(self.data)}]}).encode()
        text, data = text + b" " * (-len(text) % 4), self.data + b"\0" * (-len(self.data) % 4)
        body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    def glb(self, path: Path) -> Path:
        """Write the file as a .glb and return `path`."""
        path.write_bytes(self.packed())
        return path


def f32(values: Any) -> np.ndarray:
    """Return `values` as an array of 32-bit floats."""
    return np.asarray(values, np.float32)


def typed(kind: type, values: Any) -> np.ndarray:
    """Return `values` as an array of this kind."""
    return np.asarray(values, kind)


def encoded(pixels: np.ndarray, kind: str = "PNG") -> bytes:
    """Return the bytes of an image file with these pixels."""
    stream = io.BytesIO()
    PIL.Image.fromarray(pixels).save(stream, kind, **({"lossless": True, "exact": True} if kind == "WebP" else {}))
    return stream.getvalue()


def read_image(data: bytes, name: str) -> Image:
    """Return the image of a file with these bytes; raise the error of `read_images`."""
    (found,) = read_images([(data, name)])
    if isinstance(found, InputError):
        raise found
    return found
