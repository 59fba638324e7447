"""Atomic writing of files: under a temporary name in the same folder, then renamed."""

from __future__ import annotations

import errno
import io
import json
import math
import os
import secrets
import shutil
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from irrsplat.core.errors import InputError, IrrsplatError

try:
    import fcntl
except ImportError:  # Windows lacks these locks
    fcntl = None  # type: ignore[assignment]

Pathlike = str | os.PathLike[str]

# exceptions of reading a damaged file of numbers, such as an NPZ with JSON
DAMAGE = (
    ValueError, KeyError, TypeError, AttributeError, OSError, EOFError, RecursionError, ArithmeticError, MemoryError,
    NotImplementedError, SyntaxError, struct.error, zipfile.BadZipFile, zlib.error,
)  # fmt: skip

_HEADER = 1 << 20  # bytes of an EXR's header, at most
_CHUNK = 16  # rows per ZIP chunk of an EXR


def check_file(path: Pathlike) -> None:
    """Raise InputError if `path` cannot be written as a file; leaves nothing behind."""
    text = os.fspath(path)
    if os.path.isdir(text) or text.endswith(("/", os.sep)):
        raise InputError("cannot write: it is a folder, not a file", text)
    target = Path(os.path.realpath(text))
    try:
        mode = target.stat().st_mode
    except FileNotFoundError:
        mode = stat.S_IFREG
    except OSError as error:  # a name too long, a file in place of a folder, …
        raise InputError(f"cannot write: {error.strerror or error}", text) from error
    if not stat.S_ISREG(mode):
        raise InputError("cannot write: it is not a regular file", text)
    if target.is_file() and not os.access(target, os.W_OK):
        raise InputError("cannot write: permission denied", text)
    _try_inside(target.parent, text)


def make_folder(folder: Path) -> None:
    """Make a folder and its parents unless they exist; raises InputError if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make this folder: {error.strerror or error}", folder) from None


def write_text(path: Pathlike, text: str) -> None:
    """Write `text` (UTF-8) to `path`, completely or not at all; raises IrrsplatError if that fails."""
    write_file(path, lambda part: part.write_text(text, encoding="utf-8", errors="surrogateescape"))


def json_text(value: object, indent: int | None = 2) -> str:
    """Return strict JSON: numpy's values become plain ones, non-finite numbers null, file names text."""
    return json.dumps(_plain(value), indent=indent, allow_nan=False, ensure_ascii=False)


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, (np.generic, np.ndarray)):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, (int, float)):
        return value
    return str(value).encode("utf-8", "surrogateescape").decode("utf-8", "replace")  # names in a locale without UTF-8


def write_bytes(path: Pathlike, data: bytes) -> None:
    """Write `data` to `path`, completely or not at all; raises IrrsplatError if that fails."""
    write_file(path, lambda part: part.write_bytes(data))


def write_arrays(path: Pathlike, arrays: Mapping[str, np.ndarray]) -> None:
    """Write `arrays` as a compressed NPZ, completely or not at all; raises IrrsplatError if that fails."""
    data = io.BytesIO()
    np.savez_compressed(data, **arrays)  # type: ignore[arg-type]  # numpy's stub takes a further keyword for an array
    write_bytes(path, data.getvalue())


def write_picture(path: Pathlike, display: np.ndarray) -> None:
    """Write display values 0..1, (H, W, 3) or with alpha (H, W, 4), as a PNG of 8 bits per channel, completely or not
    at all; raises IrrsplatError if that fails."""
    write_bytes(path, as_png(display))


def as_png(display: np.ndarray) -> bytes:
    """Return display values 0..1, (H, W, 3) or (H, W, 4), as a PNG file of 8 bits."""
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(eight_bits(display)).save(data, "PNG")
    return data.getvalue()


def dithered(display: np.ndarray, first: int = 0) -> np.ndarray:
    """Return display values 0..1, (H, W, 3) or with alpha (H, W, 4), as uint8 with dithered colours, to prevent banding.

    The probability of rounding up is the fraction, by interleaved gradient noise (Jimenez 2014), which depends on the pixel only.
    first: number of the first row in its picture.
    """
    rows, columns = np.ogrid[first : first + len(display), : display.shape[1]]
    noise = np.modf(52.9829189 * np.modf(0.06711056 * columns + 0.00583715 * rows)[0])[0]
    found = eight_bits(display)
    found[..., :3] = np.clip(display[..., :3] * 255.0 + noise[..., None], 0.0, 255.0)
    return found


def eight_bits(display: np.ndarray) -> np.ndarray:
    """Return display values 0..1, any shape, as uint8."""
    return np.asarray(np.round(np.clip(display, 0.0, 1.0) * 255.0).astype(np.uint8))


def write_layers(path: Path, layers: Mapping[str, np.ndarray], rows: int, header: Mapping[str, object] | None = None) -> None:
    """Write float32 layers with `rows` rows, and these attributes, as an EXR; raises OSError if the file is truncated."""
    import OpenEXR

    fixed = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File({**fixed, **(header or {})}, dict(layers)) as file:
        file.write(str(path))
    check_exr(path, rows)


def check_exr(path: Path, rows: int) -> None:
    """Raise OSError if a ZIP-compressed EXR of `rows` is truncated: OpenEXR reports no error on a full disk."""
    with open(path, "rb") as file:
        text, at = file.read(_HEADER), 8
        try:
            while text[at]:  # an attribute: name and type, each zero-terminated, size, and content
                value = text.index(0, text.index(0, at) + 1) + 1
                at = value + 4 + int.from_bytes(text[value : value + 4], "little")
            file.seek(at + 1)
            last = int(np.frombuffer(file.read(8 * -(-rows // _CHUNK)), "<u8")[-1])
            file.seek(last)
            end = last + 8 + int.from_bytes(file.read(8)[4:], "little") if last else 0
        except (IndexError, ValueError):
            end = 0
    if not 0 < end <= path.stat().st_size:
        raise OSError(errno.ENOSPC, "the file was cut short; is there room for it?")


@contextmanager
def _part(folder: Path, make: Callable[[Path], object], ending: str = "") -> Iterator[Path]:
    """Yield a temporary file or folder in `folder`, made by `make` and removed at the end."""
    part = folder / f".irrsplat-{secrets.token_hex(6)}.part{ending}"
    try:
        make(part)
        yield part
    finally:
        if part.is_dir():
            shutil.rmtree(part, ignore_errors=True)
        else:
            part.unlink(missing_ok=True)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Exclude other processes from this block for `folder`, if the file system has locks."""
    handle = None
    try:
        with suppress(OSError):
            handle = os.open(folder, os.O_RDONLY) if fcntl is not None else None
            if handle is not None:
                fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        if handle is not None:
            os.close(handle)


def _put(part: Path, target: Path) -> None:
    """Rename `part` to `target` after syncing its content, so that a power cut leaves one of both whole."""
    _sync(part)
    os.replace(part, target)
    with suppress(OSError):  # some file systems cannot sync a folder; the file is in place
        _sync(target.parent)


def _sync(path: Path) -> None:
    """Sync a file or folder to the disk; Windows can do that only for a process's open files."""
    if fcntl is None:
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _keep_mode(part: Path, target: Path) -> None:
    """Give `part` the permissions of the replaced file, before any content is written."""
    with suppress(FileNotFoundError):
        part.chmod(stat.S_IMODE(target.stat().st_mode) & 0o777)


@contextmanager
def _naming(path: Pathlike) -> Iterator[None]:
    """Turn errors of the system, numpy or OpenEXR while writing into one IrrsplatError that names `path`."""
    try:
        yield
    except (OSError, RuntimeError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else "") or str(error) or type(error).__name__
        raise IrrsplatError(f"{os.fspath(path)}: cannot write: {reason}") from error


def write_file(path: Pathlike, write: Callable[[Path], object]) -> None:
    """Let `write` fill a temporary file in the same folder, then rename it to `path`, which is never half written.

    A symbolic link stays, and its target is replaced. Permissions stay; other hard links keep the old content. The content is
    synced before the rename.
    """
    target = Path(os.path.realpath(path))
    with _naming(path), _part(target.parent, lambda part: part.touch(exist_ok=False), target.suffix) as part:
        _keep_mode(part, target)
        write(part)
        _put(part, target)


def _write_folder(folder: Path, pictures: Iterator[tuple[str, np.ndarray]]) -> None:
    """Write all pictures into a new folder, then rename the folder, or its files if `folder` exists."""
    exists = folder.is_dir()
    inside = folder if exists else folder.parent
    with _naming(folder), _part(inside, Path.mkdir) as part:
        names = []
        for name, display in pictures:
            (part / name).touch()
            _keep_mode(part / name, folder / name)
            (part / name).write_bytes(as_png(display))
            names.append(name)
        if exists:
            for name in names:
                _put(part / name, folder / name)
            return
        for name in names:
            _sync(part / name)
        _put(part, folder)


def _try_folder(text: str) -> None:
    folder = Path(os.path.realpath(text))
    if text in ("", "-"):
        raise InputError("an output path is empty" if not text else "-: no output goes to stdout here; name a file or a folder")
    if os.path.lexists(folder) and not folder.is_dir():
        raise InputError("cannot write: it exists and is not a folder; give an ending or another name", text)
    _try_inside(folder if folder.is_dir() else folder.parent, text)


def _try_inside(folder: Path, text: str) -> None:
    """Raise InputError, naming `text`, if no file can be made in `folder`."""
    if not folder.is_dir():
        raise InputError(f"cannot write: the folder '{folder}' does not exist; make it first", text)
    try:
        with _part(folder, lambda part: part.touch(exist_ok=False)):
            pass
    except OSError as error:
        raise InputError(f"cannot write: {error.strerror or error}", text) from error
