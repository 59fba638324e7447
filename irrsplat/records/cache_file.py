"""Record caches in files, written atomically; a file for another scene, other lights or other settings is refused.

A file is one line that names the format, a SHA-256 checksum, and arrays (NPZ without pickles: no code can run). Next to the
records it holds hashes of their inputs: geometry with materials and sky, lights, and the gather settings.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from irrsplat.core import files, paths
from irrsplat.core.errors import InputError
from irrsplat.records import record_cache
from irrsplat.records.scene_stamp import SceneStamp, hashed, present_triangles, stamp
from irrsplat.scene.model import Scene
from irrsplat.settings import SETTINGS, Settings

FORMAT = 15  # raise it whenever the content of files or the inputs of records change
_NAME = b"irrsplat record cache "
_DIGEST = hashlib.sha256().digest_size
_REMEDY = "remove it to have it made anew, or name another file"


@dataclass(frozen=True)
class CacheKey:
    """Inputs of records: the stamp of the scene (with materials and sky), a hash of the lights, and settings by name."""

    scene: SceneStamp
    lights: str
    settings: Mapping[str, object]


@dataclass(frozen=True)
class CacheState:
    """Saved records with all that a renderer needs to resume.

    records: the arrays of RecordCache.state. bounces: gather method and number of bounces, by their names in the statistics.
    settings: all settings of the renderer. checked: the number of records at the last spot check. compared: the number of records
    by which all others are limited; 0 without limits.
    """

    records: Mapping[str, np.ndarray]
    bounces: Mapping[str, object]
    settings: Mapping[str, object] = field(default_factory=dict)
    checked: int = 0
    compared: int = 0


@dataclass(frozen=True)
class Content:
    """Content of a file: the key of its records, and the records."""

    key: CacheKey
    state: CacheState

    def settings(self) -> Settings:
        """Return the settings of the records; raises InputError if this version does not accept them."""
        return Settings().with_values(self.state.settings)


def key(scene: Scene, settings: Settings) -> CacheKey:
    """Return the inputs of the records of this scene and these settings."""
    names = ["seed", "bounces", "gather", "gather_size", "light_samples", "shadow_size", "gradients", "placement"]
    names += ["warmup"] if settings.placement == "scan" else []
    lights = hashed(json.dumps([light.key for light in scene.lights]).encode())
    return CacheKey(stamp(scene), lights, {name: getattr(settings, name) for name in names})


def selected(state: CacheState, numbers: np.ndarray) -> CacheState:
    """Return the state with only the records of these numbers, ascending."""
    whole = {name: state.records[name] for name in ("clocks", "luminance_floor")}
    records = {name: rows[numbers] for name, rows in state.records.items() if name not in whole} | whole
    records["luminance_floor"] = np.array(record_cache.luminance_floor(records["irradiance"]))
    return replace(state, records=records, checked=0, compared=0)


def carried_over(content: Content, key: CacheKey) -> CacheState:
    """Return the records on triangles that the scene of `key` still has, with its triangle numbers."""
    state, present = content.state, present_triangles(content.key.scene, key.scene)
    triangle = np.asarray(state.records["triangle"], np.intp)
    known = triangle >= 0
    triangle = np.where(known, np.append(present, -1)[np.minimum(triangle, len(present))], -1)
    gone = known & (triangle < 0)
    state = replace(state, records={**state.records, "triangle": triangle})
    return selected(state, np.flatnonzero(~gone)) if gone.any() else state


def write(path: files.Pathlike, key: CacheKey, state: CacheState) -> None:
    """Write the records atomically; raises IrrsplatError on failure."""
    made_for = {"geometry": key.scene.geometry, "lights": key.lights, "settings": dict(key.settings)}
    counts = {"checked": state.checked, "compared": state.compared}
    about = {"bounces": dict(state.bounces), "settings": dict(state.settings), **counts}
    text = json.dumps({"key": made_for, "about": about, "scene": asdict(key.scene)})
    payload = io.BytesIO()
    arrays: dict[str, np.ndarray] = {"about": np.array(text), **state.records}
    np.savez(payload, **arrays)  # type: ignore[arg-type]  # numpy's stub takes the arrays for its flag allow_pickle
    data = payload.getvalue()
    files.write_bytes(path, _NAME + b"%d\n" % FORMAT + hashlib.sha256(data).digest() + data)


def read(path: files.Pathlike, key: CacheKey, update: bool = False) -> tuple[Content, str]:
    """Return the content of a file, and a text of how its scene or its lights differ from the key's; empty if they do not.

    update: accept another scene or other lights. Raises InputError if the file cannot be read, is no record cache, is damaged, or
    was made for another key.
    """
    content = read_any(path)
    if content.key.settings != key.settings:
        raise InputError(f"this record cache was made with {_differing(content.key.settings, key.settings)}; {_REMEDY}", path)
    reason = difference(content.key, key)
    if reason and not update:
        raise InputError(f"this record cache was made {reason}; {_REMEDY}; --cache-mode update renews it", path)
    return content, reason


def renewal(path: files.Pathlike, reason: str) -> str:
    """Return the message for a file that is used although its scene differs; reason: as `read` returns it."""
    return f"{path} was made {reason}; what that concerns is gathered again"


def read_any(path: files.Pathlike) -> Content:
    """Return the content of a file for any key; raises InputError if it is missing, no record cache or damaged."""
    data = _payload(path)
    try:
        arrays = _arrays(data)
        header = json.loads(str(arrays.pop("about")))
        scene, about, made_for = SceneStamp.read(header["scene"]), header["about"], header["key"]
        if made_for.pop("geometry") != scene.geometry:
            raise ValueError("geometry")
        key = CacheKey(scene, **made_for)
        if not isinstance(key.settings, dict) or not isinstance(about["settings"], dict):
            raise ValueError("settings")
        record_cache.check_state(arrays)
        checked, compared = int(about["checked"]), int(about["compared"])
        if not 0 <= min(checked, compared) <= max(checked, compared) <= len(arrays["id"]):
            raise ValueError("checked")
        state = CacheState(arrays, dict(about["bounces"]), about["settings"], checked, compared)
        return Content(key, state)
    except files.DAMAGE as error:
        raise InputError(f"a damaged record cache ({type(error).__name__}); {_REMEDY}", path) from error


def _payload(path: files.Pathlike) -> bytes:
    """Return the NPZ in a file, after its format and its checksum."""
    with paths.anywhere():
        name, line, rest = paths.read_bytes(Path(path), paths.MOST_GEOMETRY).partition(b"\n")
    name += line
    if not name.startswith(_NAME) or not name.endswith(b"\n"):
        raise InputError("this is not a record cache of irrsplat, and stays as it is; name another file", path)
    number = name[len(_NAME) :].strip().decode("ascii", "replace")
    if number != str(FORMAT):
        raise InputError(f"a record cache of format {number}; this irrsplat reads format {FORMAT}; {_REMEDY}", path)
    digest, data = rest[:_DIGEST], rest[_DIGEST:]
    if hashlib.sha256(data).digest() != digest:
        raise InputError(f"a damaged record cache (its checksum is wrong); {_REMEDY}", path)
    return data


def _arrays(data: bytes) -> dict[str, np.ndarray]:
    """Return the arrays of an NPZ as `write` makes it: no larger than the file. Raises one of files.DAMAGE for other content."""
    with np.load(io.BytesIO(data), allow_pickle=False) as whole:
        if sum(part.file_size for part in whole.zip.infolist()) > len(data):
            raise ValueError("its arrays are packed")
        return {name: whole[name] for name in whole.files}


def difference(made_for: CacheKey, requested: CacheKey) -> str:
    """Return the difference of a file's key from the requested one as a text; empty if there is none."""
    if made_for.scene.geometry != requested.scene.geometry:
        return "for another scene, other materials or another sky"
    if made_for.lights != requested.lights:
        return "for other lights"
    if made_for.settings != requested.settings:
        return "with " + _differing(made_for.settings, requested.settings)
    return ""


def _differing(was: Mapping[str, object], now: Mapping[str, object]) -> str:
    """Return the differing settings as flags: those of the file, then the requested ones."""
    names = [name for name in SETTINGS if was.get(name) != now.get(name)]

    def flags(values: Mapping[str, object]) -> str:
        words = {name: {True: "on", False: "off"}[value] if isinstance(value, bool) else value for name, value in values.items()}
        return " ".join(f"{SETTINGS[name].flag} {words[name]}" for name in names if name in words)

    return f"{flags(was)}, not {flags(now)}"
