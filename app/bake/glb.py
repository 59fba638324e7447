"""Binary glTF 2.0 writer: accessors, images, materials, meshes and cameras as JSON and one buffer."""

from __future__ import annotations

import io
import json
import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from irrsplat import __version__
from irrsplat.scene.model import Camera, Image, Material, Texture

_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_KINDS = {np.dtype(np.float32): 5126, np.dtype(np.uint32): 5125}
_ARRAY, _ELEMENTS = 34962, 34963  # buffer view targets: vertices, indices
_WRAPS = {"clamp": 33071, "mirror": 33648, "repeat": 10497}
_NEAREST, _LINEAR, _MIPMAPS = 9728, 9729, 9987
_FAR = 1e4  # metres: far plane of cameras


class Glb:
    """glTF file under construction.

    extras: metadata of the asset. origin: world position in metres of the local origin. A root node has this translation, so
    that float32 suffices for positions.
    """

    def __init__(self, extras: Mapping[str, object], origin: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": f"irrsplat {__version__}", "extras": dict(extras)},
            "scene": 0,
            "scenes": [{"nodes": []}],
        }
        self._nodes: list[int] = self.json["scenes"][0]["nodes"]
        if any(origin):
            self._node({"name": "origin", "translation": [float(x) for x in origin], "children": []})
            self._nodes = self.json["nodes"][0]["children"]
        self._data = bytearray()
        self._images: dict[Image, int] = {}
        self._textures: dict[object, int] = {}

    def add(self, kind: str, entry: Mapping[str, Any]) -> int:
        """Append an entry to the list `kind`; return its index."""
        entries = self.json.setdefault(kind, [])
        entries.append(dict(entry))
        return len(entries) - 1

    def use(self, extension: str) -> None:
        used = self.json.setdefault("extensionsUsed", [])
        if extension not in used:
            used.append(extension)

    def _view(self, data: bytes, target: int | None = None) -> int:
        self._data += b"\0" * (-len(self._data) % 4)
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self._data), "byteLength": len(data)}
        self._data += data
        return self.add("bufferViews", view if target is None else view | {"target": target})

    def accessor(self, values: np.ndarray, bounds: bool = False) -> int:
        """Add an accessor of (N, 2..4) vertex attributes, or of (N,) uint32 indices."""
        values = np.ascontiguousarray(values)
        index = values.ndim == 1
        entry: dict[str, Any] = {
            "bufferView": self._view(values.tobytes(), _ELEMENTS if index else _ARRAY),
            "componentType": _KINDS[values.dtype],
            "count": len(values),
            "type": _TYPES[1 if index else values.shape[1]],
        }
        if bounds:
            entry |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        return self.add("accessors", entry)

    def picture(self, data: bytes, name: str) -> dict[str, Any]:
        """Add an encoded PNG as a texture: clamped, bilinear, without mipmaps, which would mix charts; return its reference."""
        image = self.add("images", {"bufferView": self._view(data), "mimeType": "image/png", "name": name})
        return self._texture(image, ("clamp", "clamp"), nearest=False, mipmaps=False)

    def texture(self, texture: Texture) -> dict[str, Any]:
        """Add a texture of the scene; return its reference."""
        from PIL import Image as Pillow

        if texture.image not in self._images:
            pixels, data = texture.image.pixels, io.BytesIO()
            clear = bool((pixels[..., 3] == 255).all())
            Pillow.fromarray(pixels[..., :3] if clear else pixels).save(data, "PNG")
            entry = {"bufferView": self._view(data.getvalue()), "mimeType": "image/png"}
            self._images[texture.image] = self.add("images", entry | ({"name": texture.image.name} if texture.image.name else {}))
        return self._texture(self._images[texture.image], texture.wrap, texture.nearest, mipmaps=True)

    def _texture(self, image: int, wrap: tuple[str, str], nearest: bool, mipmaps: bool) -> dict[str, Any]:
        key = image, wrap, nearest, mipmaps
        if key not in self._textures:
            sampler = {
                "magFilter": _NEAREST if nearest else _LINEAR,
                "minFilter": _NEAREST if nearest else _MIPMAPS if mipmaps else _LINEAR,
                "wrapS": _WRAPS[wrap[0]],
                "wrapT": _WRAPS[wrap[1]],
            }
            self._textures[key] = self.add("textures", {"source": image, "sampler": self.add("samplers", sampler)})
        return {"index": self._textures[key]}

    def material(self, material: Material, base: Sequence[float], two_sided: bool) -> dict[str, Any]:
        """Return a new material entry: diffuse reflectance `base` (3,), no specular part, and the opacity of `material`."""
        self.use("KHR_materials_specular")
        entry: dict[str, Any] = {
            "pbrMetallicRoughness": {
                "baseColorFactor": [*map(float, base), material.opacity],
                "metallicFactor": 0.0,
                "roughnessFactor": 1.0,
            },
            "doubleSided": two_sided,
            "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}},
        }
        if material.alpha_mode != "opaque":
            entry["alphaMode"] = material.alpha_mode.upper()
            if material.alpha_mode == "mask":
                entry["alphaCutoff"] = material.alpha_cutoff
        return entry

    def emissive(self, entry: dict[str, Any], color: Sequence[float], texture: Mapping[str, Any] | None = None) -> None:
        """Set the emitted radiance of a material: `color` (3,) in W/(m² sr), multiplied by a texture."""
        strength = max(map(float, color))
        if strength > 0.0:
            self.use("KHR_materials_emissive_strength")
            entry["emissiveFactor"] = [float(c) / strength for c in color]
            entry["extensions"]["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
            if texture is not None:
                entry["emissiveTexture"] = dict(texture)

    def mesh(self, name: str, attributes: Mapping[str, np.ndarray], parts: Sequence[tuple[np.ndarray, int]]) -> None:
        """Add a mesh and its node. attributes: (V, …) by glTF name. parts: faces (F, 3) and their material."""
        accessors = {
            key: self.accessor(values.astype(np.float32), bounds=key == "POSITION") for key, values in attributes.items()
        }
        primitives = [
            {"attributes": accessors, "indices": self.accessor(faces.ravel().astype(np.uint32)), "material": material}
            for faces, material in parts
        ]
        named = {"name": name} if name else {}
        self._node(named | {"mesh": self.add("meshes", named | {"primitives": primitives})})

    def _camera(self, camera: Camera) -> None:
        entry = {"type": "perspective", "perspective": {"yfov": math.radians(camera.fov), "znear": 0.01, "zfar": _FAR}}
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = camera.axes.T, camera.eye
        named = {"name": camera.name} if camera.name else {}
        self._node(named | {"camera": self.add("cameras", named | entry), "matrix": matrix.T.ravel().tolist()})

    def _node(self, node: Mapping[str, Any]) -> None:
        self._nodes.append(self.add("nodes", node))

    def encoded(self, cameras: Iterable[Camera]) -> bytes:
        """Return the file's bytes, with `cameras` as its last nodes."""
        for camera in cameras:
            self._camera(camera)
        self._data += b"\0" * (-len(self._data) % 4)
        text = json.dumps(self.json | {"buffers": [{"byteLength": len(self._data)}]}, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(self._data), b"BIN\0") + self._data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
