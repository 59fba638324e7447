"""What gathers look at: a scene as rasters draw it, and as rays go through it."""

from __future__ import annotations

import moderngl

from irrsplat.gpu.bvh_table import BvhTable
from irrsplat.gpu.geometry import Geometry
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.scene.flatten import flatten
from irrsplat.scene.model import Scene


class World(Owner):
    """A scene on the GPU, for all gathers that look at it; they follow it when it changes.

    geometry: of the same scene; it stays its owner's, who updates it when meshes move.
    """

    def __init__(self, ctx: moderngl.Context, scene: Scene, geometry: Geometry) -> None:
        self.ctx, self.geometry = ctx, geometry
        self._scene = scene
        self._tree: BvhTable | None = None

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees: the tree, not the geometry."""
        return (self._tree,)

    @property
    def scene(self) -> Scene:
        """The scene as it is now."""
        return self._scene

    @property
    def tree(self) -> BvhTable:
        """The triangles as rays find them, made when first wanted. Raises InputError for more of them than the GPU can hold."""
        if self._tree is None:
            self._tree = BvhTable(self.ctx, *flatten(self._scene)[:2])
        return self._tree

    def set_scene(self, scene: Scene) -> None:
        """Go on with the same meshes, lit otherwise or elsewhere; the tree is built anew where they have moved."""
        if self._tree is not None and self._scene.meshes is not scene.meshes:
            self._tree.update(*flatten(scene)[:2])
        self._scene = scene
