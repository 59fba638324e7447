"""Writer of `.scene` files, with `.light` and `.obj` files in a folder of their own."""

from __future__ import annotations

import io
import math
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.files import make_folder, write_bytes, write_text
from irrsplat.core.paths import read_bytes
from irrsplat.core.vectors import Vector
from irrsplat.core.words import is_number
from irrsplat.scene.io.lights.ies import load_ies
from irrsplat.scene.model import Camera, Light, Mesh, Photometry, Scene, sun_lights

_FOLDER = "-files"  # suffix of the folder for lights and objects
_NEAR, _FAR = 0.01, 1000.0  # metres, required by `proj` and ignored by readers


def scene_file(name: str) -> Path:
    """Return the path of a scene that is saved under `name`, with or without its ending."""
    return Path(os.path.expanduser(name if name.endswith(".scene") else f"{name}.scene")).absolute()


def parts_folder(path: Path) -> Path:
    """Return the folder for the lights and objects of a `.scene` file at `path`."""
    return path.with_name(path.stem + _FOLDER)


def write_scene(scene: Scene, path: Path) -> str:
    """Write the scene to `path`, in place of an existing file, and return a line about losses of the format; "" without losses.

    Reading restores lights, cameras, and triangles in their present place, in the same float32 numbers. Hidden meshes are left
    out. Raises InputError if `path` has another ending than .scene; IrrsplatError if writing fails.
    """
    if path.suffix != ".scene":
        raise InputError("a scene is saved under a name that ends in .scene", path)
    folder = parts_folder(path)
    make_folder(folder)
    writer = _Writer(folder)
    camera_lines, (sky_lines, suns) = writer.cameras(scene.cameras), writer.sky(scene)
    lines = [*camera_lines, *sky_lines, *(writer.light(light) for light in scene.lights if light not in suns)]
    for mesh in scene.meshes:
        lines += writer.mesh(mesh, scene.origin)
    write_text(path, "\n".join([f"# {path.stem}, written by irrsplat", *lines]) + "\n")
    if not writer.lost:
        return ""
    return f"{path.name}: a .scene does not hold " + ", ".join(f"{what} ({n})" if n else what for what, n in writer.lost.items())


@dataclass
class _Writer:
    """Writer of a scene's files into a folder. lost: losses of the format, with the number of objects; 0: not counted."""

    folder: Path
    taken: set[str] = field(default_factory=set)
    lost: dict[str, int] = field(default_factory=dict)

    def _lose(self, what: str, count: int = 1) -> None:
        self.lost[what] = self.lost.get(what, 0) + count

    def _file(self, name: str, default: str, ending: str) -> Path:
        """Return an unused file for an object with this name."""
        stem = re.sub(r"[^\w-]+", "_", name).strip("_") or default
        names = (stem if i == 1 else f"{stem}-{i}" for i in range(1, len(self.taken) + 2))
        free = next(one for one in names if one.lower() + ending not in self.taken)  # some file systems ignore case
        self.taken.add(free.lower() + ending)
        return self.folder / (free + ending)

    def cameras(self, cameras: Iterable[Camera]) -> list[str]:
        """Return the lines of the cameras; the first one stays first when they are read again."""
        cameras = list(cameras)
        taken: set[str] = set()
        lines = []
        for i, camera in enumerate(cameras):
            name = re.sub(r"[\s#]+", "_", camera.name)
            if (not name and i) or (name and is_number(name)) or name in taken:
                name = next(n for k in range(2, len(cameras) + 3) if (n := f"{name or 'camera'}_{k}") not in taken)
            taken.add(name)
            lines.append(" ".join(filter(None, ["cam", name, *(_numbers(v) for v in (camera.eye, camera.target, camera.up))])))
        if any(camera.fov != cameras[0].fov for camera in cameras):
            self._lose("a field of view for each camera", 0)
        fov = cameras[0].fov if cameras else 45.0
        return [*lines, f"proj {_numbers((fov, 1.0, _NEAR, _FAR))}"]

    def sky(self, scene: Scene) -> tuple[list[str], tuple[Light, ...]]:
        """Return the line of the sky, if there is one, and the suns that it includes; no line for a sky that the reader adds."""
        if any(scene.sky_gradient):
            self._lose("a sky that is brighter above", 0)
        if scene.environment is not None:
            suns = sun_lights(scene.environment)
            if scene.environment.line and all(sun in scene.lights for sun in suns):  # the suns are unchanged
                return [f"sky {scene.environment.line}"], suns
            self._lose("the sky's map (its mean replaces it, its suns are kept)", 0)
            return [f"sky {_numbers(scene.environment.mean)}"], ()
        lit = scene.lights or any(any(mesh.material.emission) for mesh in scene.meshes if not mesh.is_point)
        if not lit and not scene.own_sky and scene.sky == (1.0, 1.0, 1.0) and not any(scene.sky_gradient):
            return [], ()
        return [f"sky {_numbers(scene.sky)}"] if any(scene.sky) or not lit else [], ()

    def light(self, light: Light) -> str:
        """Write a light, and return the line with its file."""
        path = self._file(light.name, "light", ".light")
        if light.photometry is not None:
            return self._luminaire(light, light.photometry, path)
        lines = [f"position {_numbers((*light.position, 0.0 if light.directional else 1.0))}"]
        if light.physical and not light.directional:
            lines.append(f"intensity {_numbers(light.color)}")
        else:
            color = [c / math.pi for c in light.color] if light.physical else light.color
            lines.append(f"diffuse {_numbers((*color, 1.0))}")
            words = ("constantAttenuation", "linearAttenuation", "quadraticAttenuation")
            lines += [f"{word} {_numbers((k,))}" for word, k in zip(words, light.attenuation, strict=True)]
        if light.spot_target is not None:
            if light.spot_cutoff < 90.0:
                lines += [f"spotDirection {_numbers(light.spot_target)}", f"spotCutoff {_numbers((light.spot_cutoff,))}"]
                lines += [f"spotInner {_numbers((light.spot_inner,))}", f"spotExponent {_numbers((light.spot_exponent,))}"]
            else:
                self._lose("cones of 90 degrees or more")
        write_text(path, "\n".join(lines) + "\n")
        return f"light {self.folder.name}/{path.name}"

    def _luminaire(self, light: Light, photometry: Photometry, path: Path) -> str:
        """Write a luminaire with a copy of its photometric file."""
        source, tilt_files = Path(photometry.path), list[Path]()
        if not np.array_equal(load_ies(source, [], tilt_files).axes, photometry.axes):
            self._lose("mirrored luminaires")
        copy = self._file(source.stem, "luminaire", ".ies")
        write_bytes(copy, read_bytes(source))
        for tilt in tilt_files:  # the file refers to these by name
            write_bytes(self.folder / tilt.name, read_bytes(tilt))
        x, y, z = light.position
        lines = [f"ies {copy.name}", f"position {_numbers((*light.position, 1.0))}", f"intensity {_numbers(light.color)}"]
        lines += [f"spotDirection {_numbers(light.spot_target or (x, y, z - 1.0))}", f"zeroDirection {_numbers(light.across)}"]
        write_text(path, "\n".join(lines) + "\n")
        return f"light {self.folder.name}/{path.name}"

    def mesh(self, mesh: Mesh, origin: Vector) -> list[str]:
        """Write a mesh, relative to `origin`, and return the lines of its material, its origin and its file; none for a hidden
        mesh."""
        if mesh.is_point or not len(mesh.faces):
            return []
        material = mesh.material
        for what, there in (
            ("textures", material.albedo_texture is not None or material.emission_texture is not None),
            ("normal maps", material.normal_texture is not None),
            ("opacity", material.alpha_mode != "opaque" or material.transmission > 0.0),
            ("colours at vertices", mesh.colors is not None),
            ("surfaces without a back", not material.double_sided),
        ):
            if there:
                self._lose(what)
        path = self._file(mesh.name, "mesh", ".obj")
        write_text(path, obj_text(mesh))
        albedo = [min(max(c, 0.0), 1.0) for c in material.albedo] if not material.unlit else (0.0, 0.0, 0.0)
        diffuse, emission = f"brdf diffuse {_numbers((*albedo, 1.0))}", f"brdf emission {_numbers(material.emission)}"
        obj = f"obj {self.folder.name}/{path.name}"
        placed = ["push", f"trans {_numbers(origin)}", obj, "pop"] if any(origin) else [obj]
        return [diffuse, emission, *placed]


def obj_text(mesh: Mesh) -> str:
    """Return the text of an `.obj` file with the triangles and normals of a mesh."""
    text = io.StringIO()
    np.savetxt(text, mesh.positions, fmt="v %.9g %.9g %.9g")
    np.savetxt(text, mesh.normals, fmt="vn %.9g %.9g %.9g")
    np.savetxt(text, np.repeat(mesh.faces + 1, 2, axis=1), fmt="f %d//%d %d//%d %d//%d")
    return text.getvalue()


def _numbers(values: Iterable[float]) -> str:
    """Return numbers with as many digits as identify them."""
    return " ".join(repr(float(v)).removesuffix(".0") for v in values)
