"""Scenes from files as numpy data, without OpenGL: `load` reads every format, `bundled` lists the scenes of the package."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from irrsplat.core import paths
from irrsplat.core.errors import InputError, did_you_mean
from irrsplat.core.load_options import CREASE_ANGLE, LoadOptions, UpAxis
from irrsplat.core.paths import within
from irrsplat.core.words import quote
from irrsplat.scene.io.text.scene_text import load_text
from irrsplat.scene.model import Camera, Light, Material, Mesh, Scene

__all__ = ["FORMATS", "Camera", "Light", "Material", "Mesh", "Scene", "bundled", "load"]

FORMATS = (".scene", ".obj", ".ply", ".stl", ".glb", ".gltf")


def bundled() -> tuple[str, ...]:
    """Return the names of the bundled scenes, sorted; each lies in ``scenes/<name>/<name>.scene``."""
    return tuple(sorted(path.stem for path in paths.folder("scenes").glob("*/*.scene") if path.stem == path.parent.name))


def located(source: str | os.PathLike[str]) -> Path:
    """Return the file that `load` reads for `source`; raise InputError for a missing file or an unknown format."""
    path, names = Path(source), bundled()
    exists, folder = os.path.exists(path), os.path.isdir(path)  # False for invalid file names
    name = os.fspath(source).removesuffix(".scene")
    if (folder or not exists) and name in names:
        return paths.folder("scenes") / name / f"{name}.scene"
    if folder:
        raise InputError("this is a directory; give a file in it", path)
    if not exists:
        text = os.fspath(source)
        raise InputError(f"there is no file {quote(text)}{did_you_mean(text, names)}; the bundled scenes are {', '.join(names)}")
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"unknown ending {quote(path.suffix)}; expected one of {' '.join(FORMATS)}", path)
    return path


def load(
    source: str | os.PathLike[str],
    *,
    up_axis: UpAxis = "auto",
    crease_angle: float = CREASE_ANGLE,
    sky: str | None = None,
    allow: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] = (),
    photometric: bool = False,
) -> Scene:
    """Load the scene at a path, or a bundled scene, ``"cornell"`` or ``"cornell.scene"``; an existing file takes precedence.

    Formats are `.scene`, `.glb` and `.gltf` and, as geometry with diffuse colours, `.obj`, `.ply` and `.stl`. World space is
    right-handed, in metres. Meshes are relative to Scene.origin, which is not 0 0 0 for a scene far from there. `LoadOptions`
    documents the keywords; a `.scene` uses only `sky`.
    A scene may refer to files in its own folder and below, and in the folders in `allow`.
    Raises InputError, one line, for an invalid file, name or keyword.
    """
    folders = tuple(allow) if isinstance(allow, (list, tuple)) else (allow,)
    options = LoadOptions(up_axis, crease_angle, sky, folders, photometric)
    if not isinstance(source, (str, os.PathLike)):
        raise InputError(f"load takes a path or the name of a bundled scene, not {type(source).__name__}")
    path = located(source)
    ending = path.suffix.lower()
    with within(path, options.allow):
        if ending == ".scene":
            return load_text(path, options)
        if ending in (".glb", ".gltf"):
            from irrsplat.scene.io.gltf.reader import load_gltf

            return load_gltf(path, options)
        from irrsplat.scene.io.assets.asset import load_asset

        return load_asset(path, options)
