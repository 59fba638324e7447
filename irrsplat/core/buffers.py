"""Data between the stages: the table of image channels, and frozen bundles of GPU handles.

EXR layers, NPZ keys, overlays and the documentation are made from `CHANNELS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from irrsplat.core import record_layout

if TYPE_CHECKING:
    import moderngl


# GLSL uniforms by name: numbers, tuples, arrays and textures. Each draw checks that all uniforms of its shaders are given, and no
# other.
Uniforms = dict[str, Any]


@dataclass(frozen=True)
class Channel:
    """One image buffer: its name, number of components, unit, display and meaning."""

    name: str
    components: int  # 1: H W, 3: H W 3
    unit: str
    show: str  # "radiance" (exposed, tone-mapped), "unit" (0..1), "signed" (-1..1), "range" (bounds), "heat" (colour map)
    help: str


CHANNELS: dict[str, Channel] = {
    c.name: c
    for c in (
        Channel("image", 3, "W/(m² sr)", "radiance", "direct and indirect light, emission and background, before exposure"),
        Channel("direct", 3, "W/(m² sr)", "radiance", "direct outgoing radiance from the scene's lights, ρ/π·E_direct"),
        Channel("indirect", 3, "W/(m² sr)", "radiance", "indirect outgoing radiance, ρ/π·E"),
        Channel("irradiance", 3, "W/m²", "radiance", "indirect irradiance E, including light from emissive surfaces"),
        Channel("emission", 3, "W/(m² sr)", "radiance", "emitted radiance of the surface, or radiance of the visible sky"),
        Channel("weight", 1, "1", "heat", "Σw of the records that cover the pixel"),
        Channel("position", 3, "m", "range", "position of the surface at the centre of the pixel, world space"),
        Channel("normal", 3, "1", "signed", "shading normal with normal map, turned to the camera, world space"),
        Channel("smooth_normal", 3, "1", "signed", "shading normal without normal map"),
        Channel("albedo", 3, "1", "unit", "diffuse reflectance ρ, linear"),
        Channel("opacity", 1, "1", "unit", "opacity of the nearest surface; below 1 it tints the surfaces behind"),
        Channel("depth", 1, "m", "heat", "distance along the view axis; +inf without a surface"),
        Channel("alpha", 1, "1", "unit", "share of the pixel with a visible surface, 0..1"),
    )
}


class Filmic(NamedTuple):
    """Hable's filmic curve (2010, "Filmic Tonemapping Operators"): f(scale·x)/f(white), per channel, clipped to 0..1.

    f(x) = (x(ax + cb) + de)/(x(ax + b) + df) − e/f. `scale` keeps mid grey 0.18 at 0.18 before sRGB; radiance 9.1 is white.
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


NOTHING_SEEN = 1e30  # splat buffer's weight of pixels without a surface, which request no record


@dataclass(frozen=True, eq=False)
class Filters:
    """Filters in front of the g-buffer's surfaces, which let most light pass, as float textures of its size.

    tint: rgb transmittance, 1 without a filter. opacity: of the nearest filter, 0 without one. glow: rgb radiance of the filters;
    None if no filter of the scene emits.
    """

    tint: moderngl.Texture
    opacity: moderngl.Texture
    glow: moderngl.Texture | None = None


@dataclass(frozen=True, eq=False)
class GBuffer:
    """The visible surfaces, as RGBA32F textures of one size, bottom row first.

    position: xyz world space at the pixel's centre, w depth along the view axis (0 without a surface). normal: xyz shading normal
    turned to the camera, w the geometric normal's octahedral x. albedo: rgb reflectance, w the geometric normal's octahedral y.
    emission: rgb emitted radiance, w the triangle's number. mapped_normal: xyz shading normal with normal map; None if no surface
    has a map. filters: None if the scene has none. emissive: True if a surface of the scene emits; else `emission` is black.
    corner: position of the first pixel in the whole picture.
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
        """Normal for direct light: `mapped_normal`, or `normal` without maps. Records use `normal` only."""
        return self.mapped_normal or self.normal

    @property
    def surface_uniforms(self) -> Uniforms:
        """Uniforms `position` and `normal`."""
        return {"position": self.position, "normal": self.normal}

    @property
    def material_uniforms(self) -> Uniforms:
        """Uniforms of shaders/image/gbuffer_material.glsl."""
        return {"albedo": self.albedo, "emission": self.emission}


class LightRow(IntEnum):
    """Rows of a light in the light table, in shaders/lighting/lights.glsl as LIGHT_POSITION and so on."""

    POSITION = 0  # xyz position, or the unit direction towards a directional light; w: 1 if directional
    COLOR = 1  # rgb: E = rgb·cosθ·spot/(k·(1, d, d²)); w: 6 for the tiles of a cube, else 1
    FALLOFF = 2  # xyz: k, constant, linear and quadratic; w: spot exponent. A directional light has the middle of its
    # cascades, right and up in its first tile, and their number
    SPOT = 3  # xyz: unit axis of the cone, from the light; w: 1 if there is a cone
    CONE = 4  # x: cutoff, y: inner, half angles in radians (a directional light's x: its tile's depth in metres);
    # z: number of its first tile; w: scale of the tiles' right and up
    TILE = 5  # of a single tile, or of a directional light's first one, three rows right·scale, up·scale, forward: each dotted
    # with (p, 1)


LIGHT_ROWS = LightRow.TILE + 3  # of a light in the table
LUMINAIRE_ROWS = 3  # of a light in the table of luminaires, see irrsplat/lighting/luminaire_table.py


class MaterialRow(IntEnum):
    """Rows of a material in the material table, in shaders as MATERIAL_EMISSION and so on."""

    EMISSION = 0  # rgb emitted radiance before its texture; w: least opacity for light (light_cutoff)
    # Three rows per texture. Rows 1 and 2: xyz dotted with (u, v, 1) gives image coordinates; w: its layer (-1: none), and the
    # wrap along u + 3 times the wrap along v (0 repeat, 1 mirror, 2 clamp) + 9 for the second set of u and v. Row 3 without a
    # layer: the texture's mean (1 without a texture), colours times alpha, and alpha. Row 3 with a layer of cut-outs: least alpha
    # for light by the material's own opacity, and 1 if the layer is dithered.
    ALBEDO_TEXTURE = 1
    EMISSION_TEXTURE = 4


MATERIAL_ROWS = MaterialRow.EMISSION_TEXTURE + 3


@dataclass(frozen=True, eq=False)
class ShadowMaps:
    """Every light's depth tiles in one texture, and their table (both for shaders/lighting/lights.glsl).

    depth: depth texture of all tiles. table: (LIGHT_ROWS·lights, 4) float, one light of zeros for none; rows by LightRow. layout:
    a tile's side in texels, tiles per row, and metres of depth in perspective tiles. luminaires, photometry: rows and R32F
    texture of irrsplat/lighting/luminaire_table.py; None without luminaires.
    """

    depth: moderngl.Texture
    table: np.ndarray
    layout: tuple[float, float, float]
    luminaires: np.ndarray | None = None
    photometry: moderngl.Texture | None = None

    @property
    def uniforms(self) -> Uniforms:
        """Uniforms of shaders/lighting/lights.glsl."""
        plain = {"light_table": self.table, "shadow_depth": self.depth, "shadow_layout": self.layout}
        if self.photometry is None:
            return plain
        return {**plain, "luminaire_table": self.luminaires, "photometry": self.photometry}


@dataclass(frozen=True)
class HitLight:
    """The light on surfaces hit by a gather: lights with shadow maps and, from the second bounce on, the surface cache.

    surface: uniforms of shaders/surface_cache/lookup.glsl; None for one bounce. virtual: False leaves virtual point lights out.
    """

    shadows: ShadowMaps
    surface: Uniforms | None = None
    virtual: bool = True

    @property
    def uniforms(self) -> Uniforms:
        """Uniforms of both."""
        return {**self.shadows.uniforms, **(self.surface or {})}


@dataclass(frozen=True, eq=False)
class SplatBuffer:
    """The sums of splatting.

    `sums` RGBA32F (Σ k·E, Σ k). `weight` RG32F (Σ of raw w, or NOTHING_SEEN; Σ k·(Y² - σ²) of the luminances Y of E and
    their noise σ, for the inter-record variance). `luminance_floor`: as in Records. pixel_stride: 2 if only every other pixel
    of the view has a texel, in both directions, else 1. reach: R32F texture, relative radius of the records at each pixel,
    0..1, in a refined view; None: 1.
    """

    sums: moderngl.Texture
    weight: moderngl.Texture
    luminance_floor: float = 0.0
    pixel_stride: int = 1
    reach: moderngl.Texture | None = None


@dataclass(frozen=True)
class Sites:
    """Sites of new records, numpy float32: `position`, shading `normal` and `geometric` normal, each (N, 3).

    triangle: (N,) numbers of their triangles, if known. frame_rotation: (N,) seeds of the rotations of the hemisphere frames; by
    default the records' numbers. screen: (N,) height of the image in metres at the site, in the requesting view; None, or 0:
    unknown. radius: (N,) metres, the greatest radii of records at small features; None: without such a limit.
    """

    position: np.ndarray
    normal: np.ndarray
    geometric: np.ndarray
    triangle: np.ndarray | None = None
    frame_rotation: np.ndarray | None = None
    screen: np.ndarray | None = None
    radius: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.position)

    @staticmethod
    def joined(parts: Sequence[Sites]) -> Sites:
        """Return the sites of all parts, which have the same optional columns."""

        def column(name: str) -> Any:
            columns = [getattr(part, name) for part in parts]
            return None if columns[0] is None else np.concatenate(columns)

        return Sites(*(column(one.name) for one in fields(Sites)))

    @property
    def screen_heights(self) -> np.ndarray:
        """(N,) `screen`, 0 where it is unknown."""
        return np.zeros(len(self)) if self.screen is None else self.screen

    def frame_rotations(self, numbers: np.ndarray) -> np.ndarray:
        """Return (N,) seeds of the frames' rotations, for records with these `numbers` (N,)."""
        return numbers if self.frame_rotation is None else self.frame_rotation

    def __getitem__(self, rows: slice | np.ndarray) -> Sites:
        columns = (getattr(self, one.name) for one in fields(Sites))
        chosen: list[Any] = [None if column is None else column[rows] for column in columns]
        return Sites(*chosen)


@dataclass(frozen=True)
class LightSamples:
    """The next-event estimation of one kind of light by a batch of records, in addition to the hemisphere samples.

    virtual: True for virtual point lights (irrsplat/lighting/virtual_lights.py), False for emitters. count: samples per record.
    rows: (5, N, 4) float32, of the batch's records, as in Atlas.frames. uniforms: of shaders/gather/light_samples/sum.frag,
    independent of the batch. materials: World.material_defines. free: returns (N,) visibility between points (N, 3) and others
    (N, 3), metres; None: the shader traces the rays.
    """

    virtual: bool
    count: int
    rows: np.ndarray
    uniforms: Uniforms
    materials: Mapping[str, int]
    free: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None


@dataclass(frozen=True)
class Atlas:
    """The hemisphere samples of a batch of records: row-major cells of `cell` (width, height) texels, `columns` per row.

    radiance: RGBA32F texture, rgb W/(m² sr), a distance in metres (0 without a hit). planes: RGBA32F texture, plane of the
    hit: 1/distance in the unit direction w is xyz·w, 1/m (0 without a hit); w: see shaders/gather/close_hits.glsl. table:
    RGBA32F texture of one cell, xyz direction in the record's frame (tangent, bitangent, normal), w cosθ·dω. edges: RGBA32F
    texture of two texels per texel, see gather.plane.plane_edges. frames: RGBA32F texture; texels (i, 0..2) are record i's
    tangent, bitangent and normal; w of the normal is its triangle (-1: unknown). (i, 3) is its geometric normal in that frame
    and, w, its number in the cache. Texel (i, 4) is its eye and, w, the radius in metres of the circle of eyes around it,
    from which further shadow rays give derivatives. count: number of records. block: texels summed at once by the first
    reduction step, as (width, height). light_samples: shadow rays to be added. rays: directions of the texels' own rays, in
    the layout of the table; None: the table's. sky_share: R32F texture, visible share of the sky per texel; None: 1 without a
    hit. close_light: uniforms of shaders/gather/reduce_total.frag for light at close hits; None: the surface cache lights them.
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
    close_light: Uniforms | None = None


@dataclass(frozen=True, eq=False)
class Records:
    """The cache on the GPU: `count` records, record i in texel (i % glsl.TABLE_COLUMNS, i // glsl.TABLE_COLUMNS) of each texture.

    textures: by the names of record_layout.TEXTURES; record_layout.COLUMNS has their contents. luminance_floor: W/m²; errors are
    relative to at least this luminance.
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
        """Uniforms of shaders/records/record.glsl."""
        samplers = {f"records_{name}": texture for name, texture in self.textures.items()}
        return {**samplers, "luminance_floor": self.luminance_floor}

    def read(self, *names: str) -> dict[str, np.ndarray]:
        """Return columns of the records by name, (N, …) float32 each, after waiting for the GPU."""
        requested = {texture for name in names for texture, _ in record_layout.COLUMNS[name].slots}
        texels = {name: np.frombuffer(self.textures[name].read(), "f4") for name in requested}
        rows = {name: data.reshape(-1, record_layout.TEXTURES[name])[: self.count] for name, data in texels.items()}
        return {name: record_layout.unpack(rows, name) for name in names}
