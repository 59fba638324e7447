"""Reader of `.gltf` and `.glb` files: glTF 2.0's geometry, diffuse materials, cameras and lights, without animations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from irrsplat.core.color import LUMINOUS_EFFICACY
from irrsplat.core.errors import InputError
from irrsplat.core.load_options import LoadOptions
from irrsplat.core.paths import take_copies
from irrsplat.core.vectors import Vector, times
from irrsplat.core.words import GREATEST
from irrsplat.scene.io.defaults import finish
from irrsplat.scene.io.gltf import geometry
from irrsplat.scene.io.gltf.accessors import values
from irrsplat.scene.io.gltf.cameras_lights import cameras, lights
from irrsplat.scene.io.gltf.document import READ_ERRORS, Damaged, Document, printable, read
from irrsplat.scene.io.gltf.geometry import Attributes, cofactors
from irrsplat.scene.io.gltf.materials import Materials, Surface
from irrsplat.scene.io.gltf.nodes import Node, instances, name, visible, worlds
from irrsplat.scene.io.mesh_builder import Part, build_meshes
from irrsplat.scene.model import Mesh, Scene
from irrsplat.scene.stand_ins.up_axis import up_vector
from irrsplat.sky.sky_text import sky_of

_SUPPORTED = {  # extensions that are supported, or that have no visible effect
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_avif",
    "EXT_texture_webp",
    "EXT_feature_metadata",
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_structural_metadata",
    "FB_ngon_encoding",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MSFT_texture_dds",
}


def load_gltf(path: Path, options: LoadOptions) -> Scene:
    """Load the default scene of a `.gltf` or `.glb` file, in metres, y up unless the options differ.

    Nodes are where the file stores them, without animations. Damaged and unsupported parts are left out, with Scene.notices.
    Raises InputError, one line with the file's path, for a truncated file, for no glTF 2.0, and without visible triangles.
    """
    sky = sky_of(options.sky)
    document = read(path)
    document.per_unit = 1.0 / LUMINOUS_EFFICACY if options.photometric else 1.0
    with np.errstate(all="ignore"):
        reader = _Reader(document)
        meshes, origin = reader.meshes()
        if not meshes:
            raise InputError(f"{reader.failure()}; nothing is left to show", path)
        bounds = Scene(tuple(meshes), (), (), origin=origin).bounds
        found_cameras = cameras(document, reader.nodes, bounds)
        found_lights = lights(document, reader.nodes)
        up = up_vector(path, options.up_axis)
    for used in document.entries("extensionsUsed"):
        if used not in _SUPPORTED:
            document.unshown[printable(used)] = None
    if document.entries("animations"):
        document.unshown["animations"] = None
    return finish(
        path,
        meshes,
        found_lights,
        found_cameras,
        sky and sky.in_watts(document.per_unit),
        {str(path): reader.degenerate},
        document.notices(),
        list(document.contents),
        up,
        origin,
    )


class _Reader:
    """Conversion of a document's meshes. nodes: the visible ones. degenerate: number of dropped triangles without an area."""

    def __init__(self, document: Document) -> None:
        self.document, self.degenerate = document, 0
        self._world = worlds(document)
        self.nodes = visible(document, self._world)
        if not document.entries("nodes"):  # a library of meshes
            self.nodes = [Node(i, "", {"mesh": i}, np.eye(4)) for i in range(len(document.entries("meshes")))]
        self._materials = Materials(document)
        self._mesh_uses = Counter(node.entry["mesh"] for node in self.nodes if isinstance(node.entry.get("mesh"), int))
        self._attribute_cache: dict[object, Attributes] = {}  # of meshes with several nodes

    def meshes(self) -> tuple[list[Mesh], Vector]:
        """Return the meshes of the visible nodes, one for each primitive with triangles, and their origin."""
        found = []
        all_built, origin = build_meshes(list(self._parts()))
        for built in all_built:
            if built.mesh is None:
                self.document.leave_out(built.part.source, built.problem)
            elif len(built.mesh.faces):
                found.append(built.mesh)
            self.degenerate += built.dropped
        return found, origin

    def _parts(self) -> Iterator[Part]:
        """Yield the triangles of the visible nodes; the source of a part is the name of its node."""
        self._materials.read_images(self._used_materials())
        for node in self.nodes:
            if "mesh" not in node.entry:
                continue
            node_name = name(self.document, node.index) if self.document.entries("nodes") else f"mesh {node.index}"
            with self.document.part(node_name):
                entry = self.document.entry("meshes", node.entry["mesh"])
                label = node.name or printable(entry.get("name") or "") or node_name
                places = instances(self.document, node)
                for i, primitive in enumerate(self.document.entries("primitives", entry)):
                    with self.document.part(node_name):
                        other = geometry.kind_without_triangles(primitive)
                        if other is not None:
                            self.document.unshown[other] = None
                            continue
                        yield self._part(node, entry, i, places, node_name, label)

    def _used_materials(self) -> Iterator[object]:
        """Yield the indices of the materials of the nodes' triangles."""
        for node in self.nodes:
            with suppress(*READ_ERRORS):
                mesh = self.document.entry("meshes", node.entry["mesh"])
                for primitive in self.document.entries("primitives", mesh):
                    if geometry.kind_without_triangles(primitive) is None:
                        yield primitive.get("material")

    def failure(self) -> str:
        """Return the reason why `meshes` finds none, for an error."""
        lost = self.document.lost
        if lost:
            return self.document.loss(max(lost, key=lambda reason: len(lost[reason])))
        others = [kind for kind in self.document.unshown if kind in ("points", "lines")]
        if others:
            return f"there are no triangles in this file, only {' and '.join(others)}"
        if any("mesh" in node.entry for node in self.nodes):
            return "no triangle in this file has an area"
        meshes = len(self.document.entries("meshes"))
        return f"none of the {meshes} meshes in this file is in its scene" if meshes else "there are no meshes in this file"

    def _part(self, node: Node, entry: Mapping[str, Any], i: int, places: np.ndarray, node_name: str, label: str) -> Part:
        """Return the triangles of the i-th primitive of a node's mesh; raise Damaged."""
        primitive = entry["primitives"][i]
        attributes = self._attributes(node, i, primitive, node_name)  # before any image, which would be decoded in vain
        surface = self._materials.surface(primitive.get("material"))
        shape = self._geometry(node, entry, i, attributes, surface)
        if "skin" in node.entry:
            with self.document.part(f"the skin of {node_name}"):
                shape = geometry.skinned(shape, attributes, self._joints(node.entry["skin"]))
                places = np.eye(4)[None]
        shape = self._without_invalid(shape, node_name)
        material = self._materials.mesh_material(surface, shape.colors)
        colors, opacities = _vertex_colors(shape.colors, surface)
        shape = _placed(shape, places)
        repeat = len(shape.positions) // max(1, len(attributes.rows))
        colors, opacities, uvs = (
            np.tile(array, (repeat, 1) if array.ndim == 2 else repeat) if array is not None and repeat > 1 else array
            for array in (colors, opacities, shape.uvs if material.textures else None)
        )
        return replace(
            shape,
            material=material,
            colors=colors,
            name=label,
            uvs=uvs,
            opacities=opacities if material.alpha_mode != "opaque" else None,
            source=node_name,
        )

    def _attributes(self, node: Node, i: int, primitive: Mapping[str, Any], node_name: str) -> Attributes:
        """Return the vertices and triangles of the i-th primitive of a node's mesh; raise Damaged."""
        key = node.entry["mesh"], i
        found = self._attribute_cache.get(key)
        if found is None:
            found = Attributes(self.document, primitive)
            if found.invalid_faces:
                self.document.leave_out(
                    f"{found.invalid_faces} triangles of {node_name}", "they refer to vertices that do not exist"
                )
            if self._mesh_uses[node.entry["mesh"]] > 1:
                self._attribute_cache[key] = found
        else:
            take_copies(len(found.rows))
        return found

    def _geometry(self, node: Node, entry: Mapping[str, Any], i: int, attributes: Attributes, surface: Surface) -> Part:
        """Return the triangles of the i-th primitive of a node's mesh, with its morph targets at the node's weights; raise
        Damaged."""
        targets = self.document.entries("targets", entry["primitives"][i])
        given = np.asarray(node.entry.get("weights", entry.get("weights", [])), float).reshape(-1)
        weights = np.nan_to_num(given)[: len(targets)] if targets else np.zeros(0)
        key = weights.tobytes()
        if key not in attributes.shapes:
            attributes.shapes[key] = geometry.read(attributes, surface.uv_sets, weights)
        return attributes.shapes[key]

    def _joints(self, index: object) -> np.ndarray:
        """Return (J, 4, 4) world_from_vertex of a skin's joints; raise Damaged."""
        skin = self.document.entry("skins", index)
        joints = [self._world[j] for j in self.document.entries("joints", skin) if self.document.entry("nodes", j) is not None]
        if not joints:
            raise Damaged("it has no joints")
        matrices = np.array([np.full((4, 4), np.nan) if joint is None else joint for joint in joints])
        if "inverseBindMatrices" in skin:
            rows = np.arange(len(joints))
            binds = values(self.document, skin["inverseBindMatrices"], (16,), rows).astype(float)
            matrices = matrices @ binds.reshape(-1, 4, 4).transpose(0, 2, 1)
        return matrices

    def _without_invalid(self, shape: Part, node_name: str) -> Part:
        """Return the geometry without triangles whose vertices are not finite or exceed float32; other such vertices become 0."""
        positions, corners, others = shape.positions, shape.corners, (shape.normals, shape.uvs, shape.colors)
        good = (np.abs(positions) <= GREATEST).all(1)  # false for NaN
        if not good.all():
            keep: np.ndarray = good[corners].all(1)
            if not keep.all():
                part = f"{np.count_nonzero(~keep)} triangles of {node_name}" if keep.any() else node_name
                self.document.leave_out(part, "its vertices are not finite")
            positions, corners = np.where(good[:, None], positions, 0.0), corners[keep]
        rest = (a if a is None or np.isfinite(a).all() else np.nan_to_num(a, posinf=0.0, neginf=0.0) for a in others)
        normals, uvs, colors = rest
        return Part(positions, corners, normals, colors=colors, uvs=uvs)


def _vertex_colors(colors: np.ndarray | None, surface: Surface) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return (V, 3) albedo and (V,) opacity of a surface with vertex colours; None where the material's own suffice."""
    if colors is None or not len(colors):
        return None, None
    albedo = None
    if not (colors[:, :3] == 1.0).all():
        factor = 1.0 if surface.material.unlit else np.asarray(surface.factor[:3])  # unlit: its emission includes the factor
        albedo = np.clip(colors[:, :3] * factor, 0.0, 1.0)
    return albedo, np.clip(colors[:, 3] * surface.factor[3], 0.0, 1.0) if colors.shape[1] == 4 else None


def _placed(shape: Part, places: np.ndarray) -> Part:
    """Return the geometry with its matrix; copies at several places (N, 4, 4) become one geometry.

    Mirrored triangles are wound the other way. A singular matrix is applied here, without normals.
    Raises Damaged where the geometry collapses at every place.
    """
    determinants = np.linalg.det(places[:, :3, :3])
    if len(places) == 1 and determinants[0] != 0.0:
        return replace(shape, corners=shape.corners[:, :: -1 if determinants[0] < 0.0 else 1], matrix=places[0])
    places = places[np.isfinite(determinants) & (np.linalg.matrix_rank(np.nan_to_num(places[:, :3, :3])) >= 2)]
    determinants = np.linalg.det(places[:, :3, :3])
    number = len(shape.positions)
    if not len(places):
        raise Damaged("its scale is 0")
    take_copies(number * (len(places) - 1))
    positions = np.concatenate([times(shape.positions, place[:3, :3]) + place[:3, 3] for place in places])
    corners = np.concatenate(
        [shape.corners[:, :: -1 if mirror else 1] + i * number for i, mirror in enumerate(determinants < 0.0)]
    )
    normals = None
    if shape.normals is not None and (determinants != 0.0).all():
        turned = cofactors(places[:, :3, :3]) * np.sign(determinants)[:, None, None]
        normals = np.concatenate([times(shape.normals, turn) for turn in turned])
    return replace(shape, positions=positions, corners=corners, normals=normals)
