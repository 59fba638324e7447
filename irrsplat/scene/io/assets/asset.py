"""Loading of OBJ, PLY and STL files; the default albedo is 0.5, as in a `.scene`."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

from irrsplat.core.errors import InputError
from irrsplat.core.load_options import LoadOptions
from irrsplat.scene.io.assets.ply import read_ply
from irrsplat.scene.io.assets.stl import read_stl
from irrsplat.scene.io.defaults import finish
from irrsplat.scene.io.mesh_builder import Part, build_meshes
from irrsplat.scene.io.obj.asset import read_obj
from irrsplat.scene.model import Scene
from irrsplat.scene.stand_ins.up_axis import up_vector
from irrsplat.sky.sky_text import sky_of

_READERS: dict[str, Callable[[Path, list[str], LoadOptions], list[Part]]] = {".obj": read_obj, ".ply": read_ply, ".stl": read_stl}


def load_asset(path: Path, options: LoadOptions) -> Scene:
    """Load the geometry of a `.obj`, `.ply` or `.stl` file, with its materials and colours, in metres.

    Missing vertex normals are computed by options.crease_angle. Scene.notices list omissions and defaults.
    Raises InputError, one line with the file's path, for a missing or damaged file.
    """
    notices: list[str] = []
    sky = sky_of(options.sky)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            parts = _READERS[path.suffix.lower()](path, notices, options)
    except InputError:
        raise
    except Exception as error:  # trimesh may raise anything for a damaged file
        reason = (str(error).splitlines() or [""])[0].strip("'\" ")[:80]
        detail = f" ({reason})" if reason and not isinstance(error, ImportError) else ""  # of an encoding guesser
        kind = path.suffix[1:].upper()
        raise InputError(f"this is no {kind} file, or a damaged one{detail}; export it again", path) from None
    found, origin = build_meshes(parts)
    meshes = [built.mesh for built in found if built.mesh is not None]  # without transforms, none has a problem
    dropped = sum(built.dropped for built in found)
    files = [file for part in parts for file in part.files]
    up = up_vector(path, options.up_axis)
    return finish(path, meshes, (), (), sky, {str(path): dropped}, notices, files, up, origin)
