"""Paths, permissions and size limits of files: every file of a scene is read by `read_bytes`."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Literal

from irrsplat.core.errors import InputError
from irrsplat.core.words import spelled

_LFS_POINTER = b"version https://git-lfs.github.com/spec/"  # stands for a large file in a clone without Git LFS
_PACKAGE = Path(__file__).resolve().parent.parent  # irrsplat/

# Size limits of files, in bytes; docs/scene-format.md states them.
MOST_TEXT = 8 << 20  # scenes, lights, materials, photometry, paths
MOST_IMAGE = 1 << 30  # images and sky maps, compressed
MOST_GEOMETRY = 4 << 30  # OBJ, PLY, STL, glTF and its buffers; record caches

# Limit for all images of a scene together: pixels, and further pixels per byte of their files.
FREE_PIXELS = 1 << 26
PIXELS_PER_BYTE = 256

MOST_SEARCHES = 1000  # file names of a scene that are searched in other spellings, at about a millisecond each
MOST_COPIES = 1 << 24  # vertices of all copies of meshes together: a line of text makes millions


@cache
def folder(name: str) -> Path:
    """Return the folder of bundled data called `name` ("shaders" or "scenes")."""
    for candidate in (_PACKAGE / name, _PACKAGE.parent / name):
        if candidate.is_dir():
            return candidate
    raise FileNotFoundError(f"the bundled folder '{name}' is missing; install irrsplat again")


def user_folder(kind: Literal["cache", "config"]) -> Path | None:
    """Return the folder IRRSPLAT_CACHE or IRRSPLAT_CONFIG, else the user's own of this kind; None for a user without a home."""
    if named := os.environ.get(f"IRRSPLAT_{kind.upper()}"):
        return Path(named)
    import platformdirs

    own = {"cache": platformdirs.user_cache_path, "config": platformdirs.user_config_path}[kind]
    found = own("irrsplat", appauthor=False)
    return found if found.is_absolute() else None


# ---- what a scene may read -------------------------------------------------------------------------------------------------


@dataclass
class _Bounds:
    """The permissions of the scene being read: its file and these folders, links resolved, and remaining pixels of images,
    vertices of copies and searches of files.

    listings: the names in each folder that was searched.
    """

    file: Path
    folders: tuple[Path, ...]
    pixels: int = FREE_PIXELS
    copies: int = MOST_COPIES
    searches: int = MOST_SEARCHES
    listings: dict[Path, dict[str, str]] = field(default_factory=dict)


_bounds: ContextVar[_Bounds | None] = ContextVar("bounds", default=None)


@contextmanager
def within(file: Path, others: Sequence[str | os.PathLike[str]] = ()) -> Iterator[None]:
    """Read the scene in `file` within the block; forbid files outside of its folder and the `others`."""
    folders = (file.absolute().parent, *map(Path, others))
    token = _bounds.set(_Bounds(_resolved(file), tuple(map(_resolved, folders))))
    try:
        yield
    finally:
        _bounds.reset(token)


@contextmanager
def anywhere() -> Iterator[None]:
    """Allow all paths within the block, for files that the user has named rather than the scene."""
    token = _bounds.set(None)
    try:
        yield
    finally:
        _bounds.reset(token)


def may_read(path: Path) -> bool:
    """True if the scene being read may read this file, whether it exists or not; False for invalid names."""
    bounds = _bounds.get()
    try:
        place = _resolved(path)
    except (OSError, ValueError):  # NUL, surrogates
        return False
    return bounds is None or place == bounds.file or any(place.is_relative_to(folder) for folder in bounds.folders)


def refusal(path: Path) -> str:
    """Return why `may_read` forbids `path`, and the remedy."""
    try:
        place = _resolved(path).parent
    except (OSError, ValueError):
        return "no file can be called that"
    return f"it lies outside the scene's folder; --allow '{spelled(str(place))}' lets the scene read it"


def read_bytes(path: Path, most: int = MOST_TEXT) -> bytes:
    """Return the bytes of a regular file that the scene may read; raises InputError for a missing, unreadable, empty or other
    one, and for more than `most` bytes."""
    check_readable(path, most)
    try:
        with open(path, "rb", opener=_without_waiting) as file:
            size = os.fstat(file.fileno()).st_size
            data = file.read(size + 1)
            while size < len(data) <= most and (more := file.read(len(data))):  # a growing file, or one without a size (/proc)
                data += more
    except (OSError, ValueError, MemoryError) as error:
        raise InputError(f"cannot read this file: {_reason(error)}", path) from None
    if len(data) > most:
        raise InputError(_too_large(most), path)
    if not data.strip():
        raise InputError("the file is empty", path)
    if data.startswith(_LFS_POINTER):
        raise InputError("this is a pointer of Git LFS to the file; run 'git lfs pull' in its folder", path)
    return data


def check_readable(path: Path, most: int = MOST_TEXT) -> None:
    """Raise InputError like `read_bytes`, for a file that is read in another way."""
    if not may_read(path):
        raise InputError(refusal(path), path)
    try:
        found = os.stat(path)
    except FileNotFoundError:
        raise InputError("there is no such file", path) from None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read this file: {_reason(error)}", path) from None
    if stat.S_ISDIR(found.st_mode):
        raise InputError("this is a directory; give a file in it", path)
    if not stat.S_ISREG(found.st_mode):
        raise InputError("this is no regular file (a pipe or a device); give one", path)
    if found.st_size > most:
        raise InputError(_too_large(most), path)


def _limits() -> _Bounds:
    """Return the limits of the scene being read; all of them where no scene is read."""
    return _bounds.get() or _Bounds(Path(), ())


def take_pixels(pixels: int, size: int) -> bool:
    """True if the scene being read may have an image of `pixels`, from `size` bytes, in addition to its others."""
    bounds = _limits()
    left = bounds.pixels + PIXELS_PER_BYTE * size - pixels
    if left >= 0:
        bounds.pixels = left
    return left >= 0


def take_copies(vertices: int) -> None:
    """Raise InputError if the scene being read may not have further copies of meshes with so many `vertices`."""
    bounds = _limits()
    bounds.copies -= vertices
    if bounds.copies < 0:
        raise InputError(TOO_MANY_COPIES)


def take_search() -> bool:
    """True if another file of the scene being read may be searched in other spellings."""
    bounds = _limits()
    bounds.searches -= 1
    return bounds.searches >= 0


def listing(folder: Path, key: Callable[[str], str]) -> dict[str, str]:
    """Return the names in `folder` by their keys, the least of equal ones; a scene's file reads each folder once.

    Raises OSError for an unreadable folder.
    """
    listings = _limits().listings
    if folder not in listings:
        listings[folder] = {key(name): name for name in sorted(os.listdir(folder), reverse=True)}
    return listings[folder]


TOO_MANY_COPIES = f"meshes that are shown again have more than {MOST_COPIES} vertices together; leave some of them out"


def name_of(text: str) -> str:
    """Return the file name of the UTF-8 `text` in the locale's encoding; a locale without UTF-8 takes its bytes."""
    try:
        os.fsencode(text)
    except UnicodeEncodeError:
        return os.fsdecode(text.encode("utf-8", "surrogatepass"))
    return text


def named(path: object) -> str:
    """Return a caller's path as text; raises InputError if it is not a path."""
    if not isinstance(path, (str, os.PathLike)) or not isinstance(text := os.fspath(path), str):
        raise InputError(f"a path is a text or a pathlib.Path, not {type(path).__name__}")
    try:
        fits = b"\0" not in os.fsencode(text)
    except UnicodeEncodeError:  # a surrogate that stands for no byte
        fits = False
    if not fits:
        raise InputError(f"no file can be called {text!a:.60}")
    return text


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # a pipe that has replaced the file


def _too_large(most: int) -> str:
    return f"the file is larger than {most >> 20} MiB, the most that is read of such files"


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error) or type(error).__name__


def _resolved(path: Path) -> Path:
    return Path(os.path.realpath(path))
