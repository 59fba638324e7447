"""Stand-in light for files without light, and the test whether they have any."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from irrsplat.core.color import LUMINANCE, linear_from_srgb
from irrsplat.core.vectors import Vector, vector
from irrsplat.scene.model import Camera, Light, Mesh, Scene
from irrsplat.scene.stand_ins.surroundings import Surroundings

Enclosure = Literal["none", "half", "closed"]
SKY: Vector = (1.0, 1.0, 1.0)  # mean radiance, W/(m² sr)
GRADIENT: Vector = (0.6, 0.6, 0.6)  # the zenith is four times as bright as the nadir
KEY: Vector = (1.5, 1.5, 1.5)  # of the key light; perpendicular irradiance is π times as much
FILL = 0.3  # irradiance by the sky, relative to that of a lone sun; about a clear sky's share
_KEY_DIRECTION = np.array([-0.55, 0.75, 0.5])  # direction of the key light: the camera's right, up and back
# Shares of the default sky's power below which emission does not light a scene. The sky still adds to a faintly glowing object;
# little of it enters a room that lacks a wall or has windows, and none a closed room.
_MINOR_SHARE: dict[Enclosure, float] = {"none": 0.25, "half": 0.01, "closed": 0.002}
_OFF_SHARE = 1e-6  # the same share, of all lights together, below which they count as switched off
_MEAN_TEXELS = 256  # texels a side, about, of a texture's mean


def stand_in(camera: Camera, up: np.ndarray, around: Surroundings | None) -> Light:
    """Return the light 'key': directional, from the upper left behind the camera, half as bright again as the sky.

    In a closed room, where `around` is the surroundings of the camera, it is a point light above the camera.
    """
    right, back = camera.axes[0], np.cross(camera.axes[0], up)
    if around is None:
        return Light(vector(_KEY_DIRECTION @ np.stack([right, up, back])), KEY, directional=True, name="key")
    distance = np.where(np.isfinite(around.distance), around.distance, np.nan)
    above = float(np.nanmedian(distance[-3:])) if np.isfinite(distance[-3:]).any() else float(np.nanmedian(distance))
    place = vector(np.asarray(camera.eye) + 0.6 * above * up)
    power = math.pi * float(np.nanmedian(distance)) ** 2  # E of π at the median distance
    return Light(place, vector(power * np.asarray(SKY)), physical=True, name="key")


def own_light(scene: Scene, enclosure: Enclosure) -> Literal["nothing", "sun", "own"]:
    """Return the kind of the scene's own light: "nothing", "sun" (directional light only), or "own" (any other).

    Lights count unless they are almost off. Emission counts if its power exceeds a small share of the power of the default sky
    on the bounding sphere: 4π²·L·R² W. enclosure: how far it is a room.
    """
    radius = 0.5 * scene.diagonal
    sky = 4.0 * math.pi**2 * radius**2 * _luminance(SKY)
    suns, points = (
        sum(_light_power(light, radius) for light in scene.lights if light.directional == directional)
        for directional in (True, False)
    )
    if sum(map(_emitted_power, scene.meshes)) > _MINOR_SHARE[enclosure] * sky or points > _OFF_SHARE * sky:
        return "own"
    return "sun" if suns + points > _OFF_SHARE * sky else "nothing"


def fill_sky(scene: Scene) -> tuple[Vector, Vector]:
    """Return the sky next to a lone sun, (sky, sky_gradient): grey, with FILL times its irradiance."""
    share = FILL * sum(_luminance(light.color) for light in scene.lights if light.directional)
    return vector(share * np.asarray(SKY)), vector(share * np.asarray(GRADIENT))


def _light_power(light: Light, radius: float) -> float:
    """Return the power in W, about; of a directional light the power on a sphere of `radius` metres."""
    luminance = _luminance(light.color)
    return math.pi * luminance * (math.pi * radius**2 if light.directional else 4.0)


def _emitted_power(mesh: Mesh) -> float:
    """Return the power in W that both sides of a mesh emit, with the mean of texture and vertex colours."""
    material = mesh.material
    if not any(material.emission):
        return 0.0
    texture, colour = material.emission_texture, np.asarray(material.emission)
    if texture is not None:
        pixels = texture.image.pixels
        step = max(1, max(pixels.shape[:2]) // _MEAN_TEXELS)
        colour = colour * linear_from_srgb(pixels[::step, ::step, :3] / 255.0).mean((0, 1))
    if material.unlit and mesh.colors is not None and len(mesh.colors):
        colour = colour * mesh.colors.mean(axis=0)
    return 2.0 * math.pi * mesh.area * _luminance(colour)


def _luminance(colour: Vector | np.ndarray) -> float:
    return float(np.asarray(colour, float) @ LUMINANCE)
