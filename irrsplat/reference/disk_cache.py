"""The user's cache folder: arrays of expensive computations, stored by a hash of all their inputs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from irrsplat.core import paths
from irrsplat.core.errors import IrrsplatError
from irrsplat.core.files import DAMAGE, _naming, write_arrays
from irrsplat.records.scene_stamp import hashed, stamp, texture_parts
from irrsplat.scene.model import Camera, Scene

Result = TypeVar("Result")


def folder() -> Path:
    """Return the cache folder: IRRSPLAT_CACHE, else the user's cache folder; raises IrrsplatError if there is none."""
    found = paths.user_folder("cache")
    if found is None:
        raise IrrsplatError("there is no home folder for the references; name a folder in IRRSPLAT_CACHE")
    return found


def key_of(scene: Scene, camera: Camera, *values: ArrayLike) -> str:
    """Return a hash of a scene, a view and further numbers; names do not matter, every bit of a number does."""
    numbers = (*values, scene.up, scene.own_sky, camera.eye, camera.target, camera.up, camera.fov)
    lights = [light.key for light in scene.lights]
    # a stamp leaves out normal maps
    maps = {one: hashed(repr(one.normal_scale).encode(), *texture_parts(one.normal_texture)) for one in scene.materials}
    bends = [maps[mesh.material] for mesh in scene.meshes]
    exact = [(np.asarray(value, float) + 0.0).tolist() for value in numbers]  # −0 is 0
    return hashed(repr((exact, stamp(scene).geometry, lights, bends)).encode())[:24]


def read(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays in a file by name; raises FileNotFoundError for a missing file, one of files.DAMAGE for a damaged one."""
    with np.load(path, allow_pickle=False) as data:  # zip's check sums detect changed bits
        return {name: data[name] for name in data.files}


def write(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Store `arrays`, whole or not at all; raises IrrsplatError if that fails."""
    with _naming(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_arrays(path, arrays)


def kept(name: str, find: Callable[[Path], Result], make: Callable[[], Result], notice: Callable[[str], object]) -> Result:
    """Return what `find` reads from the file `name` of the cache folder; else what `make` returns, whose arrays are stored there.

    notice: called with a line if the file is damaged, or cannot be written.
    """
    path = None
    try:
        path = folder() / name
        return find(path)
    except FileNotFoundError:
        pass  # it is made here for the first time
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
