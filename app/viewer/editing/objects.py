"""Meshes and lights in the editor: names, places on the screen, changes, and units of lighting design."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from irrsplat.app.viewer.view_options import Point
from irrsplat.core.color import LUMINANCE, photometric
from irrsplat.core.vectors import box, vector
from irrsplat.scene.appearance import order
from irrsplat.scene.model import Camera, Light, Mesh, Scene
from irrsplat.sky.cie import of_chromaticity


def object_name(scene: Scene, number: int) -> str:
    return scene.meshes[number].name or f"mesh {number + 1}"


def bounds_of(mesh: Mesh) -> np.ndarray:
    """Return (2, 3) float64 the ends of a mesh's bounding box; 0 0 0 for a mesh without points."""
    return box(mesh.positions).astype(float) if len(mesh.positions) else np.zeros((2, 3))


def meshes_of(scene: Scene, triangles: np.ndarray) -> np.ndarray:
    """Return (N,) the number of the mesh of each triangle, -1 for none. triangles: (N,) numbers in the order of drawing."""
    numbers = np.array([*order(scene), -1])
    ends = np.cumsum([len(scene.meshes[i].faces) for i in numbers[:-1]])
    return np.where(triangles < 0, -1, numbers[np.searchsorted(ends, triangles, side="right")])


def on_screen(camera: Camera, size: tuple[float, float], point: tuple[float, float, float]) -> tuple[float, float] | None:
    """Return the place of a world point in a picture of `size` (width, height), from the upper left; None behind the eye."""
    x, y, z = camera.axes @ (np.asarray(point) - np.asarray(camera.eye))
    if z >= 0.0:
        return None
    per_metre = size[1] / camera.screen / -z
    return 0.5 * size[0] + x * per_metre, 0.5 * size[1] - y * per_metre


def pixel_of(camera: Camera, size: tuple[int, int], point: tuple[float, float, float]) -> tuple[int, int] | None:
    """Return the pixel of a picture that contains a world point; None for a point outside of the picture."""
    x, y = on_screen(camera, size, point) or (-1.0, -1.0)
    return (int(x), int(y)) if 0.0 <= x < size[0] and 0.0 <= y < size[1] else None


COLDEST, HOTTEST = 1700.0, 12_000.0  # kelvin: the range of the slider


def blackbody(kelvin: float | np.ndarray) -> np.ndarray:
    """Return (..., 3) the linear Rec. 709 colours of black bodies, with luminance 1.

    The chromaticities are Krystek's ("An algorithm to calculate correlated colour temperature", 1985), for 1000 to 15 000 K.
    Below about 1900 K the colour is outside of the Rec. 709 gamut. Its negative components then become 0.
    """
    T = np.asarray(kelvin, float)
    u = (0.860117757 + 1.54118254e-4 * T + 1.28641212e-7 * T**2) / (1.0 + 8.42420235e-4 * T + 7.08145163e-7 * T**2)
    v = (0.317398726 + 4.22806245e-5 * T + 4.20481691e-8 * T**2) / (1.0 - 2.89741816e-5 * T + 1.61456053e-7 * T**2)
    return of_chromaticity(3.0 * u / (2.0 * u - 8.0 * v + 4.0), 2.0 * v / (2.0 * u - 8.0 * v + 4.0))


_BLACKBODIES = blackbody(np.arange(COLDEST, HOTTEST + 1.0))  # (N, 3) the colours of all whole kelvins of the slider


@lru_cache  # the interface calls it several times in every frame
def kelvin_of(color: Point) -> float:
    """Return the temperature of the black body whose colour is nearest to a light's colour."""
    off = np.abs(_BLACKBODIES - np.asarray(color) / (float(LUMINANCE @ color) or 1.0)).max(axis=1)
    return COLDEST + int(off.argmin())


def heated(light: Light, kelvin: float) -> Light:
    """Return the light in the colour of a black body, with unchanged luminance."""
    return replace(light, color=vector(blackbody(kelvin) * float(LUMINANCE @ np.asarray(light.color))))


def light_name(light: Light, number: int) -> str:
    return light.name or f"light {number + 1}"


WORDS = {  # by unit: the quantity, and its radiometric unit
    "lumen": ("luminous flux", "W"),
    "candela": ("luminous intensity; of a spot on its axis, of a luminaire the greatest", "W/sr"),
    "lux": ("illuminance of a surface that faces the light", "W/m²"),
    "lux at 1 m": ("illuminance at 1 m, as the light falls off by OpenGL's attenuation", "W/m²"),
    "cd/m²": ("emitted luminance", "W/(m² sr)"),
    "lumen per side": ("luminous flux from each side of the surface", "W"),
}


def light_units(light: Light) -> dict[str, float]:
    """Return the output of a light in the units of its kind."""
    shine = float(photometric(np.asarray(light.color, float)))
    if light.photometry is not None:
        return dict(zip(("lumen", "candela"), light.output, strict=True))
    if light.directional:
        return {"lux": light.strength(1.0) * shine}
    constant, linear, quadratic = light.attenuation
    if not light.physical and (constant or linear):
        return {"lux at 1 m": light.strength(1.0) * shine}
    candela = shine if light.physical else math.pi * shine / quadratic
    return {"candela": candela} if light.has_cone else {"lumen": 4.0 * math.pi * candela, "candela": candela}


def surface_units(mesh: Mesh, emission: tuple[float, float, float]) -> dict[str, float]:
    """Return the output of a surface with emitted radiance `emission` in W/(m² sr)."""
    luminance = float(photometric(np.asarray(emission, float)))
    return {"cd/m²": luminance, "lumen per side": math.pi * mesh.area * luminance}
