"""The finished frame as numpy arrays, and the files it can become: PNG, EXR, NPZ, or a folder of pictures."""

from __future__ import annotations

import os
import re
import string
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from irrsplat.core.buffers import CHANNELS
from irrsplat.core.errors import InputError, did_you_mean
from irrsplat.core.files import Pathlike, _try_folder, _write_file, _write_folder, check_exr, check_file, eight_bits
from irrsplat.core.paths import named
from irrsplat.image import statistics
from irrsplat.image.backdrop import BackdropKind, display_picture
from irrsplat.image.statistics import Statistics
from irrsplat.image.tonemap import exposure_of, show, tonemap

ENDINGS = (".png", ".exr", ".npz")
RECORDS = ("records_position", "records_normal", "records_irradiance", "records_radius")
BUFFERS = (*CHANNELS, *RECORDS)
_ROWS = 256  # of a picture, that are tone mapped at once
_NUMBER = re.compile(r"0?[0-9]{0,2}[dxXob]?")  # how {frame} may be spelled: two frames never have one name


@dataclass(frozen=True)
class Frame:
    """One rendered view; every array belongs to the caller, float32, linear, top row first (see buffers.CHANNELS).

    image, direct, indirect, emission, alpha: means over the samples of a pixel; all others are of its centre.
    records_*: the cache, N rows. stats: how the frame was made. figures: further (H, W, 3) pictures by name, for the figures of
    the paper: radiance "first_samples" and "splat_buffer", and "quad", which is in display values 0..1.
    backdrop: what pictures show where there is no surface; only a sky is in the image, all others are put behind it.
    """

    image: np.ndarray
    direct: np.ndarray
    indirect: np.ndarray
    irradiance: np.ndarray
    emission: np.ndarray
    weight: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    smooth_normal: np.ndarray
    albedo: np.ndarray
    opacity: np.ndarray
    depth: np.ndarray
    alpha: np.ndarray
    records_position: np.ndarray
    records_normal: np.ndarray
    records_irradiance: np.ndarray
    records_radius: np.ndarray
    stats: Statistics = field(default_factory=Statistics)
    figures: dict[str, np.ndarray] = field(default_factory=dict)
    backdrop: BackdropKind = "sky"

    def placed(self, origin: tuple[float, float, float]) -> Frame:
        """The frame with the positions of pixels and records in world space, which were relative to `origin`, as far as float32
        can tell them apart there."""
        if not any(origin):
            return self
        position = self.position
        if position.size:
            seen = np.isfinite(self.depth[..., None]) if self.depth.size else np.any(position, axis=-1, keepdims=True)
            position = np.where(seen, (position + np.asarray(origin)).astype(np.float32), position)
        records = (self.records_position + np.asarray(origin)).astype(np.float32)
        return replace(self, position=position, records_position=records)

    @property
    def exposure(self) -> float:
        """The picture's exposure in stops (stats["exposure"]; 0 where that is missing)."""
        return float(self.stats.get("exposure", 0.0))

    @property
    def picture(self) -> np.ndarray:
        """The image as a screen shows it, (H, W, 3) sRGB-encoded 0..1, before its backdrop; (H, W, 4) where that is clear."""
        return display_picture(self.image, self.exposure, self.alpha, self.backdrop)

    def save(self, path: Pathlike, buffers: Sequence[str] | None = None) -> None:
        """Write this frame in the format that `path`'s ending names; a file there is replaced whole, or not at all.

        .png: the picture, exposed, tone-mapped, sRGB, 8 bit, before its backdrop; with alpha where that is clear. .exr: a float32
        layer per buffer, and the stats without times; image has A where the backdrop is clear, multiplied in. .npz: every buffer,
        the records and the stats (JSON text). A path without an ending, with a slash at its end, or of an existing folder: a PNG
        per buffer, and the paper's figures. buffers: the names of those that go into EXR, NPZ or folder (default: all).
        Raises InputError for a path or name that cannot be right, IrrsplatError where writing fails.
        """
        ending = check_writable(path, buffers)
        names = tuple(BUFFERS) if buffers is None else tuple(buffers)
        if not ending:
            _write_folder(Path(os.path.realpath(path)), self._pictures(names))
            return
        write = {".png": self._write_png, ".exr": self._write_exr, ".npz": self._write_npz}[ending]
        _write_file(path, lambda part: write(part, names))

    def _write_png(self, part: Path, names: Sequence[str]) -> None:
        from PIL import Image

        some = [self._eight_bits(first) for first in range(0, len(self.image), _ROWS)]
        Image.fromarray(np.concatenate(some)).save(part, "PNG")

    def _eight_bits(self, first: int) -> np.ndarray:
        """Some rows of the picture from `first` on, in 8 bits: tone mapping takes ten times the memory of what it gives."""
        rows = slice(first, first + _ROWS)
        whole = first, len(self.image)
        return eight_bits(display_picture(self.image[rows], self.exposure, self.alpha[rows], self.backdrop, whole))

    def _write_exr(self, part: Path, names: Sequence[str]) -> None:
        import OpenEXR

        layers = {name: np.ascontiguousarray(getattr(self, name), np.float32) for name in names if name in CHANNELS}
        if self.backdrop == "clear" and "image" in layers:
            layers["image"] = np.ascontiguousarray(np.dstack([layers["image"], self.alpha]), np.float32)
        stats = statistics.to_json(statistics.repeatable(self.stats))
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "stats": stats}
        with OpenEXR.File(header, layers) as file:
            file.write(str(part))
        check_exr(part, len(self.image))

    def _write_npz(self, part: Path, names: Sequence[str]) -> None:
        arrays: dict[str, Any] = {name: np.asarray(getattr(self, name), np.float32) for name in names}  # numpy's stub: Any
        with open(part, "wb") as file:  # by handle: given a name, numpy would append .npz to it
            np.savez(file, stats=np.array(statistics.to_json(self.stats)), **arrays)

    def _pictures(self, names: Sequence[str]) -> Iterator[tuple[str, np.ndarray]]:
        """The file names and (H, W, 3) display images, 0..1, of a folder: the buffers `names`, then the paper's figures."""
        seen = np.isfinite(self.depth)
        for name in names:
            if name in CHANNELS:
                yield f"{name}.png", self.picture if name == "image" else show(name, getattr(self, name), self.exposure, seen)
        if "quad" in self.figures:
            yield "figure1_quad.png", np.clip(self.figures["quad"], 0.0, 1.0)
        yield "figure2_direct.png", tonemap(self.direct, self.exposure)
        sums = [name for name in ("splat_buffer", "first_samples") if name in self.figures]
        # sums are not radiance, so they have an exposure of their own; one for both, so that figures 3 and 4 compare
        stops = exposure_of(self.figures[sums[0]]) if sums else 0.0
        for name, file in (("first_samples", "figure3_first_samples.png"), ("splat_buffer", "figure4_splat_buffer.png")):
            if name in sums:
                yield file, tonemap(self.figures[name], stops)
        yield "figure5_normalized.png", tonemap(self.indirect, self.exposure)
        yield "figure6_combined.png", self.picture


def needed(paths: Iterable[Pathlike], buffers: Sequence[str] | None) -> set[str] | None:
    """The names of the buffers that a frame must hold to be saved to these paths; None: all of them."""
    endings = {os.path.splitext(os.fspath(path))[1].lower() for path in paths}
    if endings <= {".png"}:
        return {"image", "alpha"}
    return None if buffers is None or not endings <= set(ENDINGS) else {"image", "alpha", *buffers}


def check_names(buffers: Iterable[str] | None) -> None:
    """Raises InputError where one of the names is no buffer's."""
    unknown = [f"'{name}'{did_you_mean(name, BUFFERS)}" for name in buffers or () if name not in BUFFERS]
    if unknown:
        raise InputError(f"unknown buffer {', '.join(unknown)}; the buffers are {', '.join(BUFFERS)}")


def check_writable(path: Pathlike, buffers: Sequence[str] | None = None) -> str:
    """The ending of an output, one of ENDINGS, or "" for a folder, once it is certain that it can be written: a long rendering
    must not be lost at its end.

    Raises InputError where the ending or a buffer's name is unknown, or nothing can be written there. Leaves no file behind.
    """
    check_names(buffers)
    text = named(path)
    ending = os.path.splitext(text)[1].lower()
    if "{frame" in text:
        raise InputError("{frame} is for the frames of a path; give --path as well, or a plain name", text)
    if ending not in ENDINGS and (not ending or text.endswith(("/", os.sep)) or os.path.isdir(text)):
        _try_folder(text)
        return ""
    if ending not in ENDINGS:
        raise InputError(f"unknown ending '{ending}'; an output ends in {', '.join(ENDINGS)}, or is a folder (no ending)", text)
    if ending == ".exr" and buffers is not None and not set(buffers) & set(CHANNELS):
        raise InputError("none of the chosen buffers is an image, so there is nothing to write; choose another or .npz", text)
    check_file(text)
    return ending


def numbered(pattern: str, frame: int) -> str:
    """The output's name for one frame of a path: its number in place of each {frame}, {frame:4d}, {frame:04d}, {frame:x} ….

    Raises InputError for any other field and for a brace that is not closed; {{ and }} are plain braces.
    """
    try:
        for _, name, spec, conversion in string.Formatter().parse(pattern):
            if name is not None and (name != "frame" or conversion or not _NUMBER.fullmatch(spec or "")):
                raise ValueError
        return pattern.format(frame=frame)
    except ValueError:
        raise InputError("the one field in an output's name is {frame}, or with digits such as {frame:04d}", pattern) from None
