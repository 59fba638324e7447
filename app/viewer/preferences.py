"""Choices and bookmarks of the user, kept as JSON in the configuration folder from one run to the next."""

from __future__ import annotations

import json
import os
import reprlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, cast

import platformdirs

from irrsplat.core import paths
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.core.files import write_text
from irrsplat.core.words import GREATEST, quote
from irrsplat.scene import Camera, bundled
from irrsplat.settings import PRESETS, SETTINGS, SettingValues, check_name

VERSION = 1  # of both files
RECENT = 10  # scenes
SIDE = 32768  # pixels: no window is wider or higher
_CHOICES, _BOOKMARKS = "viewer.json", "bookmarks.json"


@dataclass
class Preferences:
    """The choices of the user.

    size: of the window, pixels. values: the settings that differ from the preset. ui: what else is on, plain JSON.

    recent: scenes, newest first, at most RECENT, each an absolute path or a bundled scene's name.
    """

    size: tuple[int, int] | None = None
    fullscreen: bool = False
    preset: str = "default"
    values: SettingValues = field(default_factory=SettingValues)
    ui: dict[str, object] = field(default_factory=dict)
    recent: list[str] = field(default_factory=list)

    def opened(self, source: str) -> None:
        """Put a scene (a path, or a bundled one's name) in front of the recent ones."""
        newest = _key(source, os.path.abspath)
        self.recent = [newest, *(other for other in self.recent if other != newest)][:RECENT]


def folder() -> Path:
    """The folder of both files: what IRRSPLAT_CONFIG names, else the user's own; IrrsplatError where there is none."""
    if named := os.environ.get("IRRSPLAT_CONFIG"):
        return Path(named)
    found = platformdirs.user_config_path("irrsplat", appauthor=False)
    if not found.is_absolute():
        raise IrrsplatError("there is no home folder to remember things in; name a folder in IRRSPLAT_CONFIG")
    return found


def load() -> tuple[Preferences, list[str]]:
    """Return the saved preferences, and a one-line notice for each wrong entry of either file; never raise.

    A file that is damaged or of another version is renamed to ``….broken``, and defaults are used. A missing one gives no notice.
    """
    notices: list[str] = []
    preferences = _checked(_peek(_CHOICES, notices), notices)
    for key, entries in _peek(_BOOKMARKS, notices).get("scenes", {}).items():
        if len(_cameras(entries)) != (len(entries) if isinstance(entries, list) else -1):
            notices.append(f"{_BOOKMARKS}: some bookmarks of {quote(key)} are damaged; left out")
    return preferences, list(dict.fromkeys(notices))  # a missing folder would be told twice


def save(preferences: Preferences) -> str | None:
    """Write `preferences`; None, or one line: why that failed, or which damaged file was renamed and written anew."""
    return _write(_CHOICES, lambda _: asdict(preferences))


def bookmarks(scene_path: str) -> list[Camera]:
    """The cameras kept for the scene at a path (links are followed), or for the bundled one of that name; never raises."""
    return _cameras(_peek(_BOOKMARKS, []).get("scenes", {}).get(_key(scene_path), []))


def set_bookmarks(scene_path: str, cameras: Sequence[Camera]) -> str | None:
    """Keep `cameras` for that scene instead of those before; the answer is as `save`'s.

    Those of other scenes stay as the file has them now, since another viewer may have written them meanwhile.
    """
    key = _key(scene_path)
    points = ("eye", "target", "up")
    kept = [{"name": c.name, **{p: [float(x) for x in getattr(c, p)] for p in points}, "fov": float(c.fov)} for c in cameras]

    return _write(_BOOKMARKS, lambda data: {"scenes": {**data.get("scenes", {}), key: kept}})


def _peek(name: str, notices: list[str]) -> dict[str, Any]:
    """Return the content of a file; {} and a notice if it cannot be read."""
    try:
        data, said = _read(folder() / name)
    except IrrsplatError as error:
        data, said = {}, [_line(error)]
    notices += said
    return data


def _read(path: Path) -> tuple[dict[str, Any], list[str]]:
    """The object in a file, and notices; {} where there is no file, or a damaged one, which is then renamed.

    Raises IrrsplatError where the file can neither be read nor renamed, so that it is not overwritten.
    """
    try:
        data = json.loads(path.read_bytes().decode("utf-8-sig"))
        json.dumps(data, allow_nan=False)  # NaN and infinity are no JSON
        if not isinstance(data, dict) or not isinstance(data.get("scenes", {}), dict):
            raise ValueError("not what irrsplat writes")
        if data.get("version") != VERSION:
            raise ValueError(f"not of version {VERSION}")
        return data, []
    except FileNotFoundError:
        return {}, []
    except OSError as error:
        raise IrrsplatError(f"{path}: cannot read: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        aside, n = path.with_name(path.name + ".broken"), 1
        while os.path.lexists(aside):
            n += 1
            aside = path.with_name(f"{path.name}.broken-{n}")
        try:
            os.rename(path, aside)
        except OSError as failed:
            raise IrrsplatError(f"{path}: damaged, but cannot be renamed: {failed.strerror or failed}") from error
        return {}, [_line(f"{path}: cannot be used ({error}); it is now called {aside.name}, and defaults stand in")]


def _write(name: str, change: Callable[[dict[str, Any]], dict[str, Any]]) -> str | None:
    """Replace what a file holds now by `change` of it, completely or not at all; the answer is as `save`'s."""
    try:
        path = folder() / name
        data, notices = _read(path)
        # in ASCII, so that a path that is not Unicode survives as lone surrogates
        text = json.dumps({"version": VERSION} | change(data), indent=1, allow_nan=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text + "\n")
    except (IrrsplatError, OSError, TypeError, ValueError, RecursionError) as error:
        return _line(error if isinstance(error, IrrsplatError) else f"{path}: cannot write: {error}")
    return notices[0] if notices else None


_GOOD: dict[str, Callable[[Any], bool]] = {
    "size": lambda it: it is None or (isinstance(it, list) and [type(n) is int and 1 <= n <= SIDE for n in it] == [True] * 2),
    "fullscreen": lambda it: isinstance(it, bool),
    "preset": lambda it: isinstance(it, str) and it in PRESETS,
    "values": lambda it: isinstance(it, dict),
    "ui": lambda it: isinstance(it, dict),
    "recent": lambda it: isinstance(it, list),
}


def _checked(data: dict[str, Any], notices: list[str]) -> Preferences:
    """The Preferences of what a file holds; what is wrong in it is left out, and `notices` says so."""
    defaults = asdict(Preferences())
    given = {name: data.get(name, default) for name, default in defaults.items()}
    wrong = [(f"'{name}'", given[name]) for name, good in _GOOD.items() if not good(given[name])]
    given = {name: value if _GOOD[name](value) else defaults[name] for name, value in given.items()}
    preferences = Preferences(**given | {"size": given["size"] and tuple(given["size"]), "values": {}, "recent": []})
    values: dict[str, object] = {}
    for name, value in given["values"].items():
        try:
            check_name(name)
            values[name] = SETTINGS[name].check(value)
        except (InputError, OverflowError):
            wrong.append((f"setting {quote(name)}", value))
    for source in given["recent"]:
        if not isinstance(source, str) or not (os.path.isabs(source) or source in bundled()):
            wrong.append(("a recent scene", source))
        elif source not in preferences.recent and len(preferences.recent) < RECENT:
            preferences.recent.append(source)
    preferences.values = cast(SettingValues, values)
    notices += [f"{_CHOICES}: {what} cannot be {reprlib.repr(value)}; left out" for what, value in wrong]
    return preferences


def _cameras(entries: Any) -> list[Camera]:
    """The cameras of a JSON list; entries that are not cameras are left out."""
    found = []
    for entry in entries if isinstance(entries, list) else []:
        with suppress(InputError, KeyError, TypeError, ValueError):
            eye, target, up = ((x, y, z) for x, y, z in (entry["eye"], entry["target"], entry["up"]))
            numbers = (*eye, *target, *up, entry["fov"])
            if isinstance(entry["name"], str) and all(type(x) in (int, float) and abs(x) <= GREATEST for x in numbers):
                found.append(Camera(eye, target, up, entry["fov"], entry["name"]))
    return found


def _key(source: str, absolute: Callable[[str], str] = os.path.realpath) -> str:
    """The name of the bundled scene that `source`, a path or a name, stands for, else its absolute path."""
    if not os.path.isfile(source):
        return source if source in bundled() else absolute(source)
    path = Path(os.path.realpath(source))
    return path.stem if path == paths.folder("scenes") / path.stem / f"{path.stem}.scene" else absolute(source)


def _line(said: object) -> str:
    return " ".join(str(said).split())
