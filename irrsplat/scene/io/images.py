"""Decoding of texture images, and search for files under the names that other programs write."""

from __future__ import annotations

import hashlib
import io
import os
import re
import struct
import unicodedata
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING
from urllib.parse import unquote

import numpy as np

from irrsplat.core.color import srgb
from irrsplat.core.errors import InputError
from irrsplat.core.paths import FREE_PIXELS, PIXELS_PER_BYTE, listing, may_read, name_of, take_pixels, take_search
from irrsplat.core.words import quote
from irrsplat.scene.model import Image

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

GREATEST_PIXELS = 16384**2
# Pillow's formats for textures; others, such as PostScript, can execute code.
_FORMATS = tuple("AVIF BMP DDS DIB GIF ICO JPEG JPEG2000 MPO PCX PNG PPM PSD SGI TGA TIFF WEBP".split())  # noqa: SIM905
_MOST_ENDS = 5  # parts of a path of another machine
_KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n"


def read_images(files: Sequence[tuple[bytes, str]]) -> list[Image | InputError]:
    """Decode PNG, JPEG, WebP, BMP, TGA, TIFF, GIF or KTX2 files, bytes and name of each, on all processors.

    An image has (H, W, 4) uint8, of the first of several frames. Palettes, greys, 16 bits and CMYK become 8-bit sRGB with alpha;
    floats count as linear. Orientation tags and colour profiles are ignored, as glTF requires. Files with equal bytes share one
    image. An error, one line without a place, stands for a broken image, for one of more than 16384² pixels, and for one that
    exceeds the pixels that `paths.take_pixels` allows.
    """

    def found(file: tuple[bytes, str]) -> Image | InputError:
        try:
            return _decoded(*file)
        except InputError as error:
            return error

    if not files:
        return []
    keys = [hashlib.sha256(data).digest() for data, _ in files]
    first: dict[bytes, tuple[bytes, str]] = {}
    for key, file in zip(keys, files, strict=True):
        first.setdefault(key, file)
    images: dict[bytes, Image | InputError] = {}
    with _pillow_unlimited(), ThreadPoolExecutor(os.cpu_count()) as threads:
        for key, file in first.items():
            try:
                _check_pixels(*file)
            except InputError as error:
                images[key] = error
        granted = [key for key in first if key not in images]
        images |= zip(granted, threads.map(found, [first[key] for key in granted]), strict=True)
    return [images[key] for key in keys]


@contextmanager
def _pillow_unlimited() -> Iterator[None]:
    """A `with` block without Pillow's warnings and size limit, which are global settings."""
    import PIL.Image  # takes 50 ms: imported only for files with images

    bound, PIL.Image.MAX_IMAGE_PIXELS = PIL.Image.MAX_IMAGE_PIXELS, None  # `_decoded` checks the size
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        PIL.Image.MAX_IMAGE_PIXELS = bound


def _check_pixels(data: bytes, name: str) -> None:
    """Raise InputError, without decoding, for an image with more pixels than the scene may have."""
    if data.startswith(_KTX2) and len(data) >= 28:
        width, height = struct.unpack_from("<2I", data, 20)
    else:
        with _reading(name), _opened(data) as picture:
            width, height = picture.size
    if width * height > GREATEST_PIXELS:
        raise InputError(f"the image {quote(name)} has {width} × {height} pixels, more than 16384²; scale it down")
    if not take_pixels(width * height, len(data)):
        raise InputError(
            f"the image {quote(name)} has {width} × {height} pixels in {len(data)} bytes; the images of a scene may have "
            f"{FREE_PIXELS >> 20} million pixels, and {PIXELS_PER_BYTE} more for each byte of theirs; scale it down"
        )


def _decoded(data: bytes, name: str) -> Image:
    if data.startswith(_KTX2):
        data = _tga_from_ktx2(data, name)
    with _reading(name), _opened(data) as picture:
        pixels = _rgba(picture)
        pixels.flags.writeable = False
        return Image(pixels, name)


def _opened(data: bytes) -> Picture:
    import PIL.Image

    PIL.Image.init()
    return PIL.Image.open(io.BytesIO(data), formats=[name for name in _FORMATS if name in PIL.Image.OPEN])


@contextmanager
def _reading(name: str) -> Iterator[None]:
    """Turn any exception of a decoder into one InputError; a damaged image may raise anything."""
    import PIL

    try:
        yield
    except Exception as error:
        reason = (str(error).splitlines() or [""])[0][:80]
        said = "it is no image of a known format" if isinstance(error, PIL.UnidentifiedImageError) else reason
        raise InputError(f"cannot read the image {quote(name)}{f' ({said})' if said else ''}") from None


def _rgba(picture: Picture) -> np.ndarray:
    """Return (H, W, 4) uint8 of a picture in any of Pillow's modes."""
    grey: np.ndarray | None = None
    if picture.mode.startswith("I"):  # 16 bits; Pillow would clip them to 255
        grey = np.clip(np.asarray(picture).astype(np.int64), 0, 65535) / 257.0
    elif picture.mode == "F":
        grey = 255.0 * srgb(np.nan_to_num(np.asarray(picture)))
    if grey is not None:
        opaque = np.full((*grey.shape, 1), 255, np.uint8)
        return np.concatenate([np.repeat(np.rint(grey).astype(np.uint8)[..., None], 3, axis=2), opaque], axis=2)
    if picture.mode in ("CMYK", "YCbCr", "LAB", "HSV"):
        picture = picture.convert("RGB")
    return np.array(picture if picture.mode == "RGBA" else picture.convert("RGBA"))


def _tga_from_ktx2(data: bytes, name: str) -> bytes:
    try:
        import alktx2
    except ImportError:
        raise InputError(f"the image {quote(name)} is KTX2; to read it: pip install 'irrsplat[gltf]'") from None
    try:  # an uncompressed TGA takes a tenth of the time of a PNG
        return bytes(alktx2.decode_ktx2_to_bytes(data, format="tga")[0])
    except Exception:
        raise InputError(f"cannot read the image {quote(name)} (its KTX2 is damaged, or of a kind that is not known)") from None


def find_file(folder: Path, written_name: str) -> Path | None:
    """Return the file that `written_name` in a scene's file in `folder` means; None where there is none.

    Candidates, in order: the name as written, with %20 and the like resolved, with slashes for backslashes, each also in other
    case; then the ends of each path, longest first, because paths are often those of another machine. Files outside the
    allowed folders are not searched. If only such a file remains, its path is returned, and reading it raises InputError.
    """
    exact = os.path.join(folder, name_of(written_name))
    if "\0" not in exact and os.path.isfile(exact) and may_read(Path(exact)):
        return folder / name_of(written_name)
    if not take_search():
        return None
    spellings = [name_of(name) for name in _spellings(written_name)]
    parts = [re.split(r"[/\\]+", name)[-_MOST_ENDS:] for name in spellings]
    ends = ["/".join(path[-count:]) for count in range(_MOST_ENDS, 0, -1) for path in parts if count <= len(path)]
    for name in dict.fromkeys([*spellings, *ends]):
        found = _find_from(folder, name) if name else None
        if found is not None:
            return found
    refused = [folder / name for name in spellings if name and "\0" not in name and not may_read(folder / name)]
    return refused[0] if refused else None


def _spellings(written: str) -> Iterator[str]:
    plain = written.strip().strip("\"'")
    names = [plain, unquote(plain), plain.replace("\\", "/"), unquote(plain).replace("\\", "/")]
    names += [name.removeprefix("file://") for name in names]
    yield from dict.fromkeys(names)


def _find_from(folder: Path, name: str) -> Path | None:
    """Return the readable regular file at `name` from `folder`, ignoring case only if necessary."""
    try:
        if not may_read(folder / name):
            return None
        if (folder / name).is_file():
            return folder / name
        path = PurePosixPath(name)
        at = Path(path.anchor) if path.anchor else folder
        for part in path.parts[1:] if path.anchor else path.parts:
            if not (at / part).exists():
                alike = listing(at, _folded).get(_folded(part))
                if alike is None:
                    return None
                part = alike
            at = at / part
        return at if at.is_file() else None
    except (OSError, ValueError):  # not a valid file name, or an unreadable folder
        return None


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()
