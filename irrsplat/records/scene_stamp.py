"""What a cache file knows of the scene that its records are of: enough to find out later what has changed since."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from irrsplat.scene.looks import order
from irrsplat.scene.model import Scene
from irrsplat.scene.motion import hidden

_MOST_VERTICES = 1_000_000  # of a scene whose vertices a file holds: 24 MB; of a larger one a mesh that moves counts as another


@dataclass(frozen=True)
class MeshStamp:
    """A mesh: its name, hashes of what moves with it (faces, texture coordinates, colours), of where it is, and of its material;
    and how many vertices and triangles it has."""

    name: str
    shape: str
    place: str
    material: str
    vertices: int
    triangles: int


@dataclass(frozen=True)
class SceneStamp:
    """The scene of a cache file.

    around: a hash of its sky. origin: as Scene has it. order: the meshes as their triangles are numbered.
    positions, normals: (V, 3) float32 of all vertices, mesh by mesh; (0, 3) where they are too many for a file.
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
        """What a file holds as arrays."""
        return {"mesh_positions": self.positions, "mesh_normals": self.normals}

    def as_json(self) -> dict[str, object]:
        """All the rest."""
        plain: dict[str, object] = {"name": self.name, "around": self.around, "origin": self.origin, "order": self.order}
        return plain | {"meshes": [asdict(mesh) for mesh in self.meshes]}

    @classmethod
    def read(cls, values: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> SceneStamp:
        """Raises KeyError, TypeError or ValueError where these are not what `as_json` and `arrays` gave."""
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
        return _first([mesh.triangles for mesh in self.meshes], self.order)


def stamp_of(scene: Scene, around: str, materials: Sequence[str]) -> SceneStamp:
    """What a file is to know of a scene. around: a hash of its sky; materials: one of each mesh's."""
    meshes = tuple(
        MeshStamp(
            mesh.name,
            _hash(mesh.faces, mesh.uvs, mesh.colors, mesh.opacities, np.array(mesh.closed)),
            _hash(mesh.positions, mesh.normals),
            material,
            len(mesh.positions),
            len(mesh.faces),
        )
        for mesh, material in zip(scene.meshes, materials, strict=True)
    )
    held = scene.meshes if sum(mesh.vertices for mesh in meshes) <= _MOST_VERTICES else ()
    positions, normals = (
        np.concatenate([np.zeros((0, 3), np.float32), *(getattr(mesh, name) for mesh in held)])
        for name in ("positions", "normals")
    )
    return SceneStamp(scene.name, around, tuple(scene.origin), meshes, tuple(order(scene)), positions, normals)


@dataclass(frozen=True)
class Earlier:
    """The scene as it was when records were made, as far as a file can tell.

    scene: the present one with its meshes where they were, those that were not there hidden. triangle: the number in it of
    each triangle that records may lie on, by its number then; -1: it is gone. complete: whether nothing but places of meshes may
    have changed since.
    """

    scene: Scene
    triangle: np.ndarray
    complete: bool


def earlier(stamp: SceneStamp, scene: Scene, present: SceneStamp) -> Earlier:
    """The present `scene`, whose stamp is `present`, as it was when a file of this `stamp` was made."""
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
    """For each present mesh that was there before, the index that it had: those of one shape, name and place first, then those of
    one shape and name, then of one shape alone."""
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


def _first(counts: Sequence[int], order: Sequence[int]) -> np.ndarray:
    """(M,) where each mesh's triangles begin, of `counts` by mesh, numbered in this order."""
    first = np.zeros(len(counts), np.intp)
    first[list(order)] = np.cumsum([0, *(counts[i] for i in order)])[:-1]
    return first


def _hash(*parts: np.ndarray | None) -> str:
    whole = hashlib.sha256()
    for part in parts:
        data = b"" if part is None else part.tobytes()
        whole.update(len(data).to_bytes(8, "little") + data)
    return whole.hexdigest()[:32]
