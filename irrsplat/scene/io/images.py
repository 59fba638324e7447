"""Reads images that surfaces wear, and finds files under the names that other programs have written."""

from __future__ import annotations

import io
import os
import re
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
from irrsplat.core.words import quote
from irrsplat.scene.model import Image

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

GREATEST_PIXELS = 16384**2
_KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n"


def read_image(data: bytes, name: str) -> Image:
    """The image in the bytes of a PNG, JPEG, WebP, BMP, TGA, TIFF, GIF or KTX2 file: (H, W, 4) uint8, the first frame of several.

    Palettes, greys, 16 bits and CMYK become 8-bit sRGB with alpha; floats count as linear. Orientation tags and colour profiles
    are ignored, as glTF asks. name: for the message.
    Raises InputError, one line without a place, for a broken image and one of more than 16384² pixels.
    """
    with _without_complaints():
        return _decoded(data, name)


def read_images(files: Sequence[tuple[bytes, str]]) -> list[Image | InputError]:
    """What `read_image` gives for the bytes and the name of each file, or raises; on all processors, which its decoders leave
    free for one another."""

    def found(file: tuple[bytes, str]) -> Image | InputError:
        try:
            return _decoded(*file)
        except InputError as error:
            return error

    if not files:
        return []
    with _without_complaints(), ThreadPoolExecutor(os.cpu_count()) as threads:
        return list(threads.map(found, files))


@contextmanager
def _without_complaints() -> Iterator[None]:
    """A `with` block in which Pillow neither warns nor bounds the size of images; both are the whole program's settings."""
    import PIL.Image  # takes 50 ms: imported only for files with images

    bound, PIL.Image.MAX_IMAGE_PIXELS = PIL.Image.MAX_IMAGE_PIXELS, None  # `_decoded` checks it
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        PIL.Image.MAX_IMAGE_PIXELS = bound


def _decoded(data: bytes, name: str) -> Image:
    import PIL.Image

    if data.startswith(_KTX2):
        data = _tga_from_ktx2(data, name)
    try:
        with PIL.Image.open(io.BytesIO(data)) as picture:
            if picture.width * picture.height <= GREATEST_PIXELS:
                pixels = _rgba(picture)
                pixels.flags.writeable = False
                return Image(pixels, name)
            size = f"{picture.width} × {picture.height}"
    except Exception as error:  # a damaged image may raise anything in its decoder
        reason = (str(error).splitlines() or [""])[0][:80]
        said = "it is no image of a known format" if isinstance(error, PIL.UnidentifiedImageError) else reason
        raise InputError(f"cannot read the image {quote(name)}{f' ({said})' if said else ''}") from None
    raise InputError(f"the image {quote(name)} has {size} pixels, more than 16384²; scale it down")


def _rgba(picture: Picture) -> np.ndarray:
    """(H, W, 4) uint8 of a picture in any of Pillow's modes."""
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
    try:  # a TGA, which is not compressed, takes a tenth of the time of a PNG
        return bytes(alktx2.decode_ktx2_to_bytes(data, format="tga")[0])
    except Exception:
        raise InputError(f"cannot read the image {quote(name)} (its KTX2 is damaged, or of a kind that is not known)") from None


def find_file(folder: Path, written_name: str) -> Path | None:
    """The file that a scene's file in `folder` means by `written_name`; None where there is none.

    In this order: the name as it is, with %20 and the like resolved, with backslashes for slashes, each also in other upper and
    lower case; then a file of its last part's name in `folder`, since other machines' paths are often written.
    """
    spellings = list(_spellings(written_name))
    for name in dict.fromkeys([*spellings, *(re.split(r"[/\\]", name)[-1] for name in spellings)]):
        found = _walk(folder, name) if name else None
        if found is not None:
            return found
    return None


def _spellings(written: str) -> Iterator[str]:
    plain = written.strip().strip("\"'")
    names = [plain, unquote(plain), plain.replace("\\", "/"), unquote(plain).replace("\\", "/")]
    names += [name.removeprefix("file://") for name in names]
    yield from dict.fromkeys(names)


def _walk(folder: Path, name: str) -> Path | None:
    """The regular file at `name` from `folder` on, letters' case ignored where it must be."""
    try:
        if (folder / name).is_file():
            return folder / name
        path = PurePosixPath(name)
        at = Path(path.anchor) if path.anchor else folder
        for part in path.parts[1:] if path.anchor else path.parts:
            if not (at / part).exists():
                alike = [entry.name for entry in at.iterdir() if _folded(entry.name) == _folded(part)]
                if not alike:
                    return None
                part = min(alike)
            at = at / part
        return at if at.is_file() else None
    except (OSError, ValueError):  # a name that no file system takes, or a folder that can't be read
        return None


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()
