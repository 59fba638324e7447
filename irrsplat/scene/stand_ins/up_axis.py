"""The up axis of a file: as requested, by its format, or by the name of its exporter."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from irrsplat.core.load_options import UpAxis
from irrsplat.core.vectors import Vector, vector
from irrsplat.scene.model import Camera

_AXES: dict[str, Vector] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
# Exporters with z up that do not rotate their OBJ files, unlike Blender, 3ds Max, Maya and Rhino.
_Z_UP = re.compile(
    rb"autocad|freecad|open ?cascade|openscad|solvespace|cloudcompare|revit|archicad|microstation|\bz[- ]?up\b|z axis up", re.I
)
_HEADER = 4096  # bytes at the start of a file that may name its exporter


def up_vector(path: Path, requested: UpAxis = "auto") -> Vector:
    """Return (3,) the unit vector that points up in the file at `path`.

    "auto": y in glTF and PLY; z in STL, as from CAD programs and for printers. In OBJ it is y, or z if the comments at the start
    name an exporter with z up.
    """
    if requested != "auto":
        return _AXES[requested]
    ending = path.suffix.lower()
    return _AXES["z" if ending == ".stl" or (ending == ".obj" and _z_up_by_name(path)) else "y"]


def _z_up_by_name(path: Path) -> bool:
    try:
        with open(path, "rb") as file:
            head = file.read(_HEADER)
    except OSError:
        return False
    return any(_Z_UP.search(line) for line in head.splitlines() if line.lstrip().startswith(b"#"))


def nearest_axis(camera: Camera) -> Vector:
    """Return the axis nearest to the camera's up, preferably one about which it has no roll: right ⟂ the world's up.

    The up of a steep view, if perpendicular to it, is closer to a horizontal axis; its right vector resolves that.
    """
    up = np.asarray(camera.up, float) / np.linalg.norm(camera.up)
    both = np.concatenate([np.eye(3), -np.eye(3)])
    return vector(both[int(np.argmax(both @ up - np.abs(both @ camera.axes[0])))])


def axes(up: Vector) -> np.ndarray:
    """Return (3, 3) rows right, up and front of an upright object; unit and right-handed, front points to the viewer.

    y up: x, y and z, as in glTF; z up: x, z and -y, as in CAD programs.
    """
    front = (0.0, -1.0, 0.0) if int(np.argmax(np.abs(up))) == 2 else (0.0, 0.0, 1.0)
    u = np.asarray(up, float) / np.linalg.norm(up)
    right = np.cross(u, front)
    right /= np.linalg.norm(right)
    return np.stack([right, u, np.cross(right, u)])
