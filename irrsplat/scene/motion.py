"""Changes of meshes: move, repaint and hide them, and check the arguments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from irrsplat.core.errors import InputError
from irrsplat.core.vectors import times, unit
from irrsplat.core.words import quote
from irrsplat.scene.change import is_elsewhere
from irrsplat.scene.model import Material, Mesh, Scene

_LEAST_DETERMINANT = 1e-12  # least determinant of a transform, relative to the cube of its largest element


def moved(scene: Scene, loaded: Sequence[Mesh], mesh: int | str, transform: npt.ArrayLike) -> Scene:
    """Return the scene with `mesh`, an index or a unique name, at `transform` from its `loaded` place, in its present material.

    transform: (4, 4) or (3, 4) affine, world_from_world. Triangles keep their numbers. The winding of a mirrored mesh is
    reversed, so that a closed mesh stays closed. Return `scene` itself if the mesh is there already. Raises InputError for an
    unknown mesh and for a matrix that is not affine, or singular.
    """
    number, matrix = find(scene, mesh), affine(transform)
    meshes = list(scene.meshes)
    if any(scene.origin):  # positions are relative to the origin
        matrix[:3, 3] += matrix[:3, :3] @ scene.origin - scene.origin
    present = meshes[number]
    meshes[number] = _posed(transformed(replace(loaded[number], material=present.material), matrix), present)
    return scene if meshes[number] is present else replace(scene, meshes=tuple(meshes))


def repainted(scene: Scene, mesh: int | str, material: Material) -> Scene:
    """Return the scene with another material on `mesh`, an index or a unique name; raise InputError for an unknown mesh."""
    number, meshes = find(scene, mesh), list(scene.meshes)
    if meshes[number].material == material:
        return scene
    meshes[number] = replace(meshes[number], material=material)
    return replace(scene, meshes=tuple(meshes))


def posed(present: Scene, pose: Scene) -> Scene:
    """Return the `present` scene with the lights, sky, mesh places and materials of a `pose` of it.

    Meshes that are equal in both stay the present objects. Raises InputError for a pose with other meshes.
    """
    pairs = zip(pose.meshes, present.meshes, strict=False)
    if len(pose.meshes) != len(present.meshes) or any(len(a.faces) != len(b.faces) for a, b in pairs):
        raise InputError("a pose has the same meshes as the renderer's scene, in the same order")
    meshes = tuple(_posed(a, b) for a, b in zip(pose.meshes, present.meshes, strict=True))
    same = all(a is b for a, b in zip(meshes, present.meshes, strict=True))
    around = {name: getattr(pose, name) for name in ("sky", "sky_gradient", "environment", "own_sky")}
    return replace(present, lights=pose.lights, meshes=present.meshes if same else meshes, **around)


def _posed(mesh: Mesh, present: Mesh) -> Mesh:
    """Return `mesh`, or its `present` state where that is equal."""
    if is_elsewhere(mesh, present) and not (
        np.array_equal(mesh.positions, present.positions) and np.array_equal(mesh.faces, present.faces)
    ):
        return mesh
    return present if mesh.material == present.material else replace(present, material=mesh.material)


def hidden(mesh: Mesh, at: np.ndarray) -> Mesh:
    """Return the mesh with all vertices in the point `at` (3,), so that neither cameras nor rays find it.

    Its triangles keep their numbers, so that it can be shown again in place.
    """
    return replace(mesh, positions=np.tile(np.asarray(at, np.float32), (len(mesh.positions), 1)))


def find(scene: Scene, mesh: int | str) -> int:
    """Return the index of a mesh given by index or name; raise InputError, with the meshes, for an unknown or ambiguous one."""
    count = len(scene.meshes)
    if isinstance(mesh, str):
        found = [i for i, one in enumerate(scene.meshes) if one.name == mesh]
        if len(found) == 1:
            return found[0]
        if found:
            raise InputError(f"{len(found)} meshes are called {quote(mesh)}; give an index: {', '.join(map(str, found))}")
        names = ", ".join(dict.fromkeys(quote(one.name) for one in scene.meshes if one.name)) or "none"
        raise InputError(f"there is no mesh {quote(mesh)}; the named meshes here: {names}")
    if not isinstance(mesh, (int, np.integer)) or isinstance(mesh, bool):
        raise InputError(f"a mesh is given by its index or its name, not by {type(mesh).__name__}")
    if not 0 <= mesh < count:
        raise InputError(f"there is no mesh {mesh}; the scene has {count}, counted from 0")
    return int(mesh)


def affine(transform: npt.ArrayLike) -> np.ndarray:
    """Return a 4×4 or 3×4 matrix as (4, 4) float64; raise InputError for other shapes and for a singular or not affine matrix."""
    try:
        given = np.asarray(transform, float)
    except (TypeError, ValueError):
        raise InputError("a transform is a 4x4 or 3x4 matrix of numbers") from None
    if given.shape not in ((4, 4), (3, 4)):
        raise InputError(f"a transform is a 4x4 or 3x4 matrix, not one of shape {'x'.join(map(str, given.shape)) or 'a number'}")
    if not np.isfinite(given).all():
        raise InputError("every number of a transform must be finite")
    matrix = np.eye(4)
    matrix[: len(given)] = given
    if (matrix[3] != (0.0, 0.0, 0.0, 1.0)).any():
        raise InputError("the last row of a transform is 0 0 0 1: points are columns, and the last column is the translation")
    if not abs(np.linalg.det(matrix[:3, :3])) > _LEAST_DETERMINANT * np.abs(matrix[:3, :3]).max() ** 3:
        raise InputError("the transform is singular: it would flatten the mesh")
    return matrix


def transformed(mesh: Mesh, matrix: np.ndarray) -> Mesh:
    """Return the mesh, transformed by an affine matrix (4, 4); raise InputError where float32 overflows."""
    with np.errstate(over="ignore"):
        positions = (times(mesh.positions.astype(float), matrix[:3, :3]) + matrix[:3, 3]).astype(np.float32)
    if not np.isfinite(positions).all():
        raise InputError("the transformed mesh exceeds the range of 32-bit floats")
    normals = unit(times(mesh.normals.astype(float), np.linalg.inv(matrix[:3, :3]).T)).astype(np.float32)
    mirrored = np.linalg.det(matrix[:3, :3]) < 0.0
    return replace(mesh, positions=positions, normals=normals, faces=mesh.faces[:, ::-1].copy() if mirrored else mesh.faces)
