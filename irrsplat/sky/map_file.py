"""Readers of linear radiance images: Radiance's `.hdr` (RGBE) and OpenEXR's `.exr`."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import Any

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.paths import MOST_IMAGE, check_readable, read_bytes
from irrsplat.core.words import is_number, number, quote

ENDINGS = (".hdr", ".pic", ".exr")
MOST_ROWS = 2048  # of a stored map: larger ones are halved
_MOST_PIXELS = 16384 * 8192
_BAND = 512  # rows decoded and halved at a time: 9 halvings at most, of a million rows
_HEAD = 1 << 20  # bytes of a Radiance header, at most
_FREE, _PER_BYTE = 1 << 20, 512  # pixels allowed in a small file, and further pixels per byte
_SLIGHT = 1e-3  # of all light: image filters leave that much below 0
_REMEDY = "save it again with finite values of 0 or more"


def read_map(path: Path) -> tuple[np.ndarray, list[str]]:
    """Return (H, W, 3) float32 radiance of an image, top row first, and notices; above 2048 rows, means of 2×2 pixels.

    Raises InputError, one line, for a missing, damaged or unknown file, and for non-finite or negative pixels.
    """
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise InputError(f"a sky is an image that ends in {' '.join(ENDINGS)}, not in '{path.suffix}'", path)
    pixels, scales = (read_exr(path), None) if ending == ".exr" else read_hdr(path)
    height, width = pixels.shape[:2]
    halvings = 0
    while height >> halvings > MOST_ROWS and (height >> halvings) % 2 == (width >> halvings) % 2 == 0:
        halvings += 1
    bad, negative, below, whole, kept = 0, 0, 0.0, 0.0, []
    for rows in (pixels[start : start + _BAND] for start in range(0, height, _BAND)):
        radiance = rows if scales is None else _decoded(rows, scales)
        finite = np.isfinite(radiance)
        bad += 0 if finite.all() else int((~finite).any(-1).sum())
        if radiance.min() < 0.0:
            negative += int((radiance < 0.0).any(-1).sum())
            below -= float(np.minimum(radiance, 0.0).sum(dtype=float))
            radiance = np.maximum(radiance, np.float32(0.0))
        whole += float(radiance.sum(dtype=float))
        for _ in range(halvings):
            radiance = radiance[::2] + radiance[1::2]
            radiance = (radiance[:, ::2] + radiance[:, 1::2]) * np.float32(0.25)
        kept.append(radiance)
    if bad:
        raise InputError(f"{bad} of its pixels are not finite (NaN or infinity); {_REMEDY}", path)
    if below > _SLIGHT * (whole + below):
        raise InputError(f"{negative} of its pixels are negative; {_REMEDY}", path)
    notices = [f"{path}: some of its pixels are slightly negative, and count as 0"] if negative else []
    if width != 2 * height:
        notices.append(f"{path}: {width}x{height} pixels are not twice as wide as high; they cover the whole sphere all the same")
    return np.concatenate(kept), notices


def read_exr(path: Path) -> np.ndarray:
    """Return (H, W, 3) float32 of the first part of an EXR: channels R, G and B of any layer, or a single channel as grey."""
    import OpenEXR  # slow to import, and few scenes need it

    check_readable(path, MOST_IMAGE)
    try:
        with _silent(), OpenEXR.File(str(path), header_only=True) as file:
            numbers = sum(_values(part.header) for part in file.parts)
        most = 3 * _most_pixels(path.stat().st_size)
        if numbers > most:
            raise ValueError(f"{numbers} values are more than {most}")
        with _silent(), OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: np.asarray(channel.pixels, np.float32) for name, channel in file.channels().items()}
    except Exception as error:  # a damaged file may raise anything
        reason = (str(error).splitlines() or [""])[-1].strip()[:80]
        raise InputError(f"this is no OpenEXR file, or a damaged one ({reason}); save it again", path) from None
    for layer in sorted({name.rpartition(".")[0] for name in channels}, key=len):
        names = [f"{layer}.{c}" if layer else c for c in "RGB"]
        if all(name in channels for name in names):
            return np.stack([channels[name] for name in names], axis=-1)
    if len(channels) == 1 and next(iter(channels.values())).ndim == 2:
        return np.repeat(next(iter(channels.values()))[..., None], 3, axis=-1)
    others = f"but {len(channels)} others, {quote(next(iter(channels)))} first" if channels else "and no others"
    raise InputError(f"it has no channels R, G and B, {others}; save it as RGB", path)


@contextmanager
def _silent() -> Iterator[None]:
    """Hide the messages of OpenEXR and its C library on stdout and stderr within the block."""
    with redirect_stdout(io.StringIO()), ExitStack() as restored:
        with suppress(OSError):  # there may be no stderr
            kept = os.dup(2)
            restored.callback(os.close, kept)
            restored.callback(os.dup2, kept, 2)
            with open(os.devnull, "wb") as nowhere:
                os.dup2(nowhere.fileno(), 2)
        yield


def _most_pixels(size: int) -> int:
    """Return the most pixels for a file of `size` bytes."""
    return min(_MOST_PIXELS, _FREE + _PER_BYTE * size)


def _values(header: dict[str, Any]) -> int:
    """Return the number of values in a part of an EXR."""
    first, last = np.asarray(header["dataWindow"], np.int64)
    return int(np.prod(last - first + 1)) * len(header["channels"])


# ---- Radiance ------------------------------------------------------------------------------------------------------------


def read_hdr(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return (H, W, 4) uint8 mantissas and exponents of a Radiance picture, and (256,) float32 scales of the exponents.

    A value is (mantissa + ½)·2^(exponent − 136), divided by the header's EXPOSURE.
    """
    data = read_bytes(path, MOST_IMAGE)
    head, found, line = data[:_HEAD].partition(b"\n\n")
    line, _, _ = line.partition(b"\n")
    start = len(head) + len(found) + len(line) + 1  # of the pixels
    size = re.fullmatch(rb"([+-])Y (\d{1,6}) ([+-])X (\d{1,6})\r?", line)
    if not head.startswith((b"#?RADIANCE", b"#?RGBE")) or not found or size is None:
        raise InputError("this is no Radiance picture with rows from top to bottom; save it again as .hdr", path)
    if b"32-bit_rle_xyze" in head:
        raise InputError("its pixels are XYZ, and RGB is expected; convert it (Radiance: ra_xyze -r)", path)
    height, width = int(size[2]), int(size[4])
    if not 0 < height * width <= _most_pixels(len(data)):
        raise InputError(f"{width}x{height} pixels are none, or too many in {len(data)} bytes", path)
    read = _runs if data[start : start + 2] == b"\2\2" and 8 <= width < 32768 else _plain
    try:
        coded = read(data, start, height, width)
    except (IndexError, ValueError):
        raise InputError("the picture is cut off or damaged; save it again", path) from None
    exposures = [number(value) for value in re.findall(r"^EXPOSURE=\s*(\S+)", head.decode("latin-1"), re.M) if is_number(value)]
    exposure = float(np.prod(exposures)) or 1.0
    if not 1e-30 <= exposure <= 1e30:
        raise InputError(f"its EXPOSURE is {exposure:g}; expected a number above 0; save it again", path)
    scales = np.ldexp(1.0, np.arange(256) - 136).astype(np.float32) / np.float32(exposure)
    scales[0] = 0.0
    return coded[:: 1 if size[1] == b"-" else -1, :: 1 if size[3] == b"+" else -1], scales


def _decoded(coded: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """Return (H, W, 3) float32 radiance of coded pixels (H, W, 4)."""
    radiance = np.empty((*coded.shape[:2], 3), np.float32)
    scale = scales[coded[..., 3]]
    for i in range(3):
        np.multiply(coded[..., i] + np.float32(0.5), scale, out=radiance[..., i])
    return radiance


def _runs(data: bytes, at: int, height: int, width: int) -> np.ndarray:
    """Return (H, W, 4) uint8 from rows with four components in turn, each of runs and literals."""
    out = bytearray()
    start = bytes((2, 2, width >> 8, width & 255))
    for _ in range(height):
        if data[at : at + 4] != start:
            raise ValueError("no row begins here")
        at += 4
        for _ in range(4):
            left = width
            while left > 0:
                count = data[at]
                if count > 128:
                    count -= 128
                    out += data[at + 1 : at + 2] * count
                    at += 2
                elif count:
                    out += data[at + 1 : at + 1 + count]
                    at += 1 + count
                else:
                    raise ValueError("an empty run")
                left -= count
            if left:
                raise ValueError("a run is longer than its row")
    return np.frombuffer(out, np.uint8).reshape(height, 4, width).swapaxes(1, 2)


def _plain(data: bytes, at: int, height: int, width: int) -> np.ndarray:
    """Return (H, W, 4) uint8 from pixels without runs; raise ValueError for runs of the format before 1991."""
    codes = np.frombuffer(data, np.uint8, 4 * height * width, at).reshape(height, width, 4)
    if (codes[..., :3] == 1).all(-1).any():
        raise ValueError("a pixel repeats the one before")
    return codes
