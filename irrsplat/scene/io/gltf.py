"""Reads from a glTF file's JSON what trimesh rounds or drops: exact colours, emission, and which meshes have normals."""

from __future__ import annotations

import copy
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from irrsplat.core.color import mean_color
from irrsplat.core.errors import InputError
from irrsplat.scene.io.lines import read_bytes

_UNREAD = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression", "KHR_mesh_quantization")
_JSON = 0x4E4F534A
_Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Document:
    """A glTF file: its JSON, and the bytes of a GLB's other chunks (None for a .gltf)."""

    tree: dict[str, Any]
    rest: bytes | None

    def labelled(self) -> bytes:
        """The same file, but each primitive with a material of its own that is named ``mesh/primitive``, by index."""
        tree = copy.deepcopy(self.tree)
        materials = tree.get("materials", [])
        named: list[dict[str, Any]] = []
        for i, mesh in enumerate(tree["meshes"]):
            for j, primitive in enumerate(mesh["primitives"]):
                material = materials[primitive["material"]] if "material" in primitive else {}
                primitive["material"] = len(named)
                named.append({**material, "name": f"{i}/{j}"})
        tree["materials"] = named
        text = json.dumps(tree).encode()
        if self.rest is None:
            return text
        text += b" " * (-len(text) % 4)
        body = struct.pack("<II", len(text), _JSON) + text + self.rest
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    def primitive(self, label: str) -> tuple[dict[str, Any], dict[str, Any] | None]:
        """The primitive that `labelled` named so, and its material (None where it has none)."""
        i, j = map(int, label.split("/"))
        primitive = self.tree["meshes"][i]["primitives"][j]
        return primitive, self.tree["materials"][primitive["material"]] if "material" in primitive else None


def read(path: Path) -> Document:
    """The glTF file at `path`; raises InputError where it is truncated, no glTF 2.0, or needs what is not read here."""
    data = read_bytes(path)
    try:
        document = _glb(path, data) if path.suffix.lower() == ".glb" else Document(json.loads(data.decode("utf-8-sig")), None)
        tree = document.tree
        if not str(tree["asset"]["version"]).startswith("2"):
            raise InputError(f"this is glTF {tree['asset']['version']}; expected version 2.0", path)
        for extension in (*tree.get("extensionsUsed", ()), *tree.get("extensionsRequired", ())):
            if extension in _UNREAD:
                raise InputError(f"its geometry is packed with {extension}, which is not read; export it without", path)
        if any("sparse" in accessor or "bufferView" not in accessor for accessor in tree.get("accessors", ())):
            raise InputError("it has sparse accessors, which are not read; export it without", path)
        for i, mesh in enumerate(tree.get("meshes", ())):
            for j in range(len(mesh["primitives"])):
                document.primitive(f"{i}/{j}")
        for node in tree.get("nodes", ()):
            if not 0 <= node.get("mesh", 0) < max(1, len(tree.get("meshes", ()))):
                raise IndexError
        return document
    except (ValueError, KeyError, TypeError, AttributeError, IndexError, struct.error, RecursionError):
        raise InputError("this is no glTF 2.0 file, or a damaged one; export it again", path) from None


def _glb(path: Path, data: bytes) -> Document:
    magic, _, length = struct.unpack_from("<4sII", data)
    if magic != b"glTF":
        raise InputError("this is no GLB file (it does not begin with 'glTF'); export it again", path)
    if length > len(data):
        raise InputError(f"the file is truncated: {len(data)} of {length} bytes are there", path)
    size, kind = struct.unpack_from("<II", data, 12)
    if kind != _JSON or 20 + size > length:
        raise ValueError("no JSON chunk")
    return Document(json.loads(data[20 : 20 + size]), data[20 + size : length])


def colors(material: dict[str, Any] | None, loaded: Any) -> tuple[np.ndarray, _Vector]:
    """(3,) linear albedo, not clipped, and emitted radiance of a glTF material; no material at all: 0.5 and none.

    loaded: trimesh's PBRMaterial for it, which holds the textures.
    """
    if material is None:
        return np.full(3, 0.5), (0.0, 0.0, 0.0)
    extensions = material.get("extensions", {})
    gloss = extensions.get("KHR_materials_pbrSpecularGlossiness", {})
    factor = material.get("pbrMetallicRoughness", {}).get("baseColorFactor", gloss.get("diffuseFactor", (1.0, 1.0, 1.0)))
    albedo = np.asarray(factor, float)[:3]
    if loaded.baseColorTexture is not None:
        albedo = albedo * mean_color(loaded.baseColorTexture)
    emission = np.asarray(material.get("emissiveFactor", (0.0, 0.0, 0.0)), float)
    emission = emission * float(extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0))
    if loaded.emissiveTexture is not None:
        emission = emission * mean_color(loaded.emissiveTexture)
    r, g, b = np.maximum(np.nan_to_num(emission), 0.0).tolist()
    return albedo, (r, g, b)
