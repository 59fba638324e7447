"""The light that stands in where a file has none of its own, and how it is told whether it has."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from irrsplat.core.color import LUMINANCE, linear_from_srgb
from irrsplat.core.vectors import triangle_areas
from irrsplat.scene.model import Camera, Image, Light, Mesh, Scene
from irrsplat.scene.stand_ins.surroundings import Surroundings

Vector = tuple[float, float, float]
Enclosure = Literal["none", "half", "closed"]
SKY: Vector = (1.0, 1.0, 1.0)  # mean radiance, W/(m² sr)
GRADIENT: Vector = (0.6, 0.6, 0.6)  # straight up it is four times as bright as straight down
KEY: Vector = (1.5, 1.5, 1.5)  # of the key; it lights what faces it with π times as much
FILL = 0.3  # of what falls on a surface that faces a lone sun: what the sky beside it brings, about as much as on a clear day
_KEY = np.array([-0.55, 0.75, 0.5])  # where from: the camera's right, up and back
# Shares of the power that the sky would bring to the whole: emission of less does not light a scene. Before a thing that glows a
# little the sky still stands; into a room that lacks a wall, or has windows, little of it comes, into a closed one nothing.
_MINOR: dict[Enclosure, float] = {"none": 0.25, "half": 0.01, "closed": 0.002}
_BLANK = 1e-6  # the same, of all lamps together: they are switched off
_MEAN = 256  # texels a side, about, that a texture's mean is made of


def stand_in(camera: Camera, up: np.ndarray, around: Surroundings | None) -> Light:
    """The light 'key': sun-like, from the upper left behind the camera, on what faces it half as strong again as the sky; where a
    room is closed, of which `around` is what the camera sees, a lamp above the camera."""
    right, back = camera.axes[0], np.cross(camera.axes[0], up)
    if around is None:
        x, y, z = (_KEY @ np.stack([right, up, back])).tolist()
        return Light((x, y, z), KEY, directional=True, name="key")
    distance = np.where(np.isfinite(around.distance), around.distance, np.nan)
    above = float(np.nanmedian(distance[-3:])) if np.isfinite(distance[-3:]).any() else float(np.nanmedian(distance))
    x, y, z = (np.asarray(camera.eye) + 0.6 * above * up).tolist()
    power = math.pi * float(np.nanmedian(distance)) ** 2  # E of π at the usual distance
    return Light((x, y, z), (power * SKY[0], power * SKY[1], power * SKY[2]), physical=True, name="key")


def lit_by(scene: Scene, enclosure: Enclosure) -> Literal["nothing", "sun", "own"]:
    """What light that counts the scene has: "nothing", a "sun" (directional light alone), or its "own" in any other way.

    Lamps count unless they are all but off, and emission does where its power is more than a small share of what the stand-in sky
    would bring to the bounding sphere: 4π²·L·R² W. enclosure: whether it is a room.
    """
    radius = 0.5 * scene.diagonal
    sky = 4.0 * math.pi**2 * radius**2 * _luminance(SKY)
    suns, lamps = (
        sum(_lamp_power(light, radius) for light in scene.lights if light.directional == directional)
        for directional in (True, False)
    )
    if sum(map(_emitted_power, scene.meshes)) > _MINOR[enclosure] * sky or lamps > _BLANK * sky:
        return "own"
    return "sun" if suns + lamps > _BLANK * sky else "nothing"


def fill(scene: Scene) -> tuple[Vector, Vector]:
    """The sky beside a lone sun, (sky, sky_gradient): grey, and as bright to the sun as FILL says."""
    share = FILL * sum(_luminance(light.color) for light in scene.lights if light.directional)
    (r, g, b), (x, y, z) = SKY, GRADIENT
    return (share * r, share * g, share * b), (share * x, share * y, share * z)


def _lamp_power(light: Light, radius: float) -> float:
    """About W, of a directional light what it brings to a sphere of `radius` metres."""
    luminance = _luminance(light.color)
    return math.pi * luminance * (math.pi * radius**2 if light.directional else 4.0)


def _emitted_power(mesh: Mesh) -> float:
    """W by both sides of a mesh, a texture and the colours of vertices by their means."""
    material = mesh.material
    if not any(material.emission):
        return 0.0
    texture = material.emission_texture
    colour = np.asarray(material.emission) * (1.0 if texture is None else mean_of(texture.image))
    if material.unlit and mesh.colors is not None and len(mesh.colors):
        colour = colour * mesh.colors.mean(axis=0)
    area = float(triangle_areas(mesh.positions[mesh.faces].astype(float)).sum())
    return 2.0 * math.pi * area * _luminance(colour)


def mean_of(image: Image) -> np.ndarray:
    """(3,) the mean colour of an image in linear light, from some of its texels."""
    step = max(1, max(image.pixels.shape[:2]) // _MEAN)
    mean: np.ndarray = linear_from_srgb(image.pixels[::step, ::step, :3] / 255.0).mean((0, 1))
    return mean


def _luminance(colour: Vector | np.ndarray) -> float:
    return float(np.asarray(colour, float) @ LUMINANCE)
