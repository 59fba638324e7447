"""Surfaces: images, textures, materials and meshes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.vectors import box, triangle_areas, triangle_normals
from irrsplat.core.words import GREATEST
from irrsplat.scene.model.checks import check_rows, check_type, checked, checked_number, put

_FARTHEST = 3e38  # of texture coordinates, which are never squared
_LOOKED_AT = 1024  # triangles whose planes decide about a mesh's form
_PLANES = 64  # different ones; a mesh with more is not tested
_ROUGH = 1e-4  # of the mesh's diagonal, a tenth of a shadow map's texel: greatest distance of vertices from a plane


@dataclass(frozen=True, eq=False)  # compared by identity, so that textures can share an image
class Image:
    """An image of a texture.

    pixels: (H, W, 4) uint8, top row first; red, green and blue are sRGB-encoded, or raw values of a normal map; alpha is linear.
    name: of its file, for notices. Raises InputError for other pixels.
    """

    pixels: np.ndarray
    name: str = ""

    def __post_init__(self) -> None:
        p = self.pixels
        if not isinstance(p, np.ndarray) or p.dtype != np.uint8 or p.ndim != 3 or p.shape[2] != 4 or not p.size:
            raise InputError("an image's pixels are an array (H, W, 4) of uint8")

    @cached_property
    def alpha_range(self) -> tuple[float, float]:
        """The least and greatest alpha of its pixels, 0..1."""
        alpha = self.pixels[..., 3]
        return int(alpha.min()) / 255.0, int(alpha.max()) / 255.0


Wrap = Literal["repeat", "mirror", "clamp"]
AlphaMode = Literal["opaque", "mask", "blend"]
Form = Literal["flat", "convex", "other"]


@dataclass(frozen=True)
class Texture:
    """An image and its mapping.

    uv_set: 0 or 1, the set of a mesh's coordinates. transform: (a, b, c, d, e, f): image coordinates are
    (a·u + b·v + c, d·u + e·v + f), from (0, 0) at the image's top left corner to (1, 1) at its bottom right one.
    wrap: along u and v. nearest: magnification without interpolation. Raises InputError for an image of another type.
    """

    image: Image
    uv_set: int = 0
    transform: tuple[float, float, float, float, float, float] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")
    nearest: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.image, Image):
            raise InputError(f"a texture's image is an Image, not {type(self.image).__name__}; make one by Image(pixels)")


@dataclass(frozen=True)
class Material:
    """A Lambertian surface, lit from both sides.

    albedo: (3,) diffuse reflectance in 0..1, linear; times the colour of albedo_texture. emission: (3,) emitted radiance in
    W/(m² sr), from both sides; times the colour of emission_texture.
    normal_texture: a tangent-space normal map (green up, as in glTF); normal_scale: factor on its x and y.
    opacity: 0..1, times the alpha of albedo_texture. alpha_mode: "opaque" ignores opacity; "mask" cuts the surface out below
    alpha_cutoff; "blend" mixes with the background. transmission: 0..1; above 0.5 all light passes, and only the view is tinted.
    unlit: albedo is 0, and the emission is multiplied by vertex colours.
    double_sided: False hides the back from cameras, but not from light.
    Raises InputError for invalid numbers.
    """

    albedo: tuple[float, float, float] = (0.5, 0.5, 0.5)
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    albedo_texture: Texture | None = None
    emission_texture: Texture | None = None
    normal_texture: Texture | None = None
    normal_scale: float = 1.0
    opacity: float = 1.0
    alpha_mode: AlphaMode = "opaque"
    alpha_cutoff: float = 0.5
    transmission: float = 0.0
    double_sided: bool = True
    unlit: bool = False

    def __post_init__(self) -> None:
        put(self, albedo=checked("a material's albedo", self.albedo, 3, 0.0, 1.0))
        put(self, emission=checked("a material's emission", self.emission, 3, 0.0))
        for name, *within in (("opacity", 0.0, 1.0), ("transmission", 0.0, 1.0), ("normal_scale",), ("alpha_cutoff",)):
            put(self, **{name: checked_number(f"a material's {name}", getattr(self, name), *within)})
        if self.alpha_mode not in get_args(AlphaMode):
            raise InputError(f"a material's alpha_mode is one of {', '.join(get_args(AlphaMode))}, not {self.alpha_mode!r:.60}")
        for texture in self.textures:
            check_type("a material's texture", texture, Texture)

    @property
    def light_cutoff(self) -> float:
        """The least opacity (of `opacity`, texture and vertices) at which light sees the surface; 0: always; above 1: never.

        Cut-out parts do not exist for light. Surfaces that blend or transmit exist for light where they block more than half of
        it; elsewhere light passes unchanged, and the picture is tinted (a filter).
        """
        if self.alpha_mode == "mask":
            return self.alpha_cutoff if self.transmission <= 0.5 else 2.0
        if self.transmission > 0.5:
            return 2.0
        return 0.5 / (1.0 - self.transmission) if self.alpha_mode == "blend" else 0.0

    @property
    def filters(self) -> bool:
        """True if it may filter the background, by the factor 1 - opacity·(1 - albedo)."""
        return self.alpha_mode == "blend" or self.transmission > 0.5

    @property
    def textures(self) -> tuple[Texture, ...]:
        """The textures of the material."""
        all_of_them = self.albedo_texture, self.emission_texture, self.normal_texture
        return tuple(texture for texture in all_of_them if texture is not None)


@dataclass(frozen=True, eq=False)  # compared by identity, because == of arrays has no single value
class Mesh:
    """Triangles in world space, or relative to their scene's origin; compared by identity.

    positions: (V, 3) float32, metres, or float64 where float32 is too coarse, far from 0 0 0. normals: (V, 3) float32, unit
    shading normals. faces: (F, 3) int32. colors: (V, 3) float32 linear reflectance in place of material.albedo, or a factor on
    the emission of an unlit material, or None. opacities: (V,) float32 in place of material.opacity, or None. uvs: (V, 4)
    float32, two sets u v u v, or None (all 0). closed: True only for a watertight surface that is wound outward (in world space).
    Raises InputError for arrays of different lengths and for numbers that are not finite.
    """

    positions: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    material: Material = field(default_factory=Material)
    colors: np.ndarray | None = None
    closed: bool = False
    name: str = ""
    uvs: np.ndarray | None = None
    opacities: np.ndarray | None = None

    def __repr__(self) -> str:
        return f"<Mesh {self.name!r}: {len(self.positions)} vertices, {len(self.faces)} triangles>"

    def __post_init__(self) -> None:
        mesh = f"of mesh {self.name!r:.60}" if self.name else "of a mesh"
        check_rows(f"the positions {mesh}", self.positions, 3)
        count = len(self.positions)
        check_rows(f"the normals {mesh}", self.normals, 3, count)
        for name, columns, most in (("colors", 3, GREATEST), ("uvs", 4, _FARTHEST), ("opacities", 0, GREATEST)):
            if getattr(self, name) is not None:
                check_rows(f"the {name} {mesh}", getattr(self, name), columns, count, most)
        check_rows(f"the faces {mesh}", self.faces, 3)
        if self.faces.dtype.kind not in "iu":
            raise InputError(f"the faces {mesh} are whole numbers, not of {self.faces.dtype}")
        if self.faces.size and not 0 <= self.faces.min() <= self.faces.max() < count:
            raise InputError(f"the faces {mesh} refer to vertices that do not exist; expected 0 to {count - 1}")
        check_type("a mesh's name", self.name, str)
        check_type(f"the material {mesh}", self.material, Material)

    @cached_property
    def bounds(self) -> np.ndarray:
        """(2, 3) float32: the least and greatest coordinates of the vertices, of which there is at least one."""
        return box(self.positions)

    @cached_property
    def area(self) -> float:
        """The area of all triangles, m²."""
        return float(triangle_areas(self.positions[self.faces]).sum())

    @cached_property
    def is_point(self) -> bool:
        """True if all vertices coincide, so that the mesh is invisible."""
        return not np.ptp(self.bounds, axis=0).any() if len(self.positions) else True

    @cached_property
    def form(self) -> Form:
        """Return "flat", "convex" or "other"; flat and convex meshes cast no shadow on their own lit sides.

        A convex mesh is closed, and has at most 64 different planes.
        """
        corners = self.positions.astype(float)[self.faces[:: len(self.faces) // _LOOKED_AT + 1]]
        normals = np.ascontiguousarray(triangle_normals(corners)[0].T)
        different = np.unique(np.round(normals, 3), axis=0, return_index=True)[1]
        if not 0 < len(different) <= _PLANES:
            return "other"
        normals, through = normals[different], corners[different, 0]
        heights = self.positions @ normals.T - (normals * through).sum(1)
        slack = _ROUGH * float(np.linalg.norm(np.ptp(self.bounds, axis=0)))
        if np.abs(heights).max() <= slack:
            return "flat"
        return "convex" if self.closed and heights.max() <= slack else "other"
