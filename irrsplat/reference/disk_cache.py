"""The user's cache folder: arrays of expensive computations, stored by a hash of all their inputs."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from irrsplat.core import paths
from irrsplat.core.errors import IrrsplatError
from irrsplat.core.files import DAMAGE, _naming, write_file
from irrsplat.scene.model import Camera, Material, Scene, Texture

Result = TypeVar("Result")


def folder() -> Path:
    """Return the cache folder: IRRSPLAT_CACHE, else the user's cache folder; raises IrrsplatError if there is none."""
    found = paths.cache_folder()
    if found is None:
        raise IrrsplatError("there is no home folder for the references; name a folder in IRRSPLAT_CACHE")
    return found


def key_of(scene: Scene, camera: Camera, *values: ArrayLike) -> str:
    """Return a hash of a scene, a view and further numbers; names do not matter, every bit of a number does."""
    digest = hashlib.sha256()

    def add(*values: ArrayLike) -> None:
        for value in values:
            array = np.asarray(value, np.float64)
            digest.update(f"{array.shape}".encode())
            digest.update((array + 0.0).tobytes())  # −0 is 0

    images: dict[int, bytes] = {}

    def add_texture(texture: Texture | None) -> None:
        add(texture is None)
        if texture is not None:
            pixels = texture.image.pixels
            if id(pixels) not in images:  # many materials may share an image, which may have millions of texels
                images[id(pixels)] = hashlib.sha256(f"{pixels.shape}".encode() + np.ascontiguousarray(pixels).tobytes()).digest()
            digest.update(images[id(pixels)] + f"{texture.wrap}".encode())
            add(texture.uv_set, texture.transform, texture.nearest)

    def add_material(material: Material) -> None:
        for value in (getattr(material, field.name) for field in fields(material)):
            if value is None or isinstance(value, Texture):
                add_texture(value)
            elif isinstance(value, str):
                digest.update(value.encode())
            else:
                add(value)

    add(*values, scene.sky, scene.sky_gradient, scene.up, scene.own_sky, camera.eye, camera.target, camera.up, camera.fov)
    if scene.environment is not None:
        digest.update(scene.environment.digest)
    for mesh in scene.meshes:
        add(mesh.positions, mesh.normals, mesh.faces)
        add(*(() if value is None else value for value in (mesh.colors, mesh.uvs, mesh.opacities)))
        add_material(mesh.material)
    for light in scene.lights:
        add(*(() if value is None else value for value in light.key))
    return digest.hexdigest()[:24]


def read(path: Path) -> dict[str, np.ndarray] | None:
    """Return the arrays in a file by name, None for a missing file; raises one of files.DAMAGE for a damaged one."""
    try:
        with np.load(path, allow_pickle=False) as data:  # zip's check sums detect changed bits
            return {name: data[name] for name in data.files}
    except FileNotFoundError:
        return None


def write(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Store `arrays`, whole or not at all; raises IrrsplatError if that fails."""

    def fill(part: Path) -> None:
        with open(part, "wb") as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]

    with _naming(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, fill)


def kept(name: str, find: Callable[[Path], Result | None], make: Callable[[], Result], notice: Callable[[str], object]) -> Result:
    """Return what `find` reads from the file `name` of the cache folder; else what `make` returns, whose arrays are stored there.

    notice: called with a line if the file is damaged, or cannot be written.
    """
    path = None
    try:
        path = folder() / name
        if (found := find(path)) is not None:
            return found
    except DAMAGE:
        notice(f"{path}: damaged; the reference is computed again")
    except IrrsplatError as error:
        notice(str(error))
    made = make()
    try:
        if path is not None:
            write(path, vars(made))
    except IrrsplatError as error:
        notice(f"{error}; the reference is not kept for the next time")
    return made
