"""What flows between the stages: one table of the image channels, and the frozen bundles of GPU handles.

EXR layers, NPZ keys, overlays and the documentation are made from `CHANNELS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple


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
        Channel("image", 3, "W/(m² sr)", "radiance", "blended direct + indirect, plus emission and sky, before exposure"),
        Channel("direct", 3, "W/(m² sr)", "radiance", "direct outgoing radiance from the scene's lights, ρ/π·E_direct"),
        Channel("indirect", 3, "W/(m² sr)", "radiance", "indirect outgoing radiance, ρ/π·E"),
        Channel("irradiance", 3, "W/m²", "radiance", "interpolated indirect irradiance E at the pixel"),
        Channel("emission", 3, "W/(m² sr)", "radiance", "emitted radiance of the surface, or the sky's"),
        Channel("weight", 1, "1", "heat", "Σ of raw w over the records that speak for the pixel"),
        Channel("position", 3, "m", "range", "world space, at the pixel's centre"),
        Channel("normal", 3, "1", "signed", "world space shading normal, turned to the camera"),
        Channel("albedo", 3, "1", "unit", "diffuse reflectance ρ, linear"),
        Channel("depth", 1, "m", "heat", "distance along the view axis; +inf where the camera sees nothing"),
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

    @property
    def defines(self) -> dict[str, float]:
        """FILMIC_A … FILMIC_SCALE, as the shaders have them."""
        return {f"FILMIC_{name.upper()}": value for name, value in self._asdict().items()}


FILMIC = Filmic()


@dataclass(frozen=True)
class GBuffer:
    """What the eye sees, as RGBA32F textures of one size, bottom row first.

    position: xyz world space at the pixel's centre, w depth along the view axis (0 where nothing is seen).
    normal: xyz shading normal turned to the camera, w unused. geometric: xyz the triangle's own normal, likewise.
    albedo: rgb reflectance. emission: rgb emitted radiance.
    """

    position: Any
    normal: Any
    geometric: Any
    albedo: Any
    emission: Any


@dataclass(frozen=True)
class ShadowMaps:
    """Every light's depth tiles in one texture, and the table that finds them.

    depth: one DEPTH texture of tiles. table: RGBA32F texture of rows that shaders/lib/lights.glsl reads.
    count: the number of lights.
    """

    depth: Any
    table: Any
    count: int


@dataclass(frozen=True)
class SplatBuffer:
    """The sums that splatting leaves: `sums` RGBA32F (Σ k·E, Σ k) and `weight` R32F (Σ of raw w)."""

    sums: Any
    weight: Any
