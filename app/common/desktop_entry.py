"""irrsplat in a desktop's menu: the entry and the icons, where freedesktop.org's specifications have them for one user.

A wheel's data files do not do: pip and pipx put them into the environment, where no desktop looks.
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

from irrsplat.app.common.icon import SIZES, icon, svg
from irrsplat.core.errors import IrrsplatError
from irrsplat.core.files import write_picture, write_text

NAME = "irrsplat"
KINDS = "model/gltf-binary;model/gltf+json;model/obj;model/stl;application/x-ply;"
_QUOTED = '"`$\\'  # what an Exec line needs a backslash before, within quotes


def data_home() -> Path:
    """The folder of the user's data, $XDG_DATA_HOME or ~/.local/share; IrrsplatError where desktops do not look there."""
    if sys.platform in ("win32", "darwin"):
        raise IrrsplatError("menus of this system know no desktop entries; make a shortcut to the command irrsplat yourself")
    named = os.environ.get("XDG_DATA_HOME", "")
    return Path(named) if os.path.isabs(named) else Path("~/.local/share").expanduser()


def files(home: Path) -> dict[Path, int | None]:
    """The files that `install` writes below `home`: icons with their side in pixels, None for the others."""
    icons = home / "icons/hicolor"
    found: dict[Path, int | None] = {icons / f"{side}x{side}/apps/{NAME}.png": side for side in SIZES}
    return {home / f"applications/{NAME}.desktop": None, icons / f"scalable/apps/{NAME}.svg": None, **found}


def install(home: Path) -> list[Path]:
    """Write the entry and the icons; the files that were written."""
    for path, side in files(home).items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise IrrsplatError(f"{path.parent}: cannot be made: {error.strerror}") from error
        if side is not None:
            write_picture(path, icon(side))
        else:
            write_text(path, svg() if path.suffix == ".svg" else entry(command()))
    _notice(home)
    return list(files(home))


def remove(home: Path) -> list[Path]:
    """Remove what `install` has written; the files that were there."""
    there = [path for path in files(home) if path.is_file()]
    for path in there:
        path.unlink()
    _notice(home)
    return there


def command() -> list[str]:
    """The words that run this irrsplat: the script that was called, else the one on the path, else by this Python."""
    called = Path(sys.argv[0])
    found = str(called.resolve()) if called.name == NAME and called.is_file() else shutil.which(NAME)
    return [found] if found else [sys.executable, "-m", NAME]


def entry(words: list[str]) -> str:
    """The desktop entry, by which `words` open a window, and a file that is dropped on it."""
    quoted = " ".join('"' + "".join("\\" * (c in _QUOTED) + c for c in word).replace("%", "%%") + '"' for word in words)
    # the value as a whole is a string with escapes of its own
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
    """Desktops look again where the time of this folder changes."""
    icons = home / "icons/hicolor"
    if icons.is_dir():
        os.utime(icons)
