"""Skies from arrays and formulas, their files, and reference sums over the sphere."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from irrsplat.scene.model import Scene, sun_lights
from irrsplat.sky.cie import CieSky
from irrsplat.sky.environment import Environment, frame_of
from irrsplat.sky.sphere import solid_angles, texel_directions
from irrsplat.sky.split import split


def mapped(scene: Scene, radiance: np.ndarray, turn: float = 0.0) -> Scene:
    """Return the scene under an equirectangular map (H, W, 3), as from a file; up is y."""
    light, suns = split(radiance.astype("f4"))
    return _under(scene, Environment(radiance.astype("f4"), light, suns), turn)


def cie(scene: Scene, sky: CieSky) -> Scene:
    """Return the scene under a CIE sky; up is y."""
    return _under(scene, sky.environment("CIE"))


def _under(scene: Scene, sky: Environment, turn: float = 0.0) -> Scene:
    """Return the scene under a sky, whose suns are added to the lights. turn: degrees of its north."""
    environment = replace(sky, frame=frame_of(np.eye(3), turn))
    return replace(scene, environment=environment, lights=(*scene.lights, *sun_lights(environment)))


def without_lights(scene: Scene) -> Scene:
    """Return the scene without lights and suns."""
    return replace(scene, lights=())


def irradiance(radiance: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return E = Σ L·max(n·ω, 0)·dω (N, 3) of an equirectangular map (H, W, 3) on planes of unit normals (N, 3)."""
    height, width = radiance.shape[:2]
    weight = radiance * solid_angles(height, width)[:, None, None]
    ways = texel_directions(height, width)
    return np.stack([np.einsum("ij,ijc->c", np.maximum(ways @ n, 0.0), weight, dtype=float) for n in np.atleast_2d(normal)])


def save_exr(path: Path, radiance: np.ndarray, names: str = "RGB") -> Path:
    """Write (H, W, C) as an EXR with these channels."""
    import OpenEXR

    channels = {name: OpenEXR.Channel(np.ascontiguousarray(radiance[..., i], "f4")) for i, name in enumerate(names)}
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(path))
    return path
