"""Readers as functions of bytes; only IrrsplatError with a one-line message is allowed."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import irrsplat
from irrsplat.app import grammar
from irrsplat.app.common.parser import Parser
from irrsplat.app.viewer import preferences
from irrsplat.core.errors import IrrsplatError
from irrsplat.core.load_options import LoadOptions
from irrsplat.core.paths import within
from irrsplat.records import cache_file
from irrsplat.scene.camera_path import load_path
from irrsplat.scene.io.gltf.reader import load_gltf
from irrsplat.scene.io.lights.ies import load_ies
from irrsplat.scene.io.lights.light_text import LightReader
from irrsplat.scene.io.obj.mtl import MaterialFiles
from irrsplat.scene.io.obj.reader import load_obj
from irrsplat.scene.io.text.scene_text import load_text
from irrsplat.scene.model import Light, Mesh, Scene
from irrsplat.settings import SETTINGS, Settings
from irrsplat.sky.map_file import read_map
from tests.support.gltf_files import read_image

LONGEST = 4000  # characters of a message
WHOLE = 64  # one scene in WHOLE has a sky of full size and is finished as by `load`, the slowest steps

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
LIGHT = "position 0 1 1 1\ndiffuse 1 1 1 1\n"
IES = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 50\n0 45 90\n0\n100 80 0\n"
HDR = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n" + bytes([100, 120, 90, 129]) * 8

QUICK: dict[str, Any] = {"bounces": 1, "gather_size": 8, "shadow_size": 64, "gather": "trace"}

Read = Callable[[Path], object]


def judge(name: str, data: bytes) -> str:
    """Feed a reader; return "read" for a result, "refused" for an allowed error.

    Raises the reader's other errors, and AssertionError for an invalid result or message.
    """
    with _folder() as folder:
        try:
            READERS[name](folder, data)
        except IrrsplatError as error:
            message = str(error)
            assert message and len(message) <= LONGEST and "\n" not in message and "\r" not in message, message[:200]
            return "refused"
    return "read"


@cache
def _place() -> Path:
    found = Path(tempfile.mkdtemp(prefix="irrsplat-fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))
    for file, text in (("t.obj", TRIANGLE), ("l.light", LIGHT), ("a.ies", IES)):
        (found / file).write_text(text)
    (found / "s.hdr").write_bytes(HDR)
    (found / "p.png").write_bytes(png())
    return found


@contextmanager
def _folder() -> Iterator[Path]:
    """Provide the folder of files referenced by inputs; one folder for all cases saves time."""
    with np.errstate(all="ignore"), contextlib.redirect_stderr(io.StringIO()):
        yield _place()


@cache
def png() -> bytes:
    """Return a picture of four pixels."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(np.arange(16, dtype=np.uint8).reshape(2, 2, 4)).save(out, "PNG")
    return out.getvalue()


def _file(ending: str, read: Read) -> Callable[[Path, bytes], None]:
    def fed(folder: Path, data: bytes) -> None:
        path = folder / f"case{ending}"
        path.write_bytes(data)
        whole = hashlib.sha1(data).digest()[0] % WHOLE == 0
        with within(path), ExitStack() as patched:
            if not whole:
                patched.enter_context(mock.patch("irrsplat.sky.cie.ROWS", 8))
                for module in ("assets.asset", "gltf.reader", "text.scene_text"):
                    patched.enter_context(mock.patch(f"irrsplat.scene.io.{module}.finish", _plain))
            _check(read(path))

    return fed


def _plain(path: Path, meshes: Any, lights: Any, cameras: Any, *_: object) -> Scene:
    """Build the scene without stand-ins, in place of `finish`."""
    return Scene(tuple(meshes), tuple(lights), tuple(cameras), name=path.stem)


def _check(result: object) -> None:
    """Assert that a result is valid."""
    if isinstance(result, Scene):
        for mesh in result.meshes:
            _check(mesh)
        for notice in result.notices:
            assert "\n" not in notice and len(notice) <= LONGEST, notice[:200]
    elif isinstance(result, Mesh):
        assert np.isfinite(result.positions).all() and np.isfinite(result.normals).all()
        assert not len(result.faces) or 0 <= result.faces.min() <= result.faces.max() < len(result.positions)
    elif isinstance(result, Light):
        assert np.isfinite(result.color).all()
    elif isinstance(result, np.ndarray):
        assert np.isfinite(result).all()


def _asset(path: Path) -> object:
    from irrsplat.scene.io.assets.asset import load_asset

    return load_asset(path, LoadOptions())


@cache
def cache_key() -> cache_file.CacheKey:
    """Return the key of the cases' caches."""
    return cache_file.key(irrsplat.load("cornell-paper"), irrsplat.preset(**QUICK))


def cache_bytes(payload: bytes) -> bytes:
    """Return a record cache with a valid name and checksum around any payload."""
    return cache_file._NAME + b"%d\n" % cache_file.FORMAT + hashlib.sha256(payload).digest() + payload


def _cache(folder: Path, data: bytes) -> None:
    path = folder / "case.cache"
    for whole in (data, cache_bytes(data)):
        path.write_bytes(whole)
        with contextlib.suppress(IrrsplatError) if whole is data else contextlib.nullcontext():
            cache_file.read(path, cache_key())


def _settings(folder: Path, data: bytes) -> None:
    name, _, value = data.decode("utf-8", "surrogateescape").partition("=")
    known = list(SETTINGS)
    name = known[int(name) % len(known)] if name.isdecimal() and len(name) < 9 else name
    if name in SETTINGS:
        Settings().with_values({name: SETTINGS[name].parse(value)})
    else:
        given: dict[str, Any] = {name: value}
        irrsplat.preset("default", **given)


def _preferences(folder: Path, data: bytes) -> None:
    with mock.patch.dict("os.environ", {"IRRSPLAT_CONFIG": str(folder)}):
        (folder / "viewer.json").write_bytes(data)
        _, notices = preferences.load()
        assert not any("\n" in notice for notice in notices)


@cache
def _grammar(build: Callable[[], Parser] = grammar.build) -> Parser:
    """Return one grammar for all cases, in place of the slow `grammar.build`."""
    return build()


def _command_line(folder: Path, data: bytes) -> None:
    words = data.decode("utf-8", "surrogateescape").split("\n")
    _grammar()
    with (
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.suppress(SystemExit),
        mock.patch.object(grammar, "build", _grammar),
    ):
        grammar.parse(words)


READERS: dict[str, Callable[[Path, bytes], None]] = {
    "scene": _file(".scene", load_text),
    "light": _file(".light", lambda path: LightReader().light(path)),
    "obj": _file(".obj", _asset),
    "obj-strict": _file(".obj", lambda path: load_obj(path).positions),
    "mtl": _file(".mtl", lambda path: MaterialFiles().read(path)),
    "gltf": _file(".gltf", lambda path: load_gltf(path, LoadOptions())),
    "glb": _file(".glb", lambda path: load_gltf(path, LoadOptions())),
    "ply": _file(".ply", _asset),
    "stl": _file(".stl", _asset),
    "path": _file(".path", lambda path: list(load_path(path))),
    "ies": _file(".ies", lambda path: load_ies(path, [], []).candela),
    "hdr": _file(".hdr", lambda path: read_map(path)[0]),
    "exr": _file(".exr", lambda path: read_map(path)[0]),
    "image": lambda folder, data: _check(read_image(data, "case").pixels),
    "cache": _cache,
    "settings": _settings,
    "preferences": _preferences,
    "command-line": _command_line,
}


@cache
def seeds(name: str) -> list[bytes]:
    """Return valid inputs of a reader, the seeds of mutations."""
    return [one if isinstance(one, bytes) else one.encode() for one in _SEEDS[name]()]


@cache
def gltf_tree() -> dict[str, Any]:
    """Return a glTF with all supported features."""
    import base64

    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "f4").tobytes()
    keys = np.array([0, 1], "f4").tobytes() + np.array([[0, 0, 0], [1, 1, 1]], "f4").tobytes()
    data = positions + np.zeros((3, 2), "f4").tobytes() + np.array([0, 1, 2, 0], "u2").tobytes() + keys
    texture = {"index": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 2], "rotation": 1}}}
    light = {"type": "spot", "intensity": 3, "spot": {"outerConeAngle": 0.5}}
    return {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2]}], "skins": [{"joints": [0]}],
        "nodes": [
            {"mesh": 0, "rotation": [0, 0, 0, 1], "children": [3]},
            {"camera": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 3, 1]},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 1, 0]},
            {"mesh": 0, "scale": [1, 2, 3], "skin": 0},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0, "mode": 4}]}],
        "materials": [{
            "pbrMetallicRoughness": {"baseColorTexture": texture, "baseColorFactor": [1, 0.5, 0, 1]},
            "emissiveFactor": [1, 0, 0], "alphaMode": "MASK",
        }],
        "textures": [{"source": 0, "sampler": 0}], "samplers": [{"wrapS": 33071}], "images": [{"uri": "p.png"}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}],
        "extensions": {"KHR_lights_punctual": {"lights": [light]}},
        "accessors": [
            {"bufferView": 0, "byteOffset": offset, "componentType": kind, "count": count, "type": shape}
            for offset, kind, count, shape in (
                (0, 5126, 3, "VEC3"), (36, 5126, 3, "VEC2"), (60, 5123, 3, "SCALAR"), (68, 5126, 2, "SCALAR"),
                (76, 5126, 2, "VEC3"),
            )
        ],
        "bufferViews": [{"buffer": 0, "byteLength": len(data)}],
        "buffers": [{"byteLength": len(data), "uri": "data:;base64," + base64.b64encode(data).decode()}],
    }  # fmt: skip


def glb_bytes(text: bytes, chunk: bytes = b"") -> bytes:
    """Return a GLB with this JSON, and a binary chunk."""
    import struct

    parts = struct.pack("<II", len(text), 0x4E4F534A) + text
    if chunk:
        parts += struct.pack("<II", len(chunk), 0x004E4942) + chunk
    return struct.pack("<4sII", b"glTF", 2, 12 + len(parts)) + parts


@cache
def cache_arrays() -> dict[str, np.ndarray]:
    """Return the arrays of a real renderer's cache."""
    path = _place() / "seed.cache"
    with irrsplat.Renderer(irrsplat.load("cornell-paper"), (8, 8), **QUICK) as renderer:
        renderer.render()
        renderer.save_cache(path)
    with np.load(io.BytesIO(path.read_bytes()[len(cache_bytes(b"")) :])) as file:
        return dict(file)


def npz(arrays: dict[str, np.ndarray]) -> bytes:
    """Return arrays as packed by `cache_file.write`."""
    out = io.BytesIO()
    np.savez(out, **arrays)  # type: ignore[arg-type]
    return out.getvalue()


def _exr() -> bytes:
    import OpenEXR

    path = _place() / "seed.exr"
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": np.ones((2, 4, 3), np.float32)}) as file:
        file.write(str(path))
    return path.read_bytes()


def _stl() -> bytes:
    return bytes(80) + (1).to_bytes(4, "little") + np.arange(12, dtype="<f4").tobytes() + bytes(2)


def _pictures() -> list[bytes]:
    from PIL import Image

    found = [png()]
    for kind in ("BMP", "TGA", "GIF", "JPEG", "TIFF", "WEBP"):
        out = io.BytesIO()
        Image.open(io.BytesIO(png())).convert("RGB").save(out, kind)
        found.append(out.getvalue())
    return found


_PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
)
_SCENE = (
    "cam 0 0 5 0 0 0 0 1 0\nproj 45 1 0.1 100\nunits photometric\nlight l.light\nlight a.ies\nbrdf diffuse .5 .5 .5 1\npush\n"
    "trans 1 0 0\nrotate 30 0 1 0\nscale 1 1 1\nobj t.obj\npop\nbrdf emission 1 1 1\nobj t.obj\nsky s.hdr gain 2 rotate 90\n"
)
_SEEDS: dict[str, Callable[[], list[Any]]] = {
    "scene": lambda: [_SCENE, "sky cie clear at 48 11 2026-06-21T12:00+02:00 turbidity 3\nobj t.obj\n", "sky 1 1 1\nobj t.obj\n"],
    "light": lambda: [
        LIGHT,
        "position 0 1 0 1\nintensity 1 1 1\nspotDirection 0 0 0\nspotCutoff 30\nspotInner 20\nspotExponent 2\n",
        "ies a.ies\nposition 0 0 0 1\nspotDirection 0 -1 0\nzeroDirection 1 0 0\n",
    ],
    "obj": lambda: [
        TRIANGLE,
        "mtllib m.mtl\no a\ng b\nusemtl c\ns off\nvt 0 0\nvn 0 0 1\n" + TRIANGLE + "f -1/1/1 -2/1/1 -3/1/1\n",
    ],
    "obj-strict": lambda: [TRIANGLE, "vn 0 0 1\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1//1 2//1 3//1 4//1\n"],
    "mtl": lambda: [
        "newmtl a\nKd 1 0 0\nKe 1 1 1\nd 0.5\nTr 0.5\nillum 4\nTf 1 1 1\nmap_Kd -s 2 2 1 p.png\nmap_d -imfchan r p.png\n"
    ],
    "gltf": lambda: [json.dumps(gltf_tree())],
    "glb": lambda: [glb_bytes(json.dumps(gltf_tree()).encode())],
    "ply": lambda: [_PLY, _PLY.split("0 0 0")[0].replace("ascii", "binary_little_endian").encode() + bytes(49)],
    "stl": lambda: [
        _stl(),
        "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n",
    ],
    "path": lambda: ["frames 10\ncam 0 0 5 0 0 0 0 1 0\ncam 5 0 0 0 0 0 0 1 0\n"],
    "ies": lambda: [IES, IES.replace("TILT=NONE", "TILT=INCLUDE\n1\n2\n0 90\n1 .5")],
    "hdr": lambda: [HDR, HDR[:46] + bytes([2, 2, 0, 8, 136, 5]) * 6],
    "exr": lambda: [_exr()],
    "image": _pictures,
    "cache": lambda: [npz(cache_arrays())],
    "settings": lambda: ["0=1024", "1=auto", "3=0.3", "seed=4", "a=nan"],
    "preferences": lambda: ['{"version": 2, "recent": ["cornell"], "size": [800, 600]}'],
    "command-line": lambda: [
        "render\ncornell\n-o\na.png\n--size\n64\n64",
        "measure\ncornell\n--plane\n0\n0\n0",
        "view\n--a\n0.3",
        "info\n--sky\n1 1 1",
    ],
}
