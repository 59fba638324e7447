"""The changes of a scene as a value: its lights, and the places, materials and visibility of its objects."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from irrsplat.app.viewer.editing.light_edit import LightEdit
from irrsplat.app.viewer.view_options import Point
from irrsplat.core.vectors import box
from irrsplat.scene.model import Mesh, Scene
from irrsplat.scene.motion import hidden, transformed

_UNTURNED = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class ObjectEdit:
    """The changes of a mesh.

    offset: its translation in metres. turn: the rows of its rotation about the middle of its bounding box.
    albedo, emission: the values that replace those of its material; None keeps its own value.
    """

    offset: Point = (0.0, 0.0, 0.0)
    turn: tuple[Point, Point, Point] = _UNTURNED
    albedo: Point | None = None
    emission: Point | None = None
    hidden: bool = False

    def matrix(self, pivot: np.ndarray) -> np.ndarray:
        """Return (4, 4) from the loaded place of the mesh to its present one. pivot: (3,) the middle of its loaded box."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.turn
        matrix[:3, 3] = pivot + self.offset - matrix[:3, :3] @ pivot
        return matrix

    @property
    def stays(self) -> bool:
        """True if the mesh is at its loaded place."""
        return not any(self.offset) and self.turn == _UNTURNED


AS_LOADED = ObjectEdit()


@dataclass(frozen=True)
class SceneEdit:
    """The lights of a scene, and the changes of each of its meshes."""

    lights: tuple[LightEdit, ...]
    objects: tuple[ObjectEdit, ...]

    @classmethod
    def of(cls, scene: Scene) -> SceneEdit:
        return cls(tuple(map(LightEdit.of, scene.lights)), (AS_LOADED,) * len(scene.meshes))

    def with_light(self, number: int, edited: LightEdit) -> SceneEdit:
        return replace(self, lights=(*self.lights[:number], edited, *self.lights[number + 1 :]))

    def with_object(self, number: int, edit: ObjectEdit) -> SceneEdit:
        return replace(self, objects=(*self.objects[:number], edit, *self.objects[number + 1 :]))


def bounds_of(mesh: Mesh) -> np.ndarray:
    """Return (2, 3) float64 the ends of a mesh's bounding box; 0 0 0 for a mesh without points."""
    return box(mesh.positions).astype(float) if len(mesh.positions) else np.zeros((2, 3))


class EditedScene:
    """The scenes of edits. An unchanged mesh stays one object, since renderers compare meshes by identity."""

    def __init__(self, loaded: Scene) -> None:
        self.loaded = loaded
        self._made: dict[int, tuple[ObjectEdit, Mesh]] = {}
        self._meshes = loaded.meshes  # the meshes of the last scene

    def scene(self, edit: SceneEdit) -> Scene:
        """Return the scene after an edit. Raises InputError if a mesh would leave the range of 32-bit floats."""
        meshes = tuple(self._mesh(i, one) for i, one in enumerate(edit.objects))
        if all(a is b for a, b in zip(meshes, self._meshes, strict=True)):
            meshes = self._meshes
        if all(a is b for a, b in zip(meshes, self.loaded.meshes, strict=True)):
            meshes = self.loaded.meshes
        self._meshes = meshes
        return replace(self.loaded, lights=tuple(edited.emitted for edited in edit.lights), meshes=meshes)

    def _mesh(self, number: int, edit: ObjectEdit) -> Mesh:
        """Return the mesh of this number, moved, painted or hidden."""
        loaded = self.loaded.meshes[number]
        if edit == AS_LOADED:
            return loaded
        before, mesh = self._made.get(number, (AS_LOADED, loaded))
        if before == edit:
            return mesh
        if (before.offset, before.turn, before.hidden) != (edit.offset, edit.turn, edit.hidden):
            mesh = loaded if edit.stays else transformed(loaded, edit.matrix(bounds_of(loaded).mean(0)))
        material = loaded.material
        if edit.albedo is not None:
            material = replace(material, albedo=edit.albedo)
        if edit.emission is not None:
            material = replace(material, emission=edit.emission)
        if mesh.material != material:
            mesh = replace(mesh, material=material)
        if edit.hidden:  # at the middle of the scene, so that the scene's bounds do not grow
            mesh = hidden(mesh, self.loaded.bounds.mean(0))
        self._made[number] = edit, mesh
        return mesh


def object_name(scene: Scene, number: int) -> str:
    return scene.meshes[number].name or f"mesh {number + 1}"
