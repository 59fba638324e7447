"""Draw states of materials, the order of triangles by them, and the tables of all vertices and triangles in the GPU's layout."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from irrsplat.core.vertex_layout import WIDTH, vertex_column
from irrsplat.scene.model import AlphaMode, Material, Mesh, Scene, Texture
from irrsplat.scene.seen_by_light import sort_of


@dataclass(frozen=True)
class Appearance:
    """The draw state of materials; other properties come from vertices and the table of materials.

    alpha_cutoff: Material.alpha_cutoff where `alpha` is "mask", else 0. filters: Material.filters. glows: True for filters that
    emit.
    """

    albedo: Texture | None = None
    emission: Texture | None = None
    normal: Texture | None = None
    normal_scale: float = 1.0
    alpha: AlphaMode = "opaque"
    alpha_cutoff: float = 0.0
    filters: bool = False
    glows: bool = False
    single_sided: bool = False

    @property
    def solid(self) -> bool:
        """True if some of the surface may hide the background; otherwise it only filters."""
        return self.alpha == "blend" or not self.filters


PLAIN = Appearance()  # no texture, opaque, double-sided


@dataclass(frozen=True)
class Run:
    """Consecutive triangles of one draw state: `count` triangles from number `first`."""

    appearance: Appearance
    first: int
    count: int


def appearance_of(material: Material) -> Appearance:
    """Return the draw state of a material, without invisible parts such as the texture of a black emission."""
    return Appearance(
        albedo=material.albedo_texture,
        emission=material.emission_texture if any(material.emission) else None,
        normal=material.normal_texture if material.normal_scale != 0.0 else None,
        normal_scale=material.normal_scale if material.normal_texture is not None else 1.0,
        alpha=material.alpha_mode,
        alpha_cutoff=material.alpha_cutoff if material.alpha_mode == "mask" else 0.0,
        filters=material.filters,
        glows=material.filters and any(material.emission),
        single_sided=not material.double_sided,
    )


def in_order(scene: Scene) -> list[Mesh]:
    """Return the scene's meshes in the order of their triangles' numbers: by seen_by_light.sort_of, then by draw state."""
    return [scene.meshes[i] for i in order(scene)]


def order(scene: Scene) -> list[int]:
    """Return the indices of the meshes in the order of in_order."""
    appearances = {material: appearance_of(material) for material in scene.materials}
    numbers = {appearance: i for i, appearance in enumerate(dict.fromkeys([PLAIN, *appearances.values()]))}
    keys = [(sort_of(mesh), numbers[appearances[mesh.material]]) for mesh in scene.meshes]
    return sorted(range(len(keys)), key=keys.__getitem__)


def numbered_alike(a: Scene, b: Scene) -> bool:
    """True if triangles have the same numbers in two states of a scene."""
    return order(a) == order(b) and all(sort_of(x) == sort_of(y) for x, y in zip(a.meshes, b.meshes, strict=True))


def runs(scene: Scene) -> tuple[Run, ...]:
    """Return all triangles as runs of one draw state, in the order of their numbers."""
    appearances = {material: appearance_of(material) for material in scene.materials}
    found: list[Run] = []
    for mesh in in_order(scene):
        appearance, count = appearances[mesh.material], len(mesh.faces)
        if found and found[-1].appearance == appearance:
            found[-1] = replace(found[-1], count=found[-1].count + count)
        elif count:
            found.append(Run(appearance, found[-1].first + found[-1].count if found else 0, count))
    return tuple(found)


def flatten(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (V, WIDTH) float32, rows as in core/vertex_layout.py, and faces (F, 3) int32.

    Faces are in the order of `in_order`, as in FaceCounts.
    """
    meshes, numbers = in_order(scene), scene.materials
    vertices = np.empty((sum(len(mesh.positions) for mesh in meshes), WIDTH), "f4")
    faces = np.empty((sum(len(mesh.faces) for mesh in meshes), 3), "i4")
    row = face = 0
    for mesh in meshes:
        rows = vertices[row : row + len(mesh.positions)]
        vertex_column(rows, "position")[:] = mesh.positions
        vertex_column(rows, "normal")[:] = mesh.normals
        vertex_column(rows, "material")[:] = numbers[mesh.material]
        colors = mesh.material.albedo if mesh.colors is None else -1.0 - mesh.colors if mesh.material.unlit else mesh.colors
        vertex_column(rows, "albedo")[:] = colors
        vertex_column(rows, "opacity")[:, 0] = mesh.material.opacity if mesh.opacities is None else mesh.opacities
        vertex_column(rows, "uv")[:] = 0.0 if mesh.uvs is None else mesh.uvs
        np.add(mesh.faces, row, out=faces[face : face + len(mesh.faces)], casting="same_kind")
        row, face = row + len(rows), face + len(mesh.faces)
    return vertices, faces
