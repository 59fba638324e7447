"""Image-based light of a glTF file's scene (EXT_lights_image_based), as a sky."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from irrsplat.core.color import linear_from_srgb
from irrsplat.core.errors import InputError
from irrsplat.core.words import GREATEST
from irrsplat.scene.io.gltf.document import Damaged, Document, extension, number, numbers
from irrsplat.scene.io.gltf.nodes import default_scene, transforms
from irrsplat.scene.io.images import read_image
from irrsplat.sky.cube import map_of_faces, map_of_harmonics
from irrsplat.sky.environment import Environment
from irrsplat.sky.sky_text import Sky
from irrsplat.sky.split import split

NAME = "EXT_lights_image_based"
_COEFFICIENTS = "irradianceCoefficients"

Encoded = Callable[[object], tuple[bytes, str]]  # bytes and name of the image at an index


def image_based_light(document: Document, world: np.ndarray, encoded: Encoded) -> Sky | None:
    """Return the sky of the default scene; None for none, or for a damaged one, which is recorded.

    Its radiance is that of the sharpest images, W/(m² sr), or without readable images that of the irradiance coefficients.
    world: (3, 3) rows right, up and front of the scene.
    """
    asked = extension(default_scene(document), NAME)
    if asked is None:
        return None
    with document.part("its image-based light"):
        entry = document.entry("lights", asked.get("light"), extension(document.tree, NAME) or {})
        gain = number(entry, "intensity", 1.0)
        if gain < 0.0:
            raise Damaged("its intensity is negative")
        rotation = np.array([numbers(entry, "rotation", (0.0, 0.0, 0.0, 1.0))])
        turn = (
            transforms(np.zeros((1, 3)), rotation, np.ones((1, 3)))[0, :3, :3].T @ world.T
        )  # from the map's directions to the cube's
        try:
            radiance = map_of_faces(_faces(document, entry, encoded), turn)
            said = f"its image-based light uses the sharp images; its {_COEFFICIENTS} and blurred images are ignored"
        except (Damaged, InputError) as error:
            if _COEFFICIENTS not in entry:
                raise
            radiance = map_of_harmonics(_coefficients(entry), turn)
            said = f"the images of its image-based light cannot be read ({error}); its smooth {_COEFFICIENTS} replace them"
        radiance = radiance * np.float32(gain)
        if not (np.isfinite(radiance).all() and radiance.max() <= GREATEST):
            raise Damaged("its radiance exceeds the range of 32-bit floats")
        light, suns = split(radiance)
        return Sky(
            environment=Environment(radiance, light, suns, "the file's image-based light"), notices=(f"{document.path}: {said}",)
        )
    return None


def _faces(document: Document, entry: dict[str, Any], encoded: Encoded) -> np.ndarray:
    """Return (6, N, N, 3) float32 radiance of the sharpest images, sRGB-encoded, divided by alpha in a PNG with alpha (RGBD)."""
    images = next(iter(document.entries("specularImages", entry)), None)
    if not isinstance(images, list) or len(images) != 6:
        raise Damaged("its specularImages are damaged")
    faces: list[np.ndarray] = []
    for index in images:
        pixels = read_image(*encoded(index)).pixels / np.float32(255.0)
        if pixels.shape[0] != pixels.shape[1] or (faces and pixels.shape[0] != len(faces[0])):
            raise Damaged("the faces of its cube are not squares of one size")
        faces.append(linear_from_srgb(pixels[..., :3]) / np.maximum(pixels[..., 3:], np.float32(1.0 / 255.0)))
    return np.stack(faces).astype(np.float32)


def _coefficients(entry: dict[str, Any]) -> np.ndarray:
    """Return (9, 3) coefficients of irradiance."""
    rows = entry[_COEFFICIENTS]
    if not isinstance(rows, list) or len(rows) != 9:
        raise Damaged(f"its {_COEFFICIENTS} are damaged")
    return np.array([numbers({_COEFFICIENTS: row}, _COEFFICIENTS, (0.0, 0.0, 0.0)) for row in rows])
