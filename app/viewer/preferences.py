"""Choices of the user, saved as JSON in the configuration folder for the next run."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path

from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.core.files import write_text
from irrsplat.core.paths import user_folder
from irrsplat.core.words import quote
from irrsplat.scene import bundled

RECENT = 10  # the greatest number of recent scenes
LARGEST = 16384  # pixels: the greatest side of a window; X allows 32767, but few OpenGL drivers have textures larger than this
_FILE = "viewer.json"


@dataclass
class Preferences:
    """The choices of the user.

    size: size of the window, pixels. recent: scenes, newest first, at most RECENT. Each is an absolute path or the name of a
    bundled scene.
    """

    size: tuple[int, int] | None = None
    recent: list[str] = field(default_factory=list)

    def opened(self, source: str) -> None:
        """Put a scene (a path, or the name of a bundled scene) at the front of the recent scenes."""
        newest = source if source in bundled() and not os.path.isfile(source) else os.path.abspath(source)
        self.recent = [newest, *(other for other in self.recent if other != newest)][:RECENT]


def check_path(source: str) -> None:
    """Raise InputError for a scene whose path is not UTF-8: neither the window nor the library of its interface can show it."""
    try:
        (os.path.abspath(source) if os.path.exists(source) else source).encode()
    except UnicodeEncodeError:
        raise InputError(f"{quote(source)}: the viewer opens paths in UTF-8 only; rename the file or its folder") from None


def folder() -> Path:
    """Return the folder of the file: the one in IRRSPLAT_CONFIG, else the user's own. Raises IrrsplatError for none."""
    found = user_folder("config")
    if found is None:
        raise IrrsplatError("there is no home folder for the preferences; name a folder in IRRSPLAT_CONFIG")
    return found


def save(preferences: Preferences) -> str | None:
    """Write `preferences`, completely or not at all. Return None, or the reason of a failure in one line."""
    try:
        path = folder() / _FILE
        # ASCII keeps a path that is not Unicode, as escaped lone surrogates
        text = json.dumps(asdict(preferences), indent=1, allow_nan=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text + "\n")
    except (IrrsplatError, OSError) as error:
        return " ".join(f"cannot write the preferences: {error}".split())
    return None


def load() -> tuple[Preferences, list[str]]:
    """Return the saved preferences. Defaults replace a damaged file, with a one-line notice. Never raise."""
    try:
        data = json.loads((folder() / _FILE).read_bytes().decode("utf-8-sig"))
        size = data["size"] and tuple(map(int, data["size"]))
        if size and not (len(size) == 2 and 0 < min(size) <= max(size) <= LARGEST):
            raise ValueError("wrong size")
        recent = [source for source in data["recent"] if os.path.isabs(source) or source in bundled()]
        return Preferences(size, list(dict.fromkeys(recent))[:RECENT]), []
    except FileNotFoundError:
        return Preferences(), []
    except (IrrsplatError, OSError, ValueError, TypeError, LookupError, OverflowError, RecursionError) as error:
        return Preferences(), [" ".join(f"{_FILE} cannot be used ({error}); defaults replace it".split())]
