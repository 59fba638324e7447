"""Files that are written completely or not at all: under a temporary name beside their place first, then renamed."""

from __future__ import annotations

import os
import secrets
import shutil
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from irrsplat.core.errors import InputError, IrrsplatError

Pathlike = str | os.PathLike[str]


def check_file(path: Pathlike) -> None:
    """Raises InputError where `path` cannot be written as a file; leaves nothing behind."""
    text = os.fspath(path)
    if os.path.isdir(text) or text.endswith(("/", os.sep)):
        raise InputError("cannot write: it is a folder, not a file", text)
    target = Path(os.path.realpath(text))
    try:
        mode = target.stat().st_mode
    except FileNotFoundError:
        mode = stat.S_IFREG
    except OSError as error:  # a name too long, a file where a folder should be, …
        raise InputError(f"cannot write: {error.strerror or error}", text) from error
    if not stat.S_ISREG(mode):
        raise InputError("cannot write: it is not a regular file", text)
    if target.is_file() and not os.access(target, os.W_OK):
        raise InputError("cannot write: permission denied", text)
    _try_inside(target.parent, text)


def write_text(path: Pathlike, text: str) -> None:
    """Write `text` (UTF-8) to `path`, completely or not at all; raises IrrsplatError where that fails."""
    _write_file(path, lambda part: part.write_text(text, encoding="utf-8"))


def write_bytes(path: Pathlike, data: bytes) -> None:
    """Write `data` to `path`, completely or not at all; raises IrrsplatError where that fails."""
    _write_file(path, lambda part: part.write_bytes(data))


def write_picture(path: Pathlike, display: np.ndarray) -> None:
    """Write display values 0..1, (H, W, 3) or with alpha (H, W, 4), as a PNG, completely or not at all; raises IrrsplatError
    where that fails."""
    _write_file(path, lambda part: _png(part, display))


def _png(path: Path, display: np.ndarray) -> None:
    from PIL import Image

    Image.fromarray(eight_bits(display)).save(path, "PNG")


def eight_bits(display: np.ndarray) -> np.ndarray:
    """Display values 0..1, any shape, as uint8."""
    found: np.ndarray = np.round(np.clip(display, 0.0, 1.0) * 255.0).astype(np.uint8)
    return found


def _part(folder: Path, ending: str = "") -> Path:
    """A temporary name in `folder` that no file has."""
    return folder / f".irrsplat-{secrets.token_hex(6)}.part{ending}"


@contextmanager
def _naming(path: Pathlike) -> Iterator[None]:
    """Turns errors of the system, numpy or OpenEXR while writing into one IrrsplatError that names `path`."""
    try:
        yield
    except (OSError, RuntimeError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else "") or str(error) or type(error).__name__
        raise IrrsplatError(f"{os.fspath(path)}: cannot write: {reason}") from error


def _write_file(path: Pathlike, write: Callable[[Path], object]) -> None:
    """Let `write` fill a temporary file beside `path`, then rename it: at no time is `path` half written."""
    target = Path(os.path.realpath(path))  # what a link points to is replaced, not the link
    part = _part(target.parent, target.suffix)
    try:
        with _naming(path):
            write(part)
            os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)


def _write_folder(folder: Path, pictures: Iterator[tuple[str, np.ndarray]]) -> None:
    """Write all pictures into a new folder, then rename it, or the files in it where `folder` exists already."""
    exists = folder.is_dir()
    part = _part(folder if exists else folder.parent)
    try:
        with _naming(folder):
            part.mkdir()
            names = []
            for name, display in pictures:
                _png(part / name, display)
                names.append(name)
            if not exists:
                os.replace(part, folder)
                return
            for name in names:
                os.replace(part / name, folder / name)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _try_folder(text: str) -> None:
    folder = Path(os.path.realpath(text))
    if not text:
        raise InputError("an output path is empty")
    if os.path.lexists(folder) and not folder.is_dir():
        raise InputError("cannot write: it exists and is not a folder; give an ending or another name", text)
    _try_inside(folder if folder.is_dir() else folder.parent, text)


def _try_inside(folder: Path, text: str) -> None:
    """Raises InputError, naming `text`, where no file can be made in `folder`."""
    if not folder.is_dir():
        raise InputError(f"cannot write: the folder '{folder}' does not exist; make it first", text)
    part = _part(folder)
    try:
        part.touch(exist_ok=False)
    except OSError as error:
        raise InputError(f"cannot write: {error.strerror or error}", text) from error
    finally:
        with suppress(OSError):
            part.unlink()
