"""Scene stamp of a cache file: hashes of the geometry, materials and sky, and the places of meshes, to find later changes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, astuple, dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from irrsplat.scene.looks import order
from irrsplat.scene.model import Image, Material, Scene
from irrsplat.scene.motion import hidden

_MOST_VERTICES = 1_000_000  # 24 MB in a file; moved meshes of a larger scene count as replaced


@dataclass(frozen=True)
class MeshStamp:
    """A mesh: its name, hashes of its shape (faces, texture coordinates, colours), its place and its material, and its numbers of
    vertices and triangles."""

    name: str
    shape: str
    place: str
    material: str
    vertices: int
    triangles: int


@dataclass(frozen=True)
class SceneStamp:
    """The scene of a cache file.

    around: a hash of its sky. origin: as in Scene. order: the meshes in the order of their triangles' numbers.
    positions, normals: (V, 3) float32 of all vertices, mesh by mesh; (0, 3) for a scene of too many vertices.
    """

    name: str
    around: str
    origin: tuple[float, ...]
    meshes: tuple[MeshStamp, ...]
    order: tuple[int, ...]
    positions: np.ndarray
    normals: np.ndarray

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays for the file."""
        return {"mesh_positions": self.positions, "mesh_normals": self.normals}

    def as_json(self) -> dict[str, object]:
        """Return all members except the arrays."""
        plain: dict[str, object] = {"name": self.name, "around": self.around, "origin": self.origin, "order": self.order}
        return plain | {"meshes": [asdict(mesh) for mesh in self.meshes]}

    @classmethod
    def read(cls, values: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> SceneStamp:
        """Build a stamp from `as_json` and `arrays`; raises KeyError, TypeError or ValueError for other content."""
        meshes = tuple(MeshStamp(**mesh) for mesh in values["meshes"])
        stamp = cls(
            str(values["name"]),
            str(values["around"]),
            tuple(map(float, values["origin"])),
            meshes,
            tuple(map(int, values["order"])),
            arrays["mesh_positions"],
            arrays["mesh_normals"],
        )
        vertices = sum(mesh.vertices for mesh in meshes)
        for array in stamp.arrays.values():
            if array.shape not in ((vertices, 3), (0, 3)) or array.dtype != np.float32 or not np.isfinite(array).all():
                raise ValueError("vertices")
        if sorted(stamp.order) != list(range(len(meshes))) or min([0, *(mesh.triangles for mesh in meshes)]) < 0:
            raise ValueError("meshes")
        return stamp

    @property
    def first_triangles(self) -> np.ndarray:
        """(M,) the number of the first triangle of each mesh."""
        counts, first = [mesh.triangles for mesh in self.meshes], np.zeros(len(self.meshes), np.intp)
        first[list(self.order)] = np.cumsum([0, *(counts[i] for i in self.order)])[:-1]
        return first

    @property
    def geometry(self) -> str:
        """Hash of all that records depend on in the scene except lights; names do not count."""
        return hashed(repr((self.around, self.order, [astuple(replace(mesh, name="")) for mesh in self.meshes])).encode())


def stamp(scene: Scene) -> SceneStamp:
    """Return the stamp of a scene for a cache file."""
    materials = {material: hashed(*_material(material)) for material in scene.materials}
    meshes = tuple(
        MeshStamp(
            mesh.name,
            hashed(mesh.faces, mesh.uvs, mesh.colors, mesh.opacities, np.array(mesh.closed)),
            hashed(mesh.positions, mesh.normals),
            materials[mesh.material],
            len(mesh.positions),
            len(mesh.faces),
        )
        for mesh in scene.meshes
    )
    held = scene.meshes if sum(mesh.vertices for mesh in meshes) <= _MOST_VERTICES else ()
    positions, normals = (
        np.concatenate([np.zeros((0, 3), np.float32), *(getattr(mesh, name) for mesh in held)])
        for name in ("positions", "normals")
    )
    return SceneStamp(scene.name, hashed(_sky(scene)), tuple(scene.origin), meshes, tuple(order(scene)), positions, normals)


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
    for texture in (material.albedo_texture, material.emission_texture):
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


@dataclass(frozen=True)
class Earlier:
    """The scene at the time of the records, as far as a file holds it.

    scene: the present scene with the former places of its meshes; meshes new since then are hidden. triangle: the present number
    of each former triangle; -1: the triangle is gone. complete: True if only places of meshes may have changed since.
    """

    scene: Scene
    triangle: np.ndarray
    complete: bool


def earlier(stamp: SceneStamp, scene: Scene, present: SceneStamp) -> Earlier:
    """Return the present `scene`, with the stamp `present`, in its state at the time of a file with this `stamp`."""
    meshes, twins = list(scene.meshes), _twins(stamp, present)
    starts = np.cumsum([0, *(mesh.vertices for mesh in stamp.meshes)])
    for number, mesh in enumerate(scene.meshes):
        if number not in twins:
            meshes[number] = hidden(mesh, mesh.positions[0]) if len(mesh.positions) else mesh
        elif stamp.meshes[twins[number]].place != present.meshes[number].place:
            rows = slice(starts[twins[number]], starts[twins[number] + 1])
            meshes[number] = replace(mesh, positions=stamp.positions[rows], normals=stamp.normals[rows])
    triangle = np.full(sum(mesh.triangles for mesh in stamp.meshes), -1)
    was, now = stamp.first_triangles, present.first_triangles
    for new, old in twins.items():
        own = np.arange(stamp.meshes[old].triangles)
        triangle[was[old] + own] = now[new] + own
    alike = all(stamp.meshes[old].material == present.meshes[new].material for new, old in twins.items())
    complete = alike and len(twins) == len(stamp.meshes) == len(present.meshes) and stamp.around == present.around
    return Earlier(replace(scene, meshes=tuple(meshes)), triangle, complete)


def _twins(stamp: SceneStamp, present: SceneStamp) -> dict[int, int]:
    """Return the former index of each present mesh that existed before.

    Matches of shape, name and place come first, then of shape and place, then of shape and name, then of shape alone.
    """
    twins: dict[int, int] = {}
    if stamp.origin != present.origin:
        return twins
    known = len(stamp.positions) > 0
    for names in (("shape", "name", "place"), ("shape", "place"), ("shape", "name"), ("shape",)):
        free: dict[tuple[object, ...], list[int]] = {}
        for number in sorted(set(range(len(stamp.meshes))) - set(twins.values()), reverse=True):
            free.setdefault(tuple(getattr(stamp.meshes[number], name) for name in names), []).append(number)
        for number, mesh in enumerate(present.meshes):
            same = free.get(tuple(getattr(mesh, name) for name in names))
            if number not in twins and same and (known or "place" in names):
                twins[number] = same.pop()
    return twins


def hashed(*parts: np.ndarray | bytes | None) -> str:
    """Return the SHA-256 of the parts and their lengths, as hexadecimal digits."""
    whole = hashlib.sha256()
    for part in parts:
        data = b"" if part is None else part if isinstance(part, bytes) else part.tobytes()
        whole.update(len(data).to_bytes(8, "little") + data)
    return whole.hexdigest()
