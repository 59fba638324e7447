"""Record caches in files: written whole or not at all, refused where they do not belong to the scene, its lights or the settings.

A file is one line that names the format, a SHA-256 checksum, and arrays (NPZ without pickles, so nothing in it can run). With the
records it holds hashes of what they depend on: geometry with materials and sky, lights, and the settings they were gathered with.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from irrsplat.core import files, paths
from irrsplat.core.errors import InputError
from irrsplat.core.record_layout import GATHERED
from irrsplat.records import record_cache
from irrsplat.records.adaptive_radius import AdaptiveRadiusState
from irrsplat.records.scene_stamp import Earlier, SceneStamp, stamp_of
from irrsplat.scene.flatten import flatten
from irrsplat.scene.model import Image, Material, Scene
from irrsplat.settings import SETTINGS, Settings

FORMAT = 8  # to be raised whenever the content of files changes, or what records are gathered from
_NAME = b"irrsplat record cache "
_DIGEST = hashlib.sha256().digest_size
_CHECKED = "checked"  # the array of where checks have looked from, in files of this version and later ones
_REMEDY = "remove it to have it made anew, or name another file"


@dataclass(frozen=True)
class CacheKey:
    """What records depend on: hashes of the geometry (with materials and sky) and of the lights, and settings by name."""

    geometry: str
    lights: str
    settings: Mapping[str, object]


@dataclass(frozen=True)
class CacheState:
    """All that a renderer needs to go on from saved records as if it had never stopped.

    records: the arrays of RecordCache.state. adapted: how far the records' radii are adapted. bounces: how the records were
    gathered and with how many bounces, by the names that the statistics have for it. settings: those that
    they were made by, all of them. checked: (K,) int64, where checks of the records have looked from.
    """

    records: Mapping[str, np.ndarray]
    adapted: AdaptiveRadiusState
    bounces: Mapping[str, object]
    settings: Mapping[str, object] = field(default_factory=dict)
    checked: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))


@dataclass(frozen=True)
class Content:
    """All that a file holds: for what its records were made, the records, and what is known of their scene."""

    key: CacheKey
    state: CacheState
    scene: SceneStamp

    def settings(self) -> Settings:
        """Those that the records were made by; raises InputError where they are none of this version."""
        return Settings().with_values(self.state.settings)


def key(scene: Scene, settings: Settings) -> CacheKey:
    """What the records of this scene and these settings depend on."""
    vertices, faces, closed = flatten(scene)
    lights = [light.key for light in scene.lights]
    names = ["seed", "bounces", "gather", "gather_size", "ray_noise", "light_samples", "shadow_size", "gradients", "placement"]
    names += ["warmup"] if settings.placement == "scan" else []
    return CacheKey(
        geometry=_hash(vertices.tobytes(), faces.tobytes(), repr((closed, *_sky(scene))).encode(), *_materials(scene)),
        lights=_hash(json.dumps(lights).encode()),
        settings={name: getattr(settings, name) for name in names},
    )


def _sky(scene: Scene) -> tuple[object, ...]:
    """What it sends out; its up vector counts only where it is not the same all around."""
    if scene.environment is not None:
        return (scene.environment.digest.hex(),)
    return (tuple(scene.sky), tuple(scene.sky_gradient), tuple(scene.up)) if any(scene.sky_gradient) else (tuple(scene.sky),)


def _materials(scene: Scene) -> Iterator[bytes]:
    """What records depend on of the scene's materials, apart from the vertices."""
    for material in scene.materials:
        yield from _material(material)


def _material(material: Material) -> Iterator[bytes]:
    """What records depend on of a material: all values, and the images as bytes; nothing of normal maps, which only bend what
    records say."""
    values = replace(material, albedo_texture=None, emission_texture=None, normal_texture=None, normal_scale=1.0)
    yield repr(values).encode()
    for texture in (material.albedo_texture, material.emission_texture):
        if texture is not None:
            yield repr((texture.uv_set, texture.transform, texture.wrap, texture.nearest)).encode()
            yield repr(texture.image.pixels.shape).encode()
            yield _image_digest(texture.image)
        else:
            yield b""


_digests: WeakKeyDictionary[Image, bytes] = WeakKeyDictionary()  # images do not change, and may be large


def _image_digest(image: Image) -> bytes:
    if image not in _digests:
        _digests[image] = hashlib.sha256(image.pixels.tobytes()).digest()
    return _digests[image]


def selected(state: CacheState, numbers: np.ndarray) -> CacheState:
    """The records of these numbers alone, ascending, none of them held against the others yet."""
    whole = {name: state.records[name] for name in ("clocks", "dark")}
    records = {name: rows[numbers] for name, rows in state.records.items() if name not in whole} | whole
    records["limit"] = np.ones_like(records["limit"])
    irradiance = records["content"][:, GATHERED.index("irradiance"), :3]
    records["dark"] = np.array(record_cache.luminance_floor(irradiance))
    return replace(state, records=records, adapted=AdaptiveRadiusState(), checked=np.zeros(0, np.int64))


def carried_over(state: CacheState, then: Earlier) -> CacheState:
    """The records on what is still there of the scene that they were made of, by the numbers that its triangles have now."""
    triangle = np.asarray(state.records["triangle"], np.intp)
    known = triangle >= 0
    triangle = np.where(known, np.append(then.triangle, -1)[np.minimum(triangle, len(then.triangle))], -1)
    gone = known & (triangle < 0)
    state = replace(state, records={**state.records, "triangle": triangle})
    return selected(state, np.flatnonzero(~gone)) if gone.any() else state


def stamp(scene: Scene) -> SceneStamp:
    """What a file is to know of the scene of its records, beside its key."""
    hashes = {material: _hash(*_material(material)) for material in scene.materials}
    around = _hash(repr(_sky(scene)).encode())
    return stamp_of(scene, around, [hashes[mesh.material] for mesh in scene.meshes])


def write(path: files.Pathlike, key: CacheKey, state: CacheState, scene: SceneStamp) -> None:
    """Write the records, whole or not at all; raises IrrsplatError where that fails."""
    about = {"adapted": state.adapted.as_json(), "bounces": dict(state.bounces), "settings": dict(state.settings)}
    text = json.dumps({"key": asdict(key), "about": about, "scene": scene.as_json()})
    payload = io.BytesIO()
    arrays: dict[str, np.ndarray] = {"about": np.array(text), _CHECKED: state.checked, **scene.arrays, **state.records}
    np.savez(payload, **arrays)  # type: ignore[arg-type]  # numpy's stub takes the arrays for its flag allow_pickle
    data = payload.getvalue()
    files.write_bytes(path, _NAME + b"%d\n" % FORMAT + hashlib.sha256(data).digest() + data)


def read(path: files.Pathlike, key: CacheKey) -> CacheState:
    """The records of a file.

    Raises InputError where it cannot be read, is no record cache, is damaged, or was made for another key.
    """
    content = read_any(path)
    if reason := difference(content.key, key):
        renewed = "" if content.key.settings != key.settings else "; --cache-mode update renews it"
        raise InputError(f"this record cache was made {reason}; {_REMEDY}{renewed}", path)
    return content.state


def read_of_any_scene(path: files.Pathlike, key: CacheKey) -> tuple[Content, str]:
    """All that a file holds, whatever scene and lights it was made for, and how these differ from the key's, in words.

    Raises InputError as `read`, for scene and lights not.
    """
    content = read_any(path)
    if reason := difference(content.key, replace(key, geometry=content.key.geometry, lights=content.key.lights)):
        raise InputError(f"this record cache was made {reason}; {_REMEDY}", path)
    return content, difference(content.key, key)


def renewal(path: files.Pathlike, reason: str) -> str:
    """What is said where a file is taken although its scene differs, which `reason` says as `read_of_any_scene` does."""
    return f"{path} was made {reason}; what that concerns is gathered again"


def read_any(path: files.Pathlike) -> Content:
    """All that a file holds, whatever it was made for; raises InputError where it is missing, no record cache or damaged."""
    header, arrays = _read(path)
    try:
        made_for, about = CacheKey(**header["key"]), header["about"]
        if not isinstance(made_for.settings, dict) or not isinstance(about["settings"], dict):
            raise ValueError("settings")
        scene = SceneStamp.read(header["scene"], arrays)
        checked = arrays.pop(_CHECKED, np.zeros(0, np.int64))
        if checked.dtype != np.int64 or checked.ndim != 1 or (np.diff(checked) <= 0).any():
            raise ValueError(_CHECKED)
        records = {name: array for name, array in arrays.items() if name not in scene.arrays}
        record_cache.check_state(records)
        adapted = AdaptiveRadiusState.from_json(about["adapted"])
        return Content(made_for, CacheState(records, adapted, dict(about["bounces"]), about["settings"], checked), scene)
    except files.DAMAGE as error:
        raise InputError(f"a damaged record cache ({type(error).__name__}); {_REMEDY}", path) from error


def _read(path: files.Pathlike) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    with paths.anywhere():
        name, line, rest = paths.read_bytes(Path(path), paths.MOST_GEOMETRY).partition(b"\n")
    name += line
    if not name.startswith(_NAME) or not name.endswith(b"\n"):
        raise InputError("this is not a record cache of irrsplat, and stays as it is; name another file", path)
    number = name[len(_NAME) :].strip().decode("ascii", "replace")
    if number != str(FORMAT):
        raise InputError(f"a record cache of format {number}, and this irrsplat knows format {FORMAT}; {_REMEDY}", path)
    digest, data = rest[:_DIGEST], rest[_DIGEST:]
    if hashlib.sha256(data).digest() != digest:
        raise InputError(f"a damaged record cache (its checksum is wrong); {_REMEDY}", path)
    try:
        state = _arrays(data)
        return json.loads(str(state.pop("about"))), state
    except files.DAMAGE as error:
        raise InputError(f"a damaged record cache ({type(error).__name__}); {_REMEDY}", path) from error


def _arrays(data: bytes) -> dict[str, np.ndarray]:
    """The arrays in the bytes of an NPZ as `write` makes it, where nothing is packed, so that they are no larger than the file;
    raises one of files.DAMAGE for any other."""
    with zipfile.ZipFile(io.BytesIO(data)) as whole:
        parts = whole.infolist()
        if any(part.compress_type != zipfile.ZIP_STORED for part in parts) or sum(part.file_size for part in parts) > len(data):
            raise ValueError("its arrays are packed")
        return {part.filename.removesuffix(".npy"): _array(whole.read(part)) for part in parts}


def _array(data: bytes) -> np.ndarray:
    stream = io.BytesIO(data)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("an array of another format")
    shape, by_column, kind = np.lib.format.read_array_header_1_0(stream)
    body = data[stream.tell() :]
    if kind.hasobject or by_column or math.prod(shape) * kind.itemsize != len(body):
        raise ValueError("an array of another size")
    return np.frombuffer(body, kind).reshape(shape).copy()


def difference(made_for: CacheKey, wanted: CacheKey) -> str:
    """What a file was made for or with, where that is not what is wanted; else the empty text."""
    if made_for.geometry != wanted.geometry:
        return "for another scene, other materials or another sky"
    if made_for.lights != wanted.lights:
        return "for other lights"
    if made_for.settings != wanted.settings:
        return "with " + _differing(made_for.settings, wanted.settings)
    return ""


def _differing(was: Mapping[str, object], now: Mapping[str, object]) -> str:
    """The settings that differ, as flags: those of a file, and those that are wanted."""

    names = [name for name in SETTINGS if was.get(name) != now.get(name)]

    def flags(values: Mapping[str, object]) -> str:
        return " ".join(f"{SETTINGS[name].flag} {_word(values[name])}" for name in names if name in values)

    return f"{flags(was)}, not {flags(now)}"


def _word(value: object) -> str:
    return ("on" if value else "off") if isinstance(value, bool) else str(value)


def _hash(*parts: bytes) -> str:
    whole = hashlib.sha256()
    for part in parts:
        whole.update(len(part).to_bytes(8, "little") + part)
    return whole.hexdigest()
