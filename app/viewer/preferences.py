"""Choices of the user, kept as JSON in the configuration folder from one run to the next."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import cast

import platformdirs

from irrsplat.core import paths
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.core.files import write_text
from irrsplat.scene import bundled
from irrsplat.settings import PRESETS, SETTINGS, SettingValues

VERSION = 1  # of the file
RECENT = 10  # scenes
SIDE = 32768  # pixels: no window is wider or higher
_FILE = "viewer.json"


@dataclass
class Preferences:
    """The choices of the user.

    size: of the window, pixels. values: the settings that differ from the preset. ui: what else is on, plain JSON.
    scale: of text and widgets.

    recent: scenes, newest first, at most RECENT, each an absolute path or a bundled scene's name.
    """

    size: tuple[int, int] | None = None
    fullscreen: bool = False
    preset: str = "default"
    values: SettingValues = field(default_factory=SettingValues)
    ui: dict[str, object] = field(default_factory=dict)
    scale: float = 1.0
    recent: list[str] = field(default_factory=list)

    def opened(self, source: str) -> None:
        """Put a scene (a path, or a bundled one's name) in front of the recent ones."""
        newest, real = os.path.abspath(source), Path(os.path.realpath(source))
        if not os.path.isfile(source):
            newest = source if source in bundled() else newest
        elif real == paths.folder("scenes") / real.stem / f"{real.stem}.scene":
            newest = real.stem
        self.recent = [newest, *(other for other in self.recent if other != newest)][:RECENT]


def folder() -> Path:
    """Return the folder of the file: what IRRSPLAT_CONFIG names, else the user's own. Raises IrrsplatError for none."""
    if named := os.environ.get("IRRSPLAT_CONFIG"):
        return Path(named)
    found = platformdirs.user_config_path("irrsplat", appauthor=False)
    if not found.is_absolute():
        raise IrrsplatError("there is no home folder to remember things in; name a folder in IRRSPLAT_CONFIG")
    return found


def save(preferences: Preferences) -> str | None:
    """Write `preferences`, completely or not at all. Return None, or the reason of a failure in one line."""
    try:
        path = folder() / _FILE
        # in ASCII, so that a path that is not Unicode survives as lone surrogates
        text = json.dumps({"version": VERSION} | asdict(preferences), indent=1, allow_nan=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text + "\n")
    except (IrrsplatError, OSError, TypeError, ValueError, RecursionError) as error:
        return _line(error if isinstance(error, IrrsplatError) else f"{path}: cannot write: {error}")
    return None


def load() -> tuple[Preferences, list[str]]:
    """Return the saved preferences, or defaults and a one-line notice for a file that cannot be used; never raise.

    Settings that this version does not have are left out.
    """
    try:
        data = json.loads((folder() / _FILE).read_text(encoding="utf-8"))
        if data.pop("version") != VERSION:
            raise ValueError(f"not of version {VERSION}")
        found = Preferences(**data)
        found.size = found.size and _size(*found.size)
        found.values = cast(SettingValues, {name: value for name, value in found.values.items() if _fits(name, value)})
        found.recent = [source for source in found.recent if os.path.isabs(source) or source in bundled()]
        if found.preset not in PRESETS or not isinstance(found.ui, dict) or not isinstance(found.scale, (int, float)):
            raise ValueError("no preferences of the viewer")
    except FileNotFoundError:
        return Preferences(), []
    except (IrrsplatError, OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        return Preferences(), [_line(f"{_FILE} cannot be used ({error}); defaults replace it")]
    return found, []


def _size(width: int, height: int) -> tuple[int, int]:
    if not all(type(side) is int and 1 <= side <= SIDE for side in (width, height)):
        raise ValueError(f"a window of {width}x{height} pixels")
    return width, height


def _fits(name: str, value: object) -> bool:
    """Return True if a setting of this name may have this value."""
    try:
        return name in SETTINGS and SETTINGS[name].check(value) == value
    except (InputError, OverflowError):
        return False


def _line(said: object) -> str:
    return " ".join(str(said).split())
