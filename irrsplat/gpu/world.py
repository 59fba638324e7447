"""What gathers look at: a scene as rasters draw it, and as rays go through it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import ExitStack
from functools import partial
from typing import Any, TypeVar

import moderngl

from irrsplat.core.buffers import Uniforms
from irrsplat.core.errors import InputError
from irrsplat.core.timing.beside import done, started
from irrsplat.core.timing.clock import wait_for
from irrsplat.core.vertex_layout import vertex_column
from irrsplat.gpu.bvh_table import BvhTable, TriangleTable
from irrsplat.gpu.geometry import Geometry
from irrsplat.gpu.material_table import MaterialTable
from irrsplat.gpu.resource import Owner, Resource, Workshop
from irrsplat.scene.bvh import Bvh, build
from irrsplat.scene.change import SceneChange
from irrsplat.scene.flatten import flatten
from irrsplat.scene.looks import numbered_alike, runs
from irrsplat.scene.model import Mesh, Scene
from irrsplat.scene.ray_caster import RayCaster
from irrsplat.scene.seen_by_light import face_counts

Made = TypeVar("Made")

_LARGE = 100_000  # triangles


class World(Owner):
    """A scene on the GPU, for all who draw it and all gathers that look at it; they follow it when it changes.

    texture_memory: MiB for its images, of which what light sees of them takes a share.
    """

    def __init__(self, ctx: moderngl.Context, scene: Scene, texture_memory: int = 1024) -> None:
        self.ctx = ctx
        vertices, faces, _ = flatten(scene)
        counts = face_counts(scene)
        with ExitStack() as made:  # where the second fails, the first is freed
            self.geometry = made.enter_context(Geometry(ctx, vertices, faces, counts))
            self.materials = MaterialTable(ctx, scene, texture_memory)
            made.pop_all()
        self.runs = runs(scene)  # of triangles that a camera draws alike
        self.derived = Workshop()  # what others make of the scene as it is; it is freed with this
        self._scene = scene
        self._uploaded: tuple[Mesh, ...] | None = scene.meshes  # None while what is on the GPU is neither before nor after a move
        self._triangles: TriangleTable | None = None
        self._tree: BvhTable | None = None
        self._planted: Future[Bvh] | None = None
        self._fits: bool | None = None  # on the GPU, what rays go through; None: not tried yet
        self._caster: Future[RayCaster] | None = None

    def owned(self) -> tuple[Resource | None, ...]:
        """What this frees."""
        return (self.geometry, self.materials, self._triangles, self._tree, self.derived)

    @property
    def raster_uniforms(self) -> Uniforms:
        """What shaders need that draw the triangles: their planes and materials."""
        return self.geometry.uniforms | self.materials.uniforms

    @property
    def gather_uniforms(self) -> Uniforms:
        """What shaders need that draw the triangles as light meets them: their planes, materials and textures, and how many of
        them belong to closed meshes."""
        return self.geometry.uniforms | self.materials.light_uniforms | {"closed": self.geometry.counts.closed}

    @property
    def hit_uniforms(self) -> Uniforms:
        """What shaders need that look at what rays hit."""
        return self.triangles.uniforms | self.materials.light_uniforms

    @property
    def trace_uniforms(self) -> Uniforms:
        """The same, and what they need to send rays through the tree."""
        return self.hit_uniforms | self.tree.uniforms

    def seen_uniforms(self, embree: bool) -> Uniforms:
        """What shaders need that look at what rays hit, which Embree has traced, or they do; they go on through what is cut out,
        which only they know."""
        return self.hit_uniforms if embree and not self.materials.defines["CUT_OUTS"] else self.trace_uniforms

    @property
    def ray_uniforms(self) -> Uniforms:
        """What shaders need that send rays through the tree, to find out whether they hit anything."""
        if self.materials.defines["CUT_OUTS"]:
            return self.trace_uniforms
        return self.triangles.corner_uniforms | self.tree.uniforms

    @property
    def material_defines(self) -> dict[str, int]:
        """What shaders are compiled for that use these three."""
        return self.materials.defines

    @property
    def scene(self) -> Scene:
        """The scene as it is now."""
        return self._scene

    def shows(self, scene: Scene) -> bool:
        """Whether all on the GPU is of this scene."""
        return self._scene is scene and self._uploaded is scene.meshes

    @property
    def triangles(self) -> TriangleTable:
        """The triangles as shaders look at them, made when first wanted. Raises InputError for more of them than the GPU can
        hold."""
        if self._triangles is None:
            self._triangles = TriangleTable(self.ctx, *flatten(self._scene)[:2], self.geometry.counts)
        return self._triangles

    @property
    def tree(self) -> BvhTable:
        """The tree by which rays find them, made when first wanted and again when they have moved. Raises InputError for one that
        is larger than the GPU can hold."""
        if self._tree is None:
            self._tree, self._planted = BvhTable(self.ctx, self._planting().result()), None
        return self._tree

    def casts_rays(self, seconds: float | None = None) -> bool:
        """Return whether shaders can send rays through the scene: the GPU can hold its tree, and that is built within so many
        seconds. None: wait for it."""
        if seconds is not None and self.large and not self.wait(seconds, tree=True):
            return False
        if self._fits is None:
            try:
                self._fits = bool(self.trace_uniforms)
            except InputError:
                self._fits = False
        return self._fits

    def _planting(self) -> Future[Bvh]:
        """The building of `tree`, in a thread where it takes long."""
        if self._planted is None:
            self._planted = self._beside(partial(build, self.geometry.corners[: self.geometry.counts.lit]))
        return self._planted

    @property
    def caster(self) -> RayCaster:
        """The triangles that light sees by the scene's numbers, as Embree has them, made when first wanted and again when they
        have moved."""
        return self._casting().result()

    def _casting(self) -> Future[RayCaster]:
        """The making of `caster`, in a thread where it takes long."""
        if self._caster is None:
            vertices, faces, _ = flatten(self._scene)
            self._caster = self._beside(
                partial(RayCaster, vertex_column(vertices, "position"), faces[: self.geometry.counts.lit])
            )
        return self._caster

    def _forget_rays(self) -> None:
        """The triangles have moved: what is made of them is made anew when it is wanted, and what has not begun never is."""
        tree, self._tree = self._tree, None
        if tree is not None:
            tree.release()
        for begun in (self._planted, self._caster):
            if begun is not None:
                begun.cancel()
        self._planted = self._caster = None

    def _beside(self, make: Callable[[], Made]) -> Future[Made]:
        """The making of something for all triangles, in a thread where these are many."""
        return started(make) if self.large else done(make)

    @property
    def large(self) -> bool:
        """Whether it has so many triangles that what is made of all of them takes seconds."""
        return self.geometry.triangles >= _LARGE

    def expect(self, tree: bool = False, caster: bool = False) -> None:
        """Begin what `tree` needs, and the `caster`, beside all else where they take long, since they will be wanted."""
        if self.large:
            self._begun(tree, caster)

    def _begun(self, tree: bool, caster: bool) -> list[Future[Any]]:
        """What `tree` needs, and the `caster`, in the making."""
        begun: list[Future[Any]] = [self._casting()] if caster else []
        return begun + ([self._planting()] if tree and self._tree is None else [])

    def wait(self, seconds: float, tree: bool = False, caster: bool = False) -> bool:
        """Wait so long, at most, for what `tree` needs, and for the `caster`; whether that is there. Whoever asks again and again
        without waiting takes the interpreter from those who make it."""
        return wait_for(self._begun(tree, caster), seconds)

    def follow(self, change: SceneChange) -> None:
        """Go on with the same meshes, lit otherwise, elsewhere or repainted; where they have moved, the triangles are uploaded
        again, and what rays go through is made anew once it is wanted. change: between the present scene and another. Raises
        InputError, and stays as it was, for materials by which triangles would be numbered otherwise, or that wear other
        textures."""
        scene = change.new
        if self._uploaded is not scene.meshes:
            if change.repainted and not numbered_alike(self._scene, scene):
                raise InputError(
                    "a mesh cannot get a material by which light passes it otherwise, or by which it is drawn otherwise; load "
                    "the scene anew with it"
                )
            before, self._uploaded = self._uploaded, None
            vertices, faces, _ = flatten(scene)
            moved = bool(change.moved) or before is None
            try:
                if change.repainted or before is None:
                    self.materials.update(scene)
                if moved and self._triangles is not None:
                    self._triangles.update(vertices, faces)
            except Exception:  # it is as it was; only an interruption may come after that
                self._uploaded = None if change.repainted else before
                raise
            if moved:
                self.geometry.update(vertices, faces)
                self._forget_rays()
            else:
                self.geometry.repaint(vertices)
                if self._triangles is not None:
                    self._triangles.repaint(vertices)
            found = runs(scene)
            if found != self.runs:
                self.runs = found
            self._uploaded = scene.meshes
        self._scene = scene
