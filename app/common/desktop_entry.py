"""Desktop menu entry and icon of irrsplat, at one user's places by freedesktop.org's specifications.

A wheel's data files do not suffice: pip and pipx put them into the environment, outside the desktop's search path.
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

from irrsplat.core.errors import IrrsplatError
from irrsplat.core.files import write_text

NAME = "irrsplat"
KINDS = "model/gltf-binary;model/gltf+json;model/obj;model/stl;application/x-ply;"
_QUOTED = '"`$\\'  # characters escaped within quotes in an Exec line


def data_home() -> Path:
    """Return the user's data folder, $XDG_DATA_HOME or ~/.local/share; raise IrrsplatError on systems without it."""
    if sys.platform in ("win32", "darwin"):
        raise IrrsplatError("this system has no desktop entries; make a shortcut to the command irrsplat")
    named = os.environ.get("XDG_DATA_HOME", "")
    return Path(named) if os.path.isabs(named) else Path("~/.local/share").expanduser()


def files(home: Path) -> tuple[Path, Path]:
    """Return the entry and the icon of `install` below `home`."""
    return home / f"applications/{NAME}.desktop", home / f"icons/hicolor/scalable/apps/{NAME}.svg"


def install(home: Path) -> list[Path]:
    """Write the entry and the icon; return the written files."""
    picture = Path(__file__).with_name(f"{NAME}.svg").read_text(encoding="utf-8")
    for path, text in zip(files(home), (entry(command()), picture), strict=True):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise IrrsplatError(f"{path.parent}: cannot be made: {error.strerror}") from error
        write_text(path, text)
    _notice(home)
    return list(files(home))


def remove(home: Path) -> list[Path]:
    """Remove the files of `install`; return the removed files."""
    there = [path for path in files(home) if path.is_file()]
    for path in there:
        path.unlink()
    _notice(home)
    return there


def command() -> list[str]:
    """Return the words that run this irrsplat: the called script, the one on the path, or this Python."""
    called = Path(sys.argv[0])
    found = str(called.resolve()) if called.name == NAME and called.is_file() else shutil.which(NAME)
    return [found] if found else [sys.executable, "-m", NAME]


def entry(words: list[str]) -> str:
    """Return the desktop entry; `words` open a window, also for a file dropped on the icon."""
    quoted = " ".join('"' + "".join("\\" * (c in _QUOTED) + c for c in word).replace("%", "%%") + '"' for word in words)
    # the value is itself a string with escapes
    executed = f"{quoted} view %f".replace("\\", "\\\\")
    return (
        "[Desktop Entry]\n"
        "Type=Application\n"
        "Name=irrsplat\n"
        "GenericName=Global illumination viewer\n"
        "Comment=Walk through diffuse scenes with indirect light\n"
        f"Exec={executed}\n"
        f"Icon={NAME}\n"
        f"StartupWMClass={NAME}\n"
        "Terminal=false\n"
        "Categories=Graphics;3DGraphics;Viewer;\n"
        f"MimeType={KINDS}\n"
    )


def _notice(home: Path) -> None:
    """Update the folder's time, so that desktops search it again."""
    icons = home / "icons/hicolor"
    if icons.is_dir():
        os.utime(icons)
