"""What flows between the stages: one table of the image channels, and the frozen bundles of GPU handles.

EXR layers, NPZ keys, overlays and the documentation are made from `CHANNELS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from irrsplat.core import record_layout
from irrsplat.core.material_layout import PROPERTIES

if TYPE_CHECKING:
    import moderngl


# GLSL uniforms by name: numbers, tuples, arrays and textures. Any, because a draw is handed them beside its own arguments; the
# draw itself checks that every uniform of its shaders is there, and no other.
Uniforms = dict[str, Any]


@dataclass(frozen=True)
class Channel:
    """One image buffer: its name, number of components, unit, how it is shown, and what it is."""

    name: str
    components: int  # 1: H W, 3: H W 3
    unit: str
    show: str  # "radiance" (exposed, tone-mapped), "unit" (0..1), "signed" (-1..1), "range" (bounds), "heat" (colour map)
    help: str


CHANNELS: dict[str, Channel] = {
    c.name: c
    for c in (
        Channel("image", 3, "W/(m² sr)", "radiance", "direct and indirect light, emission and the sky behind, not exposed"),
        Channel("direct", 3, "W/(m² sr)", "radiance", "direct outgoing radiance from the scene's lights, ρ/π·E_direct"),
        Channel("indirect", 3, "W/(m² sr)", "radiance", "indirect outgoing radiance, ρ/π·E"),
        Channel("irradiance", 3, "W/m²", "radiance", "indirect irradiance E at the pixel, that of emissive surfaces included"),
        Channel("emission", 3, "W/(m² sr)", "radiance", "emitted radiance of the surface, or of a sky that is seen"),
        Channel("weight", 1, "1", "heat", "Σ of raw w over the records that speak for the pixel"),
        Channel("position", 3, "m", "range", "world space, at the pixel's centre"),
        Channel("normal", 3, "1", "signed", "world space shading normal, bent by the normal map, turned to the camera"),
        Channel("smooth_normal", 3, "1", "signed", "the same without the normal map"),
        Channel("albedo", 3, "1", "unit", "diffuse reflectance ρ, linear"),
        Channel("opacity", 1, "1", "unit", "of the nearest surface: 1, or less of a filter, which tints what is behind it"),
        Channel("depth", 1, "m", "heat", "distance along the view axis; +inf where the camera sees nothing"),
        Channel("alpha", 1, "1", "unit", "share of the pixel where the camera sees a surface, 0..1"),
    )
}


class Filmic(NamedTuple):
    """Hable's filmic curve (2010, "Filmic Tonemapping Operators"): f(scale·x)/f(white), per channel, clipped to 0..1.

    f(x) = (x(ax + cb) + de)/(x(ax + b) + df) − e/f. With `scale` mid grey 0.18 stays 0.18 before sRGB, and radiance 9.1 is white.
    """

    a: float = 0.15
    b: float = 0.50
    c: float = 0.10
    d: float = 0.20
    e: float = 0.02
    f: float = 0.30
    white: float = 32.0
    scale: float = 3.5170872


FILMIC = Filmic()


NOTHING_SEEN = 1e30  # the splat buffer's weight where the camera sees nothing: no record is wanted there


@dataclass(frozen=True, eq=False)
class Filters:
    """What stands before the surfaces of the g-buffer and lets most light pass, as float textures of its size.

    tint: rgb the share of what is behind that is seen, 1 where there is no filter. opacity: of the nearest one, 0 where none is.
    glow: rgb the radiance that they emit themselves; None where none of the scene does.
    """

    tint: moderngl.Texture
    opacity: moderngl.Texture
    glow: moderngl.Texture | None = None


@dataclass(frozen=True, eq=False)
class GBuffer:
    """What the eye sees, as RGBA32F textures of one size, bottom row first.

    position: xyz world space at the pixel's centre, w depth along the view axis (0 where nothing is seen).
    normal: xyz shading normal turned to the camera, w the geometric normal's octahedral x.
    albedo: rgb reflectance, w the geometric normal's octahedral y. emission: rgb emitted radiance, w the triangle's number.
    mapped_normal: xyz the shading normal bent by the normal map; None where no surface of the scene has one. filters: None where
    no surface can be one. emissive: whether any surface of the scene emits; else `emission` is black everywhere.
    corner: where in the whole picture the first pixel lies, of a part of one.
    """

    position: moderngl.Texture
    normal: moderngl.Texture
    albedo: moderngl.Texture
    emission: moderngl.Texture
    mapped_normal: moderngl.Texture | None = None
    filters: Filters | None = None
    emissive: bool = True
    corner: tuple[int, int] = (0, 0)

    @property
    def lit_normal(self) -> moderngl.Texture:
        """The normal that light meets: `mapped_normal`, or `normal` where that is the same. Records know `normal` alone."""
        return self.mapped_normal or self.normal

    @property
    def material_uniforms(self) -> Uniforms:
        """The uniforms of generated/gbuffer_material.glsl."""
        return {one.name: getattr(self, one.name) for one in PROPERTIES}


class LightRow(IntEnum):
    """What the rows of a light in the light table hold: shaders/lighting/lights.glsl reads them as LIGHT_POSITION and so on."""

    POSITION = 0  # xyz position, or the unit direction towards a directional light; w: 1 if directional
    COLOR = 1  # rgb: E = rgb·cosθ·spot/(k·(1, d, d²)); w: number of shadow tiles
    FALLOFF = 2  # xyz: k, constant, linear and quadratic; w: spot exponent
    SPOT = 3  # xyz: unit axis of the cone, from the light; w: 1 if there is a cone
    CONE = 4  # x: cutoff, y: inner, half angles in radians (a directional light's x: its tile's depth in metres);
    # z: number of its first tile; w: scale of the tiles' right and up
    TILE = 5  # of a single tile, three rows right·scale, up·scale, forward: each dotted with (p, 1)


LIGHT_ROWS = LightRow.TILE + 3  # of a light in the table
LUMINAIRE_ROWS = 3  # of a light in the table of luminaires, see irrsplat/lighting/luminaire_table.py


@dataclass(frozen=True, eq=False)
class ShadowMaps:
    """Every light's depth tiles in one texture, and the table that finds them (shaders/lighting/lights.glsl reads both).

    depth: depth texture of all tiles. table: (LIGHT_ROWS·lights, 4) float, one light of zeros for none; LightRow names
    them. layout: a tile's side in texels, the tiles per row, and the metres of depth in the perspective ones.
    luminaires, photometry: the rows and the R32F texture of irrsplat/lighting/luminaire_table.py; None where no light is one.
    """

    depth: moderngl.Texture
    table: np.ndarray
    layout: tuple[float, float, float]
    luminaires: np.ndarray | None = None
    photometry: moderngl.Texture | None = None

    @property
    def uniforms(self) -> Uniforms:
        """The uniforms that shaders/lighting/lights.glsl declares."""
        plain = {"light_table": self.table, "shadow_depth": self.depth, "shadow_layout": self.layout}
        if self.photometry is None:
            return plain
        return {**plain, "luminaire_table": self.luminaires, "photometry": self.photometry}


@dataclass(frozen=True)
class HitLight:
    """What lights the surfaces that a gather sees: the lamps with their shadow maps and, from the second bounce on, the surface
    cache.

    surface: the uniforms of shaders/surface_cache/lookup.glsl; None for one bounce.
    """

    shadows: ShadowMaps
    surface: Uniforms | None = None

    @property
    def uniforms(self) -> Uniforms:
        """The uniforms of both."""
        return {**self.shadows.uniforms, **(self.surface or {})}


@dataclass(frozen=True, eq=False)
class SplatBuffer:
    """The sums that splatting leaves: `sums` RGBA32F (Σ k·E, Σ k) and `weight` RG32F (Σ of raw w, or NOTHING_SEEN; Σ k·Y² of
    the luminances Y of the E, which tells how far the records contradict each other). `luminance_floor`: as in Records.
    pixel_stride: 2 where only every other pixel of the view has a texel here, in both directions, else 1. reach: R32F texture,
    the share of the records' reach that counts at each pixel, 0..1, where a view is refined; None: all of it."""

    sums: moderngl.Texture
    weight: moderngl.Texture
    luminance_floor: float = 0.0
    pixel_stride: int = 1
    reach: moderngl.Texture | None = None


@dataclass(frozen=True)
class Sites:
    """Where records are to be made, numpy float32: `position`, shading `normal` and `geometric` normal, each (N, 3).

    triangle: (N,) the numbers of the triangles that they lie on, where known. frame_rotation: (N,) what the rotations
    of the frames that they look in are drawn from; without it, the records' own numbers. screen: (N,) metres that the image is
    high there, in the view that asks for the record; None, or 0: not known.
    """

    position: np.ndarray
    normal: np.ndarray
    geometric: np.ndarray
    triangle: np.ndarray | None = None
    frame_rotation: np.ndarray | None = None
    screen: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.position)

    @staticmethod
    def joined(parts: Sequence[Sites]) -> Sites:
        """The sites of all parts, which know the same of theirs."""

        def column(name: str) -> Any:
            columns = [getattr(part, name) for part in parts]
            return None if columns[0] is None else np.concatenate(columns)

        return Sites(*(column(one.name) for one in fields(Sites)))

    def frame_rotations(self, numbers: np.ndarray) -> np.ndarray:
        """(N,) what the rotations of the frames are drawn from, for records here that have these `numbers` (N,)."""
        return numbers if self.frame_rotation is None else self.frame_rotation

    def __getitem__(self, rows: slice | np.ndarray) -> Sites:
        columns = (getattr(self, one.name) for one in fields(Sites))
        chosen: list[Any] = [None if column is None else column[rows] for column in columns]
        return Sites(*chosen)


@dataclass(frozen=True)
class LightSamples:
    """The next-event estimation of one kind of light by a batch of records, besides the rays of a gather.

    of: the sampled sources: "emitters", or "virtual lights" (irrsplat/lighting/virtual_lights.py). count: samples of a record.
    rows: (5, N, 4) float32, of the batch's records, as Atlas.frames has them. uniforms: those of
    shaders/gather/light_samples/sum.frag that do not depend on the batch. materials: World.material_defines. free: returns
    which lines from points (N, 3) to others (N, 3), metres, are free; None: the shader traces the lines.
    """

    of: Literal["emitters", "virtual lights"]
    count: int
    rows: np.ndarray
    uniforms: Uniforms
    materials: Mapping[str, int]
    free: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None


@dataclass(frozen=True)
class Atlas:
    """The hemisphere samples of a batch of records: row-major cells of `cell` (width, height) texels, `columns` per row.

    radiance: RGBA32F texture, rgb W/(m² sr), a distance in metres (0 where nothing was hit).
    planes: RGBA32F texture, the plane of what was hit: 1/distance in the unit direction w is xyz·w, 1/m (0 where nothing was).
    table: RGBA32F texture of one cell, xyz direction in the record's frame (tangent, bitangent, normal), w cosθ·dω.
    edges: RGBA32F texture of two texels a texel, see gather.plane.plane_edges.
    frames: RGBA32F texture; texels (i, 0..2) are record i's tangent, bitangent and normal, (i, 3) its geometric normal in
    that frame and, w, its number in the cache; (i, 4) is its eye and, w, the distance of the eyes in a circle about that,
    from which further shadow rays give derivatives, metres.
    count: the number of records. block: the texels that the first reduction step sums at once, as (width, height).
    light_samples: the shadow rays to be added.
    rays: like the table, with the directions of the texels' own rays; None: those of the table.
    sky_share: R32F texture, the share of each texel that sees the sky; None: all of it where nothing was hit.
    """

    radiance: moderngl.Texture
    planes: moderngl.Texture
    table: moderngl.Texture
    edges: moderngl.Texture
    frames: moderngl.Texture
    count: int
    columns: int
    cell: tuple[int, int]
    block: tuple[int, int]
    light_samples: tuple[LightSamples, ...] = ()
    rays: moderngl.Texture | None = None
    sky_share: moderngl.Texture | None = None


@dataclass(frozen=True, eq=False)
class Records:
    """The cache on the GPU: `count` records, record i in texel (i % glsl.TABLE_COLUMNS, i // glsl.TABLE_COLUMNS) of each texture.

    textures: by the names of record_layout.TEXTURES; record_layout.COLUMNS says what they hold. luminance_floor: W/m²; where it
    is darker, errors count as if the luminance were that.
    """

    textures: Mapping[str, moderngl.Texture]
    count: int
    luminance_floor: float = 0.0

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of every texture."""
        width, height = self.textures["position"].size
        return width, height

    @property
    def uniforms(self) -> Uniforms:
        """The uniforms with which shaders/records/record.glsl reads them."""
        samplers = {f"records_{name}": texture for name, texture in self.textures.items()}
        return {**samplers, "luminance_floor": self.luminance_floor}

    def read(self, *names: str) -> dict[str, np.ndarray]:
        """Columns of the records by name, (N, …) float32 each. It waits for the GPU to finish what it is drawing."""
        wanted = {texture for name in names for texture, _ in record_layout.COLUMNS[name].slots}
        texels = {name: np.frombuffer(self.textures[name].read(), "f4") for name in wanted}
        rows = {name: data.reshape(-1, record_layout.TEXTURES[name])[: self.count] for name, data in texels.items()}
        return {name: record_layout.unpack(rows, name) for name in names}
