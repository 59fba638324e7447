"""Scene stamp of a cache file: hashes of meshes, materials and sky, to find later changes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from irrsplat.scene.appearance import order
from irrsplat.scene.model import Image, Material, Scene, Texture


@dataclass(frozen=True)
class MeshStamp:
    """A mesh: hashes of its geometry (with texture coordinates and colours) and of its material, and its number of triangles."""

    geometry: str
    material: str
    triangles: int


@dataclass(frozen=True)
class SceneStamp:
    """The scene of a cache file. around: a hash of its sky. order: the meshes in the order of their triangles' numbers."""

    name: str
    around: str
    meshes: tuple[MeshStamp, ...]
    order: tuple[int, ...]

    @classmethod
    def read(cls, values: Mapping[str, Any]) -> SceneStamp:
        """Build a stamp from its members by name; raises KeyError, TypeError or ValueError for other content."""
        meshes = tuple(MeshStamp(**mesh) for mesh in values["meshes"])
        order = tuple(map(int, values["order"]))
        if sorted(order) != list(range(len(meshes))) or min([0, *(mesh.triangles for mesh in meshes)]) < 0:
            raise ValueError("meshes")
        return cls(str(values["name"]), str(values["around"]), meshes, order)

    @property
    def first_triangles(self) -> np.ndarray:
        """(M,) the number of the first triangle of each mesh."""
        counts, first = [mesh.triangles for mesh in self.meshes], np.zeros(len(self.meshes), np.intp)
        first[list(self.order)] = np.cumsum([0, *(counts[i] for i in self.order)])[:-1]
        return first

    @property
    def geometry(self) -> str:
        """Hash of all that records depend on in the scene except lights; names do not count."""
        return hashed(repr((self.around, self.order, self.meshes)).encode())


def stamp(scene: Scene) -> SceneStamp:
    """Return the stamp of a scene for a cache file."""
    materials = {material: hashed(*_material(material)) for material in scene.materials}
    meshes = tuple(
        MeshStamp(
            hashed(mesh.positions, mesh.normals, mesh.faces, mesh.uvs, mesh.colors, mesh.opacities, np.array(mesh.closed)),
            materials[mesh.material],
            len(mesh.faces),
        )
        for mesh in scene.meshes
    )
    return SceneStamp(scene.name, hashed(_sky(scene)), meshes, tuple(order(scene)))


def _sky(scene: Scene) -> bytes:
    """Return the hash input of the sky; the up vector counts only for a sky with a gradient."""
    if scene.environment is not None:
        return scene.environment.digest
    return repr((tuple(scene.sky), (scene.sky_gradient, scene.up) if any(scene.sky_gradient) else ())).encode()


def _material(material: Material) -> Iterator[bytes]:
    """Yield the hash input of a material: all values, and images as bytes.

    Normal maps do not count: they change shading normals, not records.
    """
    yield repr(replace(material, albedo_texture=None, emission_texture=None, normal_texture=None, normal_scale=1.0)).encode()
    yield from texture_parts(material.albedo_texture)
    yield from texture_parts(material.emission_texture)


def texture_parts(texture: Texture | None) -> Iterator[bytes]:
    """Yield the hash input of a texture: one empty part for none. Each image is read once."""
    if texture is None:
        yield b""
    else:
        yield repr((texture.uv_set, texture.transform, texture.wrap, texture.nearest, texture.image.pixels.shape)).encode()
        yield _image_digest(texture.image)


_digests: WeakKeyDictionary[Image, bytes] = WeakKeyDictionary()  # images are immutable and may be large


def _image_digest(image: Image) -> bytes:
    if image not in _digests:
        _digests[image] = hashlib.sha256(image.pixels.tobytes()).digest()
    return _digests[image]


def present_triangles(then: SceneStamp, now: SceneStamp) -> np.ndarray:
    """Return (T,) the present number of each former triangle; -1: its mesh has moved, has another shape, or is gone."""
    starts: dict[tuple[str, int], list[int]] = {}
    for mesh, first in zip(now.meshes, now.first_triangles, strict=True):
        starts.setdefault((mesh.geometry, mesh.triangles), []).append(int(first))
    found = np.full(sum(mesh.triangles for mesh in then.meshes), -1)
    for mesh, first in zip(then.meshes, then.first_triangles, strict=True):
        if same := starts.get((mesh.geometry, mesh.triangles)):
            found[first : first + mesh.triangles] = same.pop(0) + np.arange(mesh.triangles)
    return found


def hashed(*parts: np.ndarray | bytes | None) -> str:
    """Return the SHA-256 of the parts and their lengths, as hexadecimal digits."""
    whole = hashlib.sha256()
    for part in parts:
        data = b"" if part is None else part if isinstance(part, bytes) else part.tobytes()
        whole.update(len(data).to_bytes(8, "little") + data)
    return whole.hexdigest()
