"""Reader of `.obj` files as scenes: materials, groups, vertex colours and missing normals."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.load_options import LoadOptions
from irrsplat.core.words import quote
from irrsplat.scene.io.images import find_file
from irrsplat.scene.io.mesh_builder import Part, crease_normals
from irrsplat.scene.io.obj.mtl import MaterialFiles, find_libraries, name_without_comment
from irrsplat.scene.io.obj.reader import Shape, load_obj
from irrsplat.scene.model import Material

MOST_GROUPS = 400  # above this number, groups are merged


def read_obj(path: Path, notices: list[str], options: LoadOptions) -> list[Part]:
    """Read the triangles of the file, one part for each group (or object) and material, or for each material if those exceed 400.

    A part's name is its group, group and material if the group has several, else the material. Texture coordinates are kept for
    textured materials. Missing normals are computed by the crease angle, or are face normals where smoothing is off.
    Notices list omissions. Raises InputError for a file without a valid face.
    """
    shape = load_obj(path, strict=False)
    if not len(shape.corners):
        lost = f" ({shape.notices[0]})" if shape.notices else ""
        raise InputError(f"there are no faces in this file{lost}; expected 'f' lines", path)
    notices += [f"{path}: {notice}" for notice in shape.notices]
    materials, files = _materials(path, shape, notices)
    normals, corner_normals = _normals(shape, options.crease_angle)
    part, names, used = _parts(shape, path.stem, materials)

    order = np.argsort(part.astype(np.uint16 if len(names) < 1 << 16 else np.int64), kind="stable")
    rows_of_parts = np.split(order, np.cumsum(np.bincount(part))[:-1])
    parts = []
    for name, number, rows in zip(names, used, rows_of_parts, strict=True):
        material = materials.get(number)
        colors, uvs, corner_uvs = shape.colors, None, None
        positions, corners, where = _compact(shape.positions, shape.corners[rows])
        if colors is not None:
            colors = colors[where]
            if (colors == 1.0).all():
                colors = None
            elif material is not None and any(material.albedo):
                colors = colors * material.albedo
        own_normals, own_corner_normals, _ = _compact(normals, corner_normals[rows])
        if material is not None and material.textures and len(shape.uvs):
            uvs, corner_uvs, _ = _compact(shape.uvs, shape.corner_uvs[rows])
            uvs = np.pad(uvs, ((0, 0), (0, 2)))
        parts.append(
            Part(
                positions,
                corners,
                own_normals,
                own_corner_normals,
                material=material or Material(),
                colors=colors,
                name=name,
                files=files,
                uvs=uvs,
                corner_uvs=corner_uvs,
            )
        )
    return parts


def _materials(path: Path, shape: Shape, notices: list[str]) -> tuple[dict[int, Material], tuple[Path, ...]]:
    """Return the known materials of shape.names, by number, and the files that were read for them."""
    reader = MaterialFiles()
    found: dict[str, Material] = {}
    missing = []

    def read(file: Path) -> None:
        try:
            found.update(reader.read(file, shape.names))
        except InputError as error:
            notices.append(f"{error}; its colours are 0.5")

    for name, file in (one for written in shape.libraries for one in find_libraries(path.parent, written)):
        if file is None:
            missing.append(name)
        else:
            read(file)
    nameless = not shape.libraries and any(shape.names)  # usemtl without mtllib
    beside = find_file(path.parent, f"{path.stem}.mtl") if nameless or (missing and not found) else None
    if beside is not None:
        read(beside)
    if missing:
        first, *rest = dict.fromkeys(missing)
        more = f" and {len(rest)} more" * bool(rest)
        instead = f"'{beside.name}' is read instead" if beside else "its colours are 0.5"
        notices.append(f"{path}: there is no material file {quote(first)}{more}; {instead}")
    notices += reader.notices
    folded = {name.casefold(): material for name, material in found.items()}

    def look_up(name: str) -> Material | None:
        return found.get(name) or folded.get(name.casefold()) or folded.get(name_without_comment(name).casefold())

    known = {i: look_up(name) for i, name in enumerate(shape.names) if name}
    unknown = [shape.names[i] for i, material in known.items() if material is None]
    if unknown and (found or not missing):
        others = f" and {len(unknown) - 1} more" * (len(unknown) > 1)
        notices.append(f"{path}: no material file defines {quote(unknown[0])}{others}; using grey 0.5")
    return {i: material for i, material in known.items() if material is not None}, tuple(reader.files)


def _normals(shape: Shape, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, 3) the file's normals, completed for triangles without normals, and (F, 3) indices into them."""
    given: np.ndarray = np.min(shape.corner_normals, axis=1) >= 0
    if len(shape.normals):
        nonzero = np.abs(shape.normals).max(axis=1) > 0.0
        given &= np.all(nonzero[shape.corner_normals], axis=1)
    bare = np.flatnonzero(~given & ~shape.flat)
    corner_normals = shape.corner_normals
    if not len(bare) or angle <= 0.0:
        return shape.normals, corner_normals
    positions, corners, _ = _compact(shape.positions, shape.corners[bare])
    more, corner_more = crease_normals(positions, corners, angle)
    corner_normals = corner_normals.copy()
    corner_normals[bare] = corner_more + len(shape.normals)
    return np.concatenate([shape.normals, more]), corner_normals


def _parts(shape: Shape, stem: str, materials: dict[int, Material]) -> tuple[np.ndarray, list[str], list[int]]:
    """Return (F,) the part of each triangle, and for each part its name and its material's number.

    materials: the known ones, by number.
    """
    count = len(shape.names)
    present, part = np.unique(shape.groups * count + shape.materials, return_inverse=True)
    if len(present) > MOST_GROUPS:
        same = shape.materials
        if count > MOST_GROUPS:  # equal ones are one part
            first: dict[Material | None, int] = {}
            same = np.array([first.setdefault(materials.get(i), i) for i in range(count)])[same]
        present, part = np.unique(same, return_inverse=True)
        return part, [shape.names[i] or stem for i in present.tolist()], present.tolist()
    groups, used = (present // count).tolist(), (present % count).tolist()
    names = []
    for group, material in zip(groups, used, strict=True):
        own, of = shape.group_names[group], shape.names[material]
        several = groups.count(group) > 1
        names.append(f"{own} {of}".strip() if own and several else own or of or stem)
    return part, names, used


def _compact(values: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray, slice | np.ndarray]:
    """Return a range of rows of `values` that covers `index` (-1: none), `index` into it, and the rows' numbers."""
    low, high = int(index.min(initial=0 if not len(values) else len(values) - 1, where=index >= 0)), int(index.max(initial=-1))
    if high - low < 4 * index.size:
        rows: slice | np.ndarray = slice(low, high + 1)
        return values[rows], np.where(index >= 0, index - low, -1) if low else index, rows
    rows, inverse = np.unique(index[index >= 0], return_inverse=True)
    out = np.full(index.shape, -1)
    out[index >= 0] = inverse
    return values[rows], out, rows
