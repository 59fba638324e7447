"""The surfaces of a scene as tables, and colours, opacity and normals at points of its triangles. NumPy alone.

Written independently of flatten and of the shaders, as a reference for both.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from irrsplat.reference.textures import NUMPY, TextureTable
from irrsplat.scene.model import Material, Mesh, Scene, Texture


class Points(NamedTuple):
    """N points on surfaces, float64; normals are unit, world space.

    position: (N, 3). front: (N, 3) geometric normal on the side of counter-clockwise winding. smooth: (N, 3) interpolated normal,
    mapped: (N, 3) with normal map; both on the side of `front`. albedo, emission: (N, 3). opacity: (N,), 1 if the material
    ignores it. material: (N,) numbers.
    """

    position: np.ndarray
    front: np.ndarray
    smooth: np.ndarray
    mapped: np.ndarray
    albedo: np.ndarray
    emission: np.ndarray
    opacity: np.ndarray
    material: np.ndarray


@dataclass(frozen=True)
class MaterialTable:
    """Materials by number, one array per field of scene.Material, and numbers in `textures` of albedo, emission and normal maps,
    -1: none."""

    materials: tuple[Material, ...]
    textures: tuple[Texture, ...]
    texture: dict[str, np.ndarray]
    normal_scale: np.ndarray
    reads_opacity: np.ndarray  # True unless the material ignores opacity
    cut_out: np.ndarray  # least opacity of a hit; 0: always hit
    light_cutoff: np.ndarray
    filters: np.ndarray
    transmission: np.ndarray
    double_sided: np.ndarray

    @staticmethod
    def of(materials: tuple[Material, ...]) -> MaterialTable:
        """Return the table of these materials."""
        numbers: dict[Texture, int] = {}
        texture: dict[str, np.ndarray] = {}
        for kind in ("albedo", "emission", "normal"):
            worn = [getattr(m, f"{kind}_texture") for m in materials]
            texture[kind] = np.array([-1 if t is None else numbers.setdefault(t, len(numbers)) for t in worn], np.int64)
        masks = [m.alpha_mode == "mask" for m in materials]
        return MaterialTable(
            materials,
            tuple(numbers),
            texture,
            np.array([m.normal_scale for m in materials]),
            np.array([m.alpha_mode != "opaque" for m in materials], bool),
            np.array([m.alpha_cutoff if mask else 0.0 for m, mask in zip(materials, masks, strict=True)]),
            np.array([m.light_cutoff for m in materials]),
            np.array([m.filters for m in materials], bool),
            np.array([m.transmission for m in materials]),
            np.array([m.double_sided for m in materials], bool),
        )


@dataclass(frozen=True)
class Surfaces:
    """All triangles of a scene, mesh by mesh.

    positions, normals: (V, 3) float32. albedo: (V, 3) float32, the factor or the vertex colours. opacity: (V,) float32.
    emission_factor: (V, 3) float32, a factor on emission. uvs: (V, 4) float32. faces: (F, 3) int64. material: (F,) numbers in
    `materials`.
    """

    positions: np.ndarray
    normals: np.ndarray
    albedo: np.ndarray
    opacity: np.ndarray
    emission_factor: np.ndarray
    uvs: np.ndarray
    faces: np.ndarray
    material: np.ndarray
    materials: MaterialTable

    @staticmethod
    def of(scene: Scene) -> Surfaces:
        """Return the scene's surfaces."""
        meshes = [m for m in scene.meshes if len(m.faces)]
        first = np.cumsum([0] + [len(m.positions) for m in meshes])[:-1]
        count = [len(m.faces) for m in meshes]

        def joined(width: int, values: list[np.ndarray]) -> np.ndarray:
            return np.concatenate([np.zeros((0, width)), *values]).astype(np.float32)

        def one_a_vertex(mesh: Mesh, values: object, width: int) -> np.ndarray:
            return np.broadcast_to(np.asarray(values).reshape(-1, width), (len(mesh.positions), width))

        def own(mesh: Mesh, unlit: bool, instead: object) -> np.ndarray:
            return one_a_vertex(mesh, instead if mesh.colors is None or mesh.material.unlit != unlit else mesh.colors, 3)

        return Surfaces(
            joined(3, [m.positions for m in meshes]),
            joined(3, [m.normals for m in meshes]),
            joined(3, [own(m, False, m.material.albedo) for m in meshes]),
            joined(1, [one_a_vertex(m, m.material.opacity if m.opacities is None else m.opacities, 1) for m in meshes])[:, 0],
            joined(3, [own(m, True, (1.0, 1.0, 1.0)) for m in meshes]),
            joined(4, [one_a_vertex(m, np.zeros(4) if m.uvs is None else m.uvs, 4) for m in meshes]),
            np.concatenate([np.zeros((0, 3), np.int64), *(m.faces + k for m, k in zip(meshes, first, strict=True))]).astype(
                np.int64
            ),
            np.repeat([scene.materials[m.material] for m in meshes], count).astype(np.int64),
            MaterialTable.of(tuple(scene.materials)),
        )

    @cached_property
    def textures(self) -> TextureTable:
        """Textures of `materials`."""
        return TextureTable.of(self.materials.textures, NUMPY)

    @cached_property
    def emission_varies(self) -> np.ndarray:
        """(F,) bool: True if a vertex of the triangle has an emission factor other than 1."""
        return np.asarray((self.emission_factor != 1.0).any(axis=1)[self.faces].any(axis=1))

    @cached_property
    def emission(self) -> np.ndarray:
        """(F, 3) float32: the triangles' emission before textures and vertex factors."""
        factors = np.array([m.emission for m in self.materials.materials]).reshape(-1, 3)
        return np.asarray(factors[self.material].astype(np.float32))

    @cached_property
    def seen_by_light(self) -> tuple[np.ndarray, np.ndarray]:
        """Two of (F,) bool: True if light may hit the triangle, and if that depends on the point."""
        table, corners = self.materials, self.opacity[self.faces]
        low, high = corners.min(axis=1, initial=np.inf), corners.max(axis=1, initial=0.0)
        images = {texture.image for texture in table.textures}
        alphas = {image: (image.pixels[..., 3].min(), image.pixels[..., 3].max()) for image in images}
        ends = np.array([*(alphas[t.image] for t in table.textures), (255, 255)]) / 255.0  # the last one stands for no texture
        least, most = ends[table.texture["albedo"][self.material]].T
        reads = table.reads_opacity[self.material]
        least, most = np.where(reads, low * least, 1.0), np.where(reads, high * most, 1.0)  # bounds of the opacity
        cutoff = table.light_cutoff[self.material]
        return most >= cutoff, (most >= cutoff) & (least < cutoff)

    def at(self, triangle: np.ndarray, u: np.ndarray, v: np.ndarray) -> Points:
        """Return the surface points a + u(b - a) + v(c - a) of triangles (N,) with corners a, b, c; u, v: (N,)."""
        corners = self.faces[triangle]
        share = np.stack([1.0 - u - v, u, v], axis=1)

        def blended(values: np.ndarray) -> np.ndarray:
            return np.asarray(np.einsum("nk,nk...->n...", share, values[corners].astype(np.float64)))

        a, b, c = (self.positions[corners[:, k]].astype(np.float64) for k in range(3))
        front = unit(np.cross(b - a, c - a))
        smooth = blended(self.normals)
        smooth = np.where((smooth**2).sum(1, keepdims=True) > 0.0, unit(smooth), front)
        smooth = np.where((smooth * front).sum(1, keepdims=True) < 0.0, -smooth, smooth)
        material, table = self.material[triangle], self.materials
        albedo, opacity = blended(self.albedo), blended(self.opacity)
        emission = self.emission[triangle].astype(np.float64) * blended(self.emission_factor)
        uvs = blended(self.uvs)
        mapped = smooth
        if table.textures:
            r, g, b_, alpha = self._color("albedo", material, uvs)
            albedo, opacity = albedo * np.stack([r, g, b_], axis=1), opacity * alpha
            emission = emission * np.stack(self._color("emission", material, uvs)[:3], axis=1)
            mapped = self._bent(triangle, material, uvs, smooth, front)
        opacity = np.where(table.reads_opacity[material], opacity, 1.0)
        return Points(blended(self.positions), front, smooth, mapped, albedo, emission, opacity, material)

    def _color(self, kind: str, material: np.ndarray, uvs: np.ndarray, linear: bool = False) -> list[np.ndarray]:
        """Return red, green, blue and alpha, (N,) each, of the material's texture of this kind; 1 without a texture."""
        number = self.materials.texture[kind][material]
        at = np.flatnonzero(number >= 0)
        found = [np.ones(len(number)) for _ in range(4)]
        if len(at):
            for channel, values in zip(found, self.textures.color_at(number[at], tuple(uvs[at].T), linear), strict=True):
                channel[at] = values
        return found

    def _bent(
        self, triangle: np.ndarray, material: np.ndarray, uvs: np.ndarray, smooth: np.ndarray, front: np.ndarray
    ) -> np.ndarray:
        """Return (N, 3) `smooth` normals bent by the normal maps, none below the surface with normal `front`.

        The tangent points right in the image, the bitangent up; both are made perpendicular to `smooth`. Missing or degenerate
        texture coordinates leave the normal unchanged.
        """
        number = self.materials.texture["normal"][material]
        at = np.flatnonzero(number >= 0)
        if not len(at):
            return smooth
        corners, n = self.faces[triangle[at]], smooth[at]
        p = self.positions[corners].astype(np.float64)
        # image coordinates, so that a transform that rotates the map rotates its normals as well
        places = [self.textures.place(number[at], tuple(self.uvs[corners[:, k]].astype(np.float64).T)) for k in range(3)]
        (du1, dv1), (du2, dv2) = ((places[k][0] - places[0][0], places[k][1] - places[0][1]) for k in (1, 2))
        area = du1 * dv2 - du2 * dv1
        rightward = (p[:, 1] - p[:, 0]) * dv2[:, None] - (p[:, 2] - p[:, 0]) * dv1[:, None]
        downward = (p[:, 2] - p[:, 0]) * du1[:, None] - (p[:, 1] - p[:, 0]) * du2[:, None]
        tangent = np.sign(area)[:, None] * rightward
        tangent = unit(tangent - (tangent * n).sum(1, keepdims=True) * n)
        bitangent = np.cross(n, tangent)
        bitangent *= np.sign((bitangent * -np.sign(area)[:, None] * downward).sum(1, keepdims=True))
        r, g, b, _ = self._color("normal", material[at], uvs[at], linear=True)
        scale = self.materials.normal_scale[material[at]]
        x, y, z = (2.0 * r - 1.0) * scale, (2.0 * g - 1.0) * scale, np.maximum(2.0 * b - 1.0, 0.0)
        bent = x[:, None] * tangent + y[:, None] * bitangent + z[:, None] * n
        bent = unit(bent - np.minimum((bent * front[at]).sum(1, keepdims=True), 0.0) * front[at])
        usable = (np.abs(area) > 1e-20) & np.isfinite(bent).all(axis=1) & ((bent**2).sum(1) > 0.5) & ((tangent**2).sum(1) > 0.5)
        result = smooth.copy()
        result[at[usable]] = bent[usable]
        return result


def unit(v: np.ndarray) -> np.ndarray:
    """Return (N, 3) vectors scaled to length 1; zero vectors stay."""
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return v / np.where(length > 0.0, length, 1.0)
