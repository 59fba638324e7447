"""Reader of `.stl` files: trimesh parses, this module checks the result and computes normals."""

from __future__ import annotations

import io
import logging
import re
from pathlib import Path

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.load_options import LoadOptions
from irrsplat.core.paths import MOST_GEOMETRY, read_bytes
from irrsplat.core.vectors import as_float32
from irrsplat.core.words import GREATEST
from irrsplat.scene.io.mesh_builder import Part, crease_normals, welded


def read_stl(path: Path, notices: list[str], options: LoadOptions) -> list[Part]:
    """Read the triangles of the file, a part for each solid, with normals by the crease angle; equal vertices are merged.

    Triangles that are not finite, and colours, are left out with a notice. Raises InputError for a truncated file and one without
    triangles, and any exception of trimesh.
    """
    import trimesh  # takes 0.4 s: imported only for such files

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # otherwise its warnings are printed to stderr
    data = read_bytes(path, MOST_GEOMETRY)
    binary = len(data) >= 84 and 84 + 50 * int.from_bytes(data[80:84], "little") == len(data)
    if not binary and data.lstrip()[:5].lower().startswith((b"solid", b"#")):
        data = re.sub(rb"#[^\r\n]*", b"", data).lstrip()
    scene = trimesh.load_scene(io.BytesIO(data), file_type="stl", process=False)
    solids = [(np.asarray(mesh.vertices, float), np.asarray(mesh.faces)) for mesh in scene.geometry.values()]
    count = sum(len(corners) for _, corners in solids)
    if not binary and count != data.lower().count(b"endfacet"):
        raise InputError("this is no STL file, or a truncated one; export it again", path)
    if not count:
        raise InputError("there are no triangles in this file", path)
    if binary and _colored(data):
        notices.append(f"{path}: the colours of this STL file are not shown; save it as PLY or OBJ to keep them")
    parts, lost = [], 0
    for positions, corners in solids:
        with np.errstate(invalid="ignore"):
            usable: np.ndarray = np.max(np.abs(positions), axis=1, initial=0.0) < GREATEST
        good = usable[corners].all(axis=1)
        lost += int((~good).sum())
        corners, positions = corners[good], np.where(usable[:, None], positions, 0.0)
        first, weld = welded(as_float32(positions))
        positions, corners = positions[first], weld[corners]
        smooth = crease_normals(positions, corners, options.crease_angle) if options.crease_angle > 0.0 else (None, None)
        parts.append(Part(positions, corners, smooth[0], smooth[1], name=path.stem))
    if lost == count:
        raise InputError("no vertex is finite (NaN or infinity); expected finite coordinates", path)
    if lost:
        notices.append(f"{path}: {lost} triangle{'s' * (lost > 1)} with coordinates that are not finite left out")
    return parts


def _colored(data: bytes) -> bool:
    """True if a binary file has colours by Magics (in its header) or VisCAM (a bit of each triangle)."""
    attributes = np.frombuffer(data, "u1", offset=84).reshape(-1, 50)[:, 48:].copy().view("<u2")
    return b"COLOR=" in data[:80] or bool((attributes >> 15).mean() > 0.5)
