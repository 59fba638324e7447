"""The user's cache folder: arrays that took long to make, kept by a hash of all that they depend on."""

from __future__ import annotations

import hashlib
import os
import secrets
import zipfile
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from irrsplat.core import paths
from irrsplat.core.errors import IrrsplatError
from irrsplat.scene.model import Camera, Material, Scene

# what reading a damaged file raises
DAMAGE = (OSError, ValueError, KeyError, EOFError, TypeError, NotImplementedError, zipfile.BadZipFile, zlib.error)


def folder() -> Path:
    """Where things are kept: what IRRSPLAT_CACHE names, else the user's cache folder; IrrsplatError where none is."""
    found = paths.cache_folder()
    if found is None:
        raise IrrsplatError("there is no home folder to keep the truth in; name a folder in IRRSPLAT_CACHE")
    return found


def key_of(scene: Scene, camera: Camera, *values: ArrayLike) -> str:
    """A hash of a scene, a view and numbers beside them; names do not count, every bit of a number does."""
    digest = hashlib.sha256()

    def add(*values: ArrayLike) -> None:
        for value in values:
            array = np.asarray(value, np.float64)
            digest.update(f"{array.shape}".encode())
            digest.update((array + 0.0).tobytes())  # −0 is 0

    def add_material(material: Material) -> None:
        digest.update(f"{material.alpha_mode}".encode())
        add(material.normal_scale, material.opacity, material.alpha_cutoff, material.transmission, material.double_sided)
        for texture in (material.albedo_texture, material.emission_texture, material.normal_texture):
            if texture is None:
                add(())
            else:
                digest.update(f"{texture.image.pixels.shape}{texture.wrap}".encode())
                digest.update(np.ascontiguousarray(texture.image.pixels).tobytes())
                add(texture.uv_set, texture.transform, texture.nearest)

    add(*values, scene.sky, scene.sky_gradient, scene.up, camera.eye, camera.target, camera.up, camera.fov)
    for mesh in scene.meshes:
        add(mesh.positions, mesh.normals, mesh.faces, mesh.material.emission)
        add(mesh.material.albedo if mesh.colors is None else mesh.colors)
        add(*(() if value is None else value for value in (mesh.uvs, mesh.opacities)))
        add_material(mesh.material)
    for light in scene.lights:
        add(*(() if value is None else value for name, value in vars(light).items() if name != "name"))
    return digest.hexdigest()[:24]


def read(path: Path) -> dict[str, np.ndarray] | None:
    """The arrays in a file by name, None where there is no file; raises one of DAMAGE for a damaged one."""
    try:
        with np.load(path, allow_pickle=False) as data:  # zip's check sums tell of every bit that has changed
            return {name: data[name] for name in data.files}
    except FileNotFoundError:
        return None


def write(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Keep `arrays`, whole or not at all; raises OSError where that fails."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}-{secrets.token_hex(6)}.part")
    try:
        with open(part, "xb") as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
