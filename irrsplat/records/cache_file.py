"""A record cache in a file: written whole or not at all, and read only where its records are still what they say.

The file is a line that names it, a checksum, and arrays (NPZ, nothing that could run). With the records go hashes of what they
depend on: geometry with materials and sky, lights, and the settings by which they were gathered.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from irrsplat.core import files
from irrsplat.core.errors import InputError
from irrsplat.gpu.resource import Owner
from irrsplat.indirect.scheduler import RecordScheduler
from irrsplat.scene.flatten import flatten
from irrsplat.scene.model import Scene
from irrsplat.settings import SETTINGS, Settings

FORMAT = 1  # to be raised with every change of what is in a file, or of what is gathered
_NAME = b"irrsplat record cache "
_DIGEST = hashlib.sha256().digest_size
_ANEW = "remove it to have it made anew, or name another file"


def key(scene: Scene, settings: Settings) -> dict[str, Any]:
    """What records depend on: hashes of "geometry" and "lights", and "settings" by name, as plain JSON."""
    vertices, faces, closed = flatten(scene)
    lights = [[v for name, v in vars(light).items() if name != "name"] for light in scene.lights]
    names = ["seed", "bounces", "gather", "gather_size", "shadow_size", "gradients", "placement"]
    names += ["warmup"] if settings.placement == "scan" else []
    return {
        "geometry": _hash(vertices.tobytes(), faces.tobytes(), repr((closed, tuple(scene.sky))).encode()),
        "lights": _hash(json.dumps(lights).encode()),
        "settings": {name: getattr(settings, name) for name in names},
    }


def save(path: files.Pathlike, placement: RecordScheduler) -> None:
    """Write the records of `placement`, whole or not at all; raises IrrsplatError where that fails."""
    state = placement.cache.state()
    if placement.moved or (placement.resumed is None and placement.bounced < 1.0):
        state["clocks"][0] += 1  # the era: all of them will be stale, as soon as what has changed is looked after
    about = {"adapted": placement.adaptation.state(), "bounces": placement.bounces(placement.settings)}
    text = json.dumps({"key": key(placement.scene, placement.settings), "about": about})
    arrays: dict[str, Any] = {"about": np.array(text), **state}
    payload = io.BytesIO()
    np.savez(payload, **arrays)
    data = payload.getvalue()
    files.write_bytes(path, _NAME + b"%d\n" % FORMAT + hashlib.sha256(data).digest() + data)


def load(path: files.Pathlike, placement: RecordScheduler) -> None:
    """Take the records of a file in place of those that there are; raises what `check` raises, and then changes nothing."""
    about, state = check(path, placement.scene, placement.settings)
    try:
        adapted, bounces = list(about["adapted"]), dict(about["bounces"])
        placement.cache.restore(state)
        placement.adaptation.restore(adapted, placement.settings)
        placement.resume(bounces)
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"a damaged record cache ({type(error).__name__}); {_ANEW}", path) from error


def check(path: files.Pathlike, scene: Scene, settings: Settings) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What a file has to say of its records, and their arrays.

    Raises InputError where it cannot be read, is no record cache, is damaged, or was made for another scene, other lights or with
    other settings.
    """
    about, state = _read(path)
    was, now = about["key"], key(scene, settings)
    reason = ""
    if was["geometry"] != now["geometry"]:
        reason = "for another scene, or other materials"
    elif was["lights"] != now["lights"]:
        reason = "for other lights"
    elif was["settings"] != now["settings"]:
        reason = "with " + _differing(was["settings"], now["settings"])
    if reason:
        raise InputError(f"this record cache was made {reason}; {_ANEW}", path)
    return about["about"], state


def _read(path: files.Pathlike) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    try:
        with open(path, "rb") as file:
            name, rest = file.readline(len(_NAME) + 20), file.read()
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror or error}", path) from error
    if not name.startswith(_NAME) or not name.endswith(b"\n"):
        raise InputError("this is not a record cache of irrsplat, and stays as it is; name another file", path)
    number = name[len(_NAME) :].strip().decode("ascii", "replace")
    if number != str(FORMAT):
        raise InputError(f"a record cache of format {number}, and this irrsplat knows format {FORMAT}; {_ANEW}", path)
    digest, data = rest[:_DIGEST], rest[_DIGEST:]
    if hashlib.sha256(data).digest() != digest:
        raise InputError(f"a damaged record cache (its checksum is wrong); {_ANEW}", path)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            state = {name: arrays[name] for name in arrays.files}
        return json.loads(str(state.pop("about"))), state
    except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"a damaged record cache ({type(error).__name__}); {_ANEW}", path) from error


def _differing(was: dict[str, Any], now: dict[str, Any]) -> str:
    """The settings of a file that are others now, as flags."""

    names = [name for name in SETTINGS if was.get(name) != now.get(name)]

    def flags(values: dict[str, Any]) -> str:
        return " ".join(f"{SETTINGS[name].flag} {_word(values[name])}" for name in names if name in values)

    return f"{flags(was)}, not {flags(now)}"


def _word(value: Any) -> str:
    return ("on" if value else "off") if isinstance(value, bool) else str(value)


def _hash(*parts: bytes) -> str:
    whole = hashlib.sha256()
    for part in parts:
        whole.update(len(part).to_bytes(8, "little") + part)
    return whole.hexdigest()


class Stored(Owner, ABC):
    """Whose records can be kept in files: a Renderer."""

    scheduler: RecordScheduler

    @abstractmethod
    def _use(self) -> None: ...

    @abstractmethod
    def forget(self, records: bool = True, lights: bool = True) -> None:
        """Draw everything again."""

    def save_cache(self, path: str | os.PathLike[str]) -> None:
        """Write the records to a file, whole or not at all; `load_cache` goes on from it, to the bit as if nothing had happened.

        Raises InputError where `path` cannot be written to, IrrsplatError where writing fails.
        """
        self._use()
        files.check_file(path)
        save(path, self.scheduler)

    def load_cache(self, path: str | os.PathLike[str]) -> None:
        """Take the records of a file in place of those that there are.

        Raises InputError, and changes nothing, where it is missing, no record cache or damaged, or where its records belong to
        another scene, other lights or other settings than this renderer's (those by which records are gathered; see `key`).
        """
        self._use()
        load(path, self.scheduler)
        self.forget(records=False)
