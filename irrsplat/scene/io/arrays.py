"""Meshes and scenes from NumPy arrays, with the same defaults as those from files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, cast

import numpy as np
import numpy.typing as npt

from irrsplat.core.errors import InputError
from irrsplat.core.load_options import CREASE_ANGLE, LoadOptions
from irrsplat.core.vectors import vector
from irrsplat.core.words import GREATEST
from irrsplat.scene.io.defaults import finish
from irrsplat.scene.io.mesh_builder import Part, build_meshes, crease_normals
from irrsplat.scene.model import Camera, Light, Material, Mesh, Scene
from irrsplat.scene.model.checks import check_type, checked
from irrsplat.scene.motion import affine
from irrsplat.scene.stand_ins.up_axis import up_vector
from irrsplat.sky.environment import Environment
from irrsplat.sky.map_file import MOST_ROWS
from irrsplat.sky.sky_text import Sky, sky_of
from irrsplat.sky.sphere import pyramid
from irrsplat.sky.split import split

Up = Literal["x", "y", "z"]


def make_mesh(
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    material: Material | None = None,
    *,
    normals: npt.ArrayLike | None = None,
    colors: npt.ArrayLike | None = None,
    uvs: npt.ArrayLike | None = None,
    transform: npt.ArrayLike | None = None,
    crease_angle: float = CREASE_ANGLE,
    name: str = "",
) -> Mesh:
    """Return a Mesh of triangles for `make_scene`.

    vertices: (V, 3), metres. faces: (F, 3) integers, rows of vertices, counter-clockwise seen from outside. material: grey
    of reflectance 0.5, if None. normals: (V, 3), of any length; None: edges between triangles that meet at less than
    `crease_angle` (degrees, 0..180) are smooth. colors: (V, 3) linear reflectance in place of the material's albedo. uvs: (V, 2),
    from (0, 0) at an image's upper left corner to (1, 1) at its lower right one. transform: (4, 4) or (3, 4), affine, world from
    vertices. name: for `Renderer.move` and messages. Triangles without an area are left out. Raises InputError for arrays of
    different lengths, numbers that are not finite, colors beyond 0..1, and a transform that is singular or not affine.
    """
    LoadOptions(crease_angle=crease_angle)  # for its check
    check_type("the name of a mesh", name, str)
    said = f"of mesh {name!r:.60}" if name else "of a mesh"
    points = _rows(f"the vertices {said}", vertices, 3)
    corners = _faces(f"the faces {said}", faces, len(points))
    part = Part(
        points,
        corners,
        matrix=None if transform is None else affine(transform),
        material=Material() if material is None else material,
        name=name,
        normals=None if normals is None else _rows(f"the normals {said}", normals, 3, len(points)),
        colors=None if colors is None else _rows(f"the colors {said}", colors, 3, len(points)),
        uvs=None if uvs is None else np.tile(_rows(f"the uvs {said}", uvs, 2, len(points)), 2),
    )
    check_type(f"the material {said}", part.material, Material)
    if part.colors is not None and not (part.colors.min(initial=0.0) >= 0.0 and part.colors.max(initial=0.0) <= 1.0):
        raise InputError(f"the colors {said} are linear reflectance from 0 to 1; 8-bit colours are sRGB: decode them")
    if normals is None and crease_angle > 0.0 and len(corners):
        smooth, corner_normals = crease_normals(points, corners, crease_angle)
        part = replace(part, normals=smooth, corner_normals=corner_normals)
    (built,), origin = build_meshes([part])
    if built.mesh is None:
        raise InputError(built.problem, name or "mesh")
    return replace(built.mesh, positions=built.mesh.positions.astype(float) + origin) if any(origin) else built.mesh


def make_scene(
    meshes: Mesh | Sequence[Mesh],
    lights: Sequence[Light] = (),
    cameras: Sequence[Camera] = (),
    *,
    sky: str | npt.ArrayLike | None = None,
    up: Up = "y",
    name: str = "scene",
) -> Scene:
    """Return a Scene of `meshes`, as `irrsplat.load` does for a file.

    sky: (3,) uniform radiance; (H, W, 3) radiance of an equirectangular map, top row first, with north in its middle; or a text
    as the option `sky` of `irrsplat.load`. up: the vertical axis. A scene without light gets a sky and a key light, and a
    scene without camera gets one that sees the scene; Scene.notices report both. Existing light is never supplemented. Raises
    InputError for meshes without a triangle, and for values of another kind.
    """
    meshes = (meshes,) if isinstance(meshes, Mesh) else meshes
    given = Scene(cast(tuple[Mesh, ...], meshes), cast(tuple[Light, ...], lights), cast(tuple[Camera, ...], cameras))
    around = _given_sky(sky)
    if up not in ("x", "y", "z"):
        raise InputError(f"up is one of x, y, z, not {up!r:.60}")
    near = replace(given, meshes=tuple(mesh for mesh in given.meshes if len(mesh.faces))).recentred
    if not near.meshes:
        raise InputError("no triangle of these meshes has an area; nothing is left to show", name)
    path, upward = Path(name), up_vector(Path(name), up)
    scene = finish(path, near.meshes, near.lights, near.cameras, around, {}, up=upward, origin=near.origin, invent=False)
    return replace(scene, path="", files=())


def _given_sky(sky: str | npt.ArrayLike | None) -> Sky | None:
    """Return the sky of a text, a radiance (3,) or a map (H, W, 3); raise InputError for other values."""
    if sky is None:
        return None
    if isinstance(sky, str):
        return sky_of(LoadOptions(sky=sky).sky)
    try:
        array = np.asarray(sky, np.float32)
    except (TypeError, ValueError):
        array = np.zeros(0, np.float32)
    if array.shape == (3,):
        return Sky(vector(checked("a sky's radiance", array, 3, 0.0)))
    if array.ndim != 3 or array.shape[2] != 3 or min(array.shape[:2]) < 2:
        raise InputError("a sky is a radiance (3,), a map of radiance (H, W, 3), or a text such as 'cie overcast lux 10000'")
    if not (array.min() >= 0.0 and array.max() <= GREATEST):  # false for NaN
        raise InputError(f"a sky's radiance is from 0 to {GREATEST:g}")
    shown = np.ascontiguousarray(pyramid(array, MOST_ROWS + 1)[-1])
    light, suns = split(shown)
    return Sky(environment=Environment(shown, light, suns, f"a map, {shown.shape[1]}x{shown.shape[0]}"))


def _rows(what: str, values: npt.ArrayLike, columns: int, rows: int | None = None) -> np.ndarray:
    """Return a caller's (rows, columns) float64; raise InputError, with the name `what`, for other values."""
    try:
        array = np.asarray(values, float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.ndim != 2 or array.shape[1] != columns or (rows is not None and len(array) != rows):
        raise InputError(
            f"{what} are an array ({'N' if rows is None else rows}, {columns}) of numbers, not of shape {np.shape(array)}"
        )
    if not (np.abs(array) <= GREATEST).all():  # false for NaN
        raise InputError(f"{what} must be finite numbers, at most {GREATEST:g}")
    return array


def _faces(what: str, values: npt.ArrayLike, count: int) -> np.ndarray:
    """Return a caller's faces (F, 3) int64 into `count` vertices; raise InputError for other values."""
    try:
        array = np.asarray(values)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu":
        raise InputError(f"{what} are an array (F, 3) of whole numbers, not of shape {array.shape} of {array.dtype}")
    if array.size and not 0 <= array.min() <= array.max() < count:
        raise InputError(f"{what} refer to vertices that do not exist; expected 0 to {count - 1}")
    return array.astype(np.int64)
