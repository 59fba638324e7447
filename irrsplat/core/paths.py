"""Where files are: the bundled shaders and scenes, and the folder for what is kept between runs."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent  # irrsplat/


@cache
def folder(name: str) -> Path:
    """The folder of bundled data called `name` ("shaders" or "scenes")."""
    for candidate in (_PACKAGE / name, _PACKAGE.parent / name):
        if candidate.is_dir():
            return candidate
    raise FileNotFoundError(f"the bundled folder '{name}' is missing; install irrsplat again")


def cache_folder() -> Path | None:
    """The folder that IRRSPLAT_CACHE names, else the user's cache folder; None for a user without a home."""
    if named := os.environ.get("IRRSPLAT_CACHE"):
        return Path(named)
    import platformdirs

    found = platformdirs.user_cache_path("irrsplat", appauthor=False)
    return found if found.is_absolute() else None
