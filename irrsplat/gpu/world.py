"""A scene on the GPU: rasterised geometry, materials, and ray acceleration structures."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, TypeVar

import moderngl
import numpy as np

from irrsplat.core.buffers import Uniforms
from irrsplat.core.errors import InputError
from irrsplat.core.timing.background import run_now, start_thread
from irrsplat.core.timing.clock import wait_for
from irrsplat.core.vertex_layout import vertex_column
from irrsplat.gpu.bvh_table import BvhTable, TriangleTable
from irrsplat.gpu.geometry import Geometry
from irrsplat.gpu.material_table import MaterialTable
from irrsplat.gpu.resource import Owner, Workshop
from irrsplat.scene.appearance import flatten, numbered_alike, order, runs
from irrsplat.scene.change import SceneChange
from irrsplat.scene.emitters import unlit_interiors
from irrsplat.scene.model import Mesh, Scene
from irrsplat.scene.ray_caster import RayCaster
from irrsplat.scene.seen_by_light import CUT_OUT, Holes, face_counts, sort_of
from irrsplat.scene.spatial.bvh import Bvh, build, joined
from irrsplat.scene.spatial.visible_parts import SceneParts

Made = TypeVar("Made")

_LARGE = 20_000  # triangles of a scene whose ray structures are made in a thread
_MOST_MOVED = 100_000  # triangles whose ray structures are made at once, in a tenth of a second each


class World(Owner):
    """A scene on the GPU, shared by all passes that draw it or trace rays in it, and updated when the scene changes.

    eyes: (N, 3) metres, of the present view, whose surroundings have the finest cells of the surface cache; the scene's
    cameras before any view.
    """

    def __init__(self, ctx: moderngl.Context, scene: Scene) -> None:
        self.ctx = ctx
        vertices, faces = flatten(scene)
        counts = face_counts(scene)
        with ExitStack() as made:
            made.push(self)  # frees the geometry if the materials fail
            self.geometry = self.own(Geometry(ctx, vertices, faces, counts))
            self.materials = self.own(MaterialTable(ctx, scene))
            made.pop_all()
        self.runs = runs(scene)  # of triangles that a camera draws with equal state
        self.unlit_interiors = unlit_interiors(scene)
        self._made = self.own(Workshop())  # the tables of triangles and of the tree
        self.derived = self.own(Workshop())  # resources that other modules derive from the scene, freed with it
        self.scene = scene
        self._uploaded: tuple[Mesh, ...] | None = scene.meshes  # None: the GPU holds an incomplete update
        self._parts: SceneParts | None = None
        self._pending_tree: Future[Bvh] | None = None
        self._pending_caster: Future[RayCaster] | None = None
        # triangles with ray structures of their own, of the meshes that moved last in a large scene; and the box for the grid
        self._apart, self._room = np.zeros(0, np.intp), np.zeros((2, 3))
        self._placed: tuple[np.ndarray, RayCaster] | None = None  # the caster by the corners of all triangles
        self.eyes = np.array([camera.eye for camera in scene.cameras], float).reshape(-1, 3)

    @property
    def raster_uniforms(self) -> Uniforms:
        """Uniforms for drawing the triangles: planes and materials."""
        return self.geometry.uniforms | self.materials.uniforms

    @property
    def gather_uniforms(self) -> Uniforms:
        """Uniforms for hemisphere rasters: planes, materials, textures, and the number of triangles of closed meshes."""
        return self.geometry.uniforms | self.materials.light_uniforms | {"closed": self.geometry.counts.closed}

    @property
    def hit_uniforms(self) -> Uniforms:
        """Uniforms for shading ray hits."""
        return self.triangles.uniforms | self.materials.light_uniforms

    @property
    def trace_uniforms(self) -> Uniforms:
        """Uniforms for shading ray hits and for traversing the BVH."""
        return self.hit_uniforms | self.tree.uniforms

    def seen_uniforms(self, embree: bool) -> Uniforms:
        """Return the uniforms for shading hits of rays traced by Embree, or in shaders."""
        return self.hit_uniforms if embree else self.trace_uniforms

    @property
    def ray_uniforms(self) -> Uniforms:
        """Uniforms for visibility rays through the BVH."""
        if self.materials.defines["CUT_OUTS"]:
            return self.trace_uniforms
        return self.triangles.corner_uniforms | self.tree.uniforms

    @property
    def material_defines(self) -> dict[str, int]:
        """Defines of shaders that use the uniforms for hits and rays."""
        return self.materials.defines

    def shows(self, scene: Scene) -> bool:
        """True if all GPU data belong to this scene."""
        return self.scene is scene and self._uploaded is scene.meshes

    @property
    def parts(self) -> SceneParts:
        """The scene's parts for culling; the same object until a mesh moves."""
        if self._parts is None:
            self._parts = SceneParts.of(self.scene)
        return self._parts

    @property
    def triangles(self) -> TriangleTable:
        """Triangle table for shaders, made at first use. Raises InputError if the GPU cannot hold it."""
        counts = self.geometry.counts
        return self._made.get("triangles", (), lambda: TriangleTable(self.ctx, *flatten(self.scene), counts))

    @property
    def tree(self) -> BvhTable:
        """BVH, made at first use and again after moves. Raises InputError if the GPU cannot hold it."""
        found = self._made.get("tree", (), lambda: BvhTable(self.ctx, self._whole_tree()))
        if not len(self._apart):
            self._pending_tree = None
        return found

    def _whole_tree(self) -> Bvh:
        """Return the tree of all triangles that light meets."""
        still, apart = self._tree_build().result(), self._apart
        if not len(apart):
            return still
        moving = build(self.geometry.corners[apart], self._room)
        numbers = np.delete(np.arange(self.geometry.counts.lit), apart)
        return joined(replace(still, order=numbers[still.order]), replace(moving, order=apart[moving.order]))

    def casts_rays(self, hurried: bool = False) -> bool:
        """True if shaders can trace rays in the scene: the GPU can hold its BVH. hurried: False while the BVH is built."""
        if hurried and not self.has_tree:
            self.prebuild(tree=True)
            return False
        return self._fits_rays

    @cached_property
    def _fits_rays(self) -> bool:
        """True if the GPU can hold the tables of triangles and of the tree. A failure takes long, so it is tried once."""
        try:
            return bool(self.trace_uniforms)
        except InputError:
            return False

    @property
    def has_tree(self) -> bool:
        """True if `tree` waits for no build in the background."""
        return not self.large or self._tree is not None or (self._pending_tree is not None and self._pending_tree.done())

    @property
    def _tree(self) -> BvhTable | None:
        """The tree, None before it is made."""
        return self._made.find("tree", BvhTable)

    def _tree_build(self) -> Future[Bvh]:
        """Return the build of `tree` without triangles apart, in a thread if it takes long."""
        if self._pending_tree is None:
            corners = self.geometry.corners[: self.geometry.counts.lit]
            still = (np.delete(corners, self._apart, axis=0), self._room) if len(self._apart) else (corners,)
            self._pending_tree = self._in_background(partial(build, *still))
        return self._pending_tree

    @property
    def caster(self) -> RayCaster:
        """Embree's scene of the triangles that light meets, by their numbers; made at first use and again after moves."""
        caster, corners = self._caster_build().result(), self.geometry.corners
        if not len(self._apart):
            return caster
        if self._placed is None or self._placed[0] is not corners:
            self._placed = corners, caster.placed(corners)
        return self._placed[1]

    def _caster_build(self) -> Future[RayCaster]:
        """Return the build of `caster` without triangles apart, in a thread if it takes long."""
        if self._pending_caster is None:
            vertices, faces = flatten(self.scene)
            holes = Holes(self.scene, vertices, faces) if self.geometry.counts.cut_out else None
            self._pending_caster = self._in_background(
                partial(RayCaster, vertex_column(vertices, "position"), faces[: self.geometry.counts.lit], holes, self._apart)
            )
        return self._pending_caster

    def _move_ray_structures(self, moved: tuple[int, ...]) -> None:
        """Discard ray structures after a move of the meshes of these indices, and cancel builds that have not begun.

        In a large scene, the structures of all other triangles stay while the same meshes move again.
        """
        counts, meshes, builds = self.geometry.counts, self.scene.meshes, (self._pending_tree, self._pending_caster)
        corners, apart = self.geometry.corners[: counts.lit], np.zeros(0, np.intp)
        if self.large:
            of_mesh = np.concatenate([np.full(len(meshes[i].faces), i) for i in order(self.scene)])
            apart = np.flatnonzero(np.isin(of_mesh[: counts.lit], moved))
            if moved and not len(apart):  # light passes these meshes
                return
        self._made.drop("tree")
        few = len(apart) <= _MOST_MOVED and not (apart >= counts.solid).any()
        if few and len(apart) and np.array_equal(apart, self._apart):
            points, failed = corners[apart], any(one and one.done() and one.exception() for one in builds)
            if (points >= self._room[0]).all() and (points <= self._room[1]).all() and not failed:
                return
        for pending in builds:
            if pending is not None:
                pending.cancel()
        self._pending_tree = self._pending_caster = self._placed = None
        self._apart = apart if few else apart[:0]
        if len(self._apart):
            low, high = corners.min((0, 1)), corners.max((0, 1))
            self._room = np.stack([low - (high - low), high + (high - low)])

    def _in_background(self, make: Callable[[], Made]) -> Future[Made]:
        """Return the future of `make`, in a thread for a large scene."""
        return start_thread(make) if self.large else run_now(make)

    @property
    def large(self) -> bool:
        """True if processing all triangles takes more than a tenth of a second."""
        return self.geometry.triangles >= _LARGE

    def prebuild(self, tree: bool = False, caster: bool = False) -> None:
        """Start the builds of `tree` and `caster` in the background if they take long."""
        if self.large:
            self._pending_builds(tree, caster)

    def _pending_builds(self, tree: bool, caster: bool) -> list[Future[Any]]:
        """Return the unfinished builds of `tree` and `caster`."""
        builds: list[Future[Any]] = [self._caster_build()] if caster else []
        return builds + ([self._tree_build()] if tree and self._tree is None else [])

    def wait(self, seconds: float, tree: bool = False, caster: bool = False) -> bool:
        """Wait at most `seconds` for the builds of `tree` and `caster`; True if they are done.

        Polling without waiting would take the interpreter's lock from the building threads.
        """
        return wait_for(self._pending_builds(tree, caster), seconds)

    def apply(self, change: SceneChange) -> None:
        """Apply `change`, from the present scene to another with the same meshes lit, placed or painted differently.

        Moved triangles are uploaded again, and ray structures are rebuilt at their next use. Raises InputError, unchanged, for
        materials that would renumber triangles, or that have other textures.
        """
        scene = change.new
        if self._uploaded is not scene.meshes:
            if change.repainted and not numbered_alike(self.scene, scene):
                raise InputError(
                    "a mesh cannot get a material by which light passes it otherwise, or by which it is drawn otherwise; load "
                    "the scene anew with it"
                )
            before, self._uploaded = self._uploaded, None
            triangles = self._made.find("triangles", TriangleTable)
            vertices, faces = flatten(scene)
            moved = bool(change.moved) or before is None
            try:
                if change.repainted or before is None:
                    self.materials.update(scene)
                if moved and triangles is not None:
                    triangles.update(vertices, faces)
            except Exception:  # unchanged; only an interruption may follow after this point
                self._uploaded = None if change.repainted else before
                raise
            if moved:
                self._parts = None
                self.geometry.update(vertices, faces)
                self._move_ray_structures(change.moved)
            else:
                self.geometry.repaint(vertices)
                if triangles is not None:
                    triangles.repaint(vertices)
            if any(sort_of(scene.meshes[i]) == CUT_OUT for i in change.repainted):
                self._pending_caster = self._placed = None  # holes may differ
            found = runs(scene)
            if found != self.runs:
                self.runs = found
            self._uploaded = scene.meshes
        self.unlit_interiors = unlit_interiors(scene)
        self.scene = scene
