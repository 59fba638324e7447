"""Reads geometry and diffuse colours from OBJ, PLY and STL files; trimesh parses, this file checks what it returns.

A material's albedo is its base colour alone (metalness, roughness and transparency are not read); a texture counts by its mean
colour. Where a file names no colour, the albedo is 0.5, as in a `.scene`.
"""

from __future__ import annotations

import io
import logging
import re
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from irrsplat.core.color import linear_from_srgb
from irrsplat.core.errors import InputError
from irrsplat.core.load_options import LoadOptions
from irrsplat.scene.io.defaults import finish
from irrsplat.scene.io.lines import read_bytes
from irrsplat.scene.io.obj.asset import read_obj
from irrsplat.scene.io.part import Part
from irrsplat.scene.model import Scene
from irrsplat.scene.stand_ins.up_axis import up_vector


def load_asset(path: Path, options: LoadOptions) -> Scene:
    """The geometry of a `.obj`, `.ply` or `.stl` file, with diffuse colours and emission, in metres.

    Vertex normals are the file's; a mesh without any gets face normals. Scene.notices say what was dropped or invented.
    Raises InputError, one line with the file's path, for a file that is missing, empty, truncated, garbage, not finite, or
    that needs a feature which is not read.
    """
    notices: list[str] = []
    readers: dict[str, Callable[[Path, list[str], LoadOptions], list[Part]]] = {".obj": read_obj, ".ply": _ply}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            parts = readers.get(path.suffix.lower(), _stl)(path, notices, options)
    except InputError:
        raise
    except Exception as error:  # a damaged file may raise anything anywhere in trimesh
        reason = (str(error).splitlines() or [""])[0].strip("'\" ")[:80]
        said = f" ({reason})" if reason and not isinstance(error, ImportError) else ""  # of an encoding guesser
        kind = path.suffix[1:].upper()
        raise InputError(f"this is no {kind} file, or a damaged one{said}; export it again", path) from None
    meshes, dropped = [], 0
    for part in parts:
        mesh, lost = part.mesh(path)
        meshes.append(mesh)
        dropped += lost
    files = [file for part in parts for file in part.files]
    return finish(path, meshes, (), (), None, Counter({str(path): dropped}), notices, files, up_vector(path, options.up_axis))


def _trimesh(path: Path, data: bytes, ending: str) -> Any:
    """The trimesh Scene of `data`, as it is in the file; raises whatever trimesh raises."""
    import trimesh  # takes 0.4 s: imported only for such files
    from trimesh.resolvers import FilePathResolver

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # otherwise its warnings are printed to stderr
    return trimesh.load_scene(io.BytesIO(data), file_type=ending, process=False, resolver=FilePathResolver(str(path)))


def _ply(path: Path, notices: list[str], options: LoadOptions) -> list[Part]:
    data = read_bytes(path)
    if not re.match(rb"ply\s", data) or b"end_header" not in data[:100_000]:
        raise InputError("this is no PLY file (it has no PLY header); export it again", path)
    scene = _trimesh(path, data, "ply")
    parts = []
    for mesh in scene.geometry.values():
        raw = mesh.metadata.get("_ply_raw", {})
        for name, element in raw.items():
            if element["length"] and name in ("vertex", "face"):
                _check_length(path, name, element)
        faces = np.asarray(getattr(mesh, "faces", np.zeros((0, 3))))
        vertex = {key: np.asarray(raw["vertex"]["data"][key]).reshape(-1) for key in raw["vertex"]["properties"]}
        names = raw["vertex"]["properties"]
        positions = np.asarray(mesh.vertices)
        own = all(len(vertex[axis]) == len(positions) for axis in "xyz")  # trimesh splits vertices along texture seams
        normals = np.stack([vertex[n] for n in ("nx", "ny", "nz")], -1) if own and {"nx", "ny", "nz"} <= set(names) else None
        colors = None
        rgb = next(
            (c for c in (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue")) if c[0] in names), None
        )
        if own and rgb and set(rgb) <= set(names):
            colors = _unit_colors(np.stack([vertex[n] for n in rgb], -1), np.dtype(names[rgb[0]]))
        elif mesh.visual.kind == "face":
            colors = np.repeat(linear_from_srgb(np.asarray(mesh.visual.face_colors)[:, :3] / 255.0), 3, axis=0)
            positions, faces = positions[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)
            normals = None
        parts.append(Part(positions, faces, normals, colors=colors, name=path.stem))
    counted = re.search(rb"element\s+face\s+(\d+)", data[:100_000])
    faces_read = sum(len(part.corners) for part in parts)
    if not faces_read:
        raise InputError("there are no faces in this file; a cloud of points can't be lit", path)
    if counted and faces_read < int(counted[1]):
        raise InputError(f"only {faces_read} of {int(counted[1])} faces can be read; save it with triangles only", path)
    return parts


def _check_length(path: Path, name: str, element: dict[str, Any]) -> None:
    """Raises InputError where less of a PLY element is there than its header announces."""
    data = element.get("data")
    columns = [data[key] for key in data] if isinstance(data, dict) else [] if data is None else [data]
    if not columns or any(len(column) != element["length"] for column in columns):
        raise InputError(f"the file is truncated: its header announces {element['length']} of '{name}'", path)


def _unit_colors(values: np.ndarray, kind: np.dtype[Any]) -> np.ndarray:
    """(V, 3) linear reflectance for sRGB colours, either integers of some width or floats in 0..1."""
    scale = float(np.iinfo(kind).max) if kind.kind in "ui" else 1.0
    return linear_from_srgb(np.clip(np.nan_to_num(values.astype(float) / scale), 0.0, 1.0))


def _stl(path: Path, notices: list[str], options: LoadOptions) -> list[Part]:
    data = read_bytes(path)
    scene = _trimesh(path, data, "stl")
    parts = [Part(np.asarray(m.vertices), np.asarray(m.faces), name=path.stem) for m in scene.geometry.values()]
    count = sum(len(part.corners) for part in parts)
    binary = len(data) >= 84 and 84 + 50 * int.from_bytes(data[80:84], "little") == len(data)
    if not binary and count != data.lower().count(b"endfacet"):
        raise InputError("this is no STL file, or a truncated one; export it again", path)
    if not count:
        raise InputError("there are no triangles in this file", path)
    return parts
