"""A finished frame as numpy arrays, and its files: PNG, EXR, NPZ, or a folder of pictures."""

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
from irrsplat.core.files import (
    Pathlike,
    _try_folder,
    _write_folder,
    as_png,
    check_file,
    dithered,
    json_text,
    write_file,
    write_layers,
)
from irrsplat.core.paths import named
from irrsplat.image.backdrop import BackdropKind, display_picture
from irrsplat.image.statistics import TIMES, Statistics
from irrsplat.image.tonemap import exposure_of, show, tonemap

ENDINGS = (".png", ".exr", ".npz")
RECORDS = ("records_position", "records_normal", "records_irradiance", "records_radius")
BUFFERS = (*CHANNELS, *RECORDS)
_ROWS = 256  # rows of a picture that are tone-mapped at once
_NUMBER = re.compile(r"0?[0-9]{0,2}[dxXob]?")  # spelling of {frame} that gives every frame its own name


@dataclass(frozen=True, repr=False)
class Frame:
    """One rendered view; every array belongs to the caller, float32, linear, top row first (see buffers.CHANNELS).

    image, direct, indirect, emission, alpha: means over the samples of a pixel; all others are sampled at its centre. records_*:
    the cache, N rows. stats: statistics of the render. figures: further (H, W, 3) pictures by name, for the figures of the paper:
    radiance "first_samples" and "splat_buffer", and "quad" in display values 0..1. backdrop: background of pictures; only a sky
    is in the image, other backdrops are composited behind it. A notebook shows the picture.
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

    @property
    def exposure(self) -> float:
        """The picture's exposure in stops (stats["exposure"]; 0 where that is missing)."""
        return float(self.stats.get("exposure", 0.0))

    @property
    def picture(self) -> np.ndarray:
        """The image as a screen shows it, (H, W, 3) sRGB-encoded 0..1, before its backdrop; (H, W, 4) where that is clear."""
        return display_picture(self.image, self.exposure, self.alpha, self.backdrop)

    def __repr__(self) -> str:
        """Return the frame in a line: its size, and its known numbers of records and rounds."""
        height, width = self.image.shape[:2]
        known = [f"{self.stats[name]} {name}" for name in ("records", "rounds") if name in self.stats]
        return f"<Frame {', '.join([f'{width}x{height}', *known])}>"

    def _repr_png_(self) -> bytes | None:
        """Return the picture as a PNG, for notebooks; None for a frame without one."""
        return as_png(self.picture) if self.image.size and self.alpha.size else None

    def placed(self, origin: tuple[float, float, float]) -> Frame:
        """Return the frame with pixels and records in world space instead of relative to `origin`, as exactly as float32
        allows."""
        if not any(origin):
            return self
        position = self.position
        if position.size:
            seen = np.isfinite(self.depth[..., None]) if self.depth.size else np.any(position, axis=-1, keepdims=True)
            position = np.where(seen, (position + np.asarray(origin)).astype(np.float32), position)
        records = (self.records_position + np.asarray(origin)).astype(np.float32)
        return replace(self, position=position, records_position=records)

    def save(self, path: Pathlike, buffers: Sequence[str] | None = None) -> None:
        """Write this frame in the format of `path`'s ending; an existing file is replaced whole, or not at all.

        .png: the picture, exposed, tone-mapped, sRGB, over its backdrop; with alpha for a clear backdrop. .exr: a float32 layer
        per buffer, and the stats without times as JSON text; with a clear backdrop, image has a premultiplied A. .npz: every
        buffer, the records and the stats (JSON text). A path without an ending, with a slash at its end, or of an existing
        folder: a PNG per buffer, and the paper's figures. buffers: names of the buffers in EXR, NPZ or folder (default: all).
        Raises InputError for an invalid path or name, IrrsplatError if writing fails.
        """
        ending = check_writable(path, buffers)
        names = tuple(BUFFERS) if buffers is None else tuple(buffers)
        if not ending:
            _write_folder(Path(os.path.realpath(path)), self._pictures(names))
        elif ending == ".exr":
            write_file(path, lambda part: self._write_exr(part, names))
        elif ending == ".npz":
            write_file(path, lambda part: self._write_npz(part, names))
        else:
            write_file(path, self._write_png)

    def _write_png(self, part: Path) -> None:
        from PIL import Image

        shown, height = [], len(self.image)
        for first in range(0, height, _ROWS):  # tone mapping takes ten times the memory of its result
            rows = slice(first, first + _ROWS)
            some = display_picture(self.image[rows], self.exposure, self.alpha[rows], self.backdrop, (first, height))
            shown.append(dithered(some, first))
        Image.fromarray(np.concatenate(shown)).save(part, "PNG")

    def _write_exr(self, part: Path, names: Sequence[str]) -> None:
        layers = {name: np.ascontiguousarray(getattr(self, name), np.float32) for name in names if name in CHANNELS}
        if self.backdrop == "clear" and "image" in layers:
            layers["image"] = np.ascontiguousarray(np.dstack([layers["image"], self.alpha]), np.float32)
        kept = {name: value for name, value in self.stats.items() if name not in TIMES}
        write_layers(part, layers, len(next(iter(layers.values()))), {"stats": json_text(kept)})

    def _write_npz(self, part: Path, names: Sequence[str]) -> None:
        arrays: dict[str, Any] = {name: np.asarray(getattr(self, name), np.float32) for name in names}  # numpy's stub: Any
        with open(part, "wb") as file:  # by handle: numpy would append .npz to a name
            np.savez(file, stats=np.array(json_text(self.stats)), **arrays)

    def _pictures(self, names: Sequence[str]) -> Iterator[tuple[str, np.ndarray]]:
        """Yield the file names and (H, W, 3) display images, 0..1, of a folder: the buffers `names`, then the paper's figures."""
        seen = np.isfinite(self.depth)
        for name in names:
            if name in CHANNELS:
                yield f"{name}.png", self.picture if name == "image" else show(name, getattr(self, name), self.exposure, seen)
        if "quad" in self.figures:
            yield "figure1_quad.png", np.clip(self.figures["quad"], 0.0, 1.0)
        yield "figure2_direct.png", tonemap(self.direct, self.exposure)
        sums = [name for name in ("splat_buffer", "first_samples") if name in self.figures]
        # sums are not radiance, so they have their own exposure; one for both makes figures 3 and 4 comparable
        stops = exposure_of(self.figures[sums[0]]) if sums else 0.0
        for name, file in (("first_samples", "figure3_first_samples.png"), ("splat_buffer", "figure4_splat_buffer.png")):
            if name in sums:
                yield file, tonemap(self.figures[name], stops)
        yield "figure5_normalized.png", tonemap(self.indirect, self.exposure)
        yield "figure6_combined.png", self.picture


def needed(paths: Iterable[Pathlike], buffers: Sequence[str] | None) -> set[str] | None:
    """Return the names of the buffers required to save a frame to these paths; None: all of them."""
    endings = {os.path.splitext(os.fspath(path))[1].lower() for path in paths}
    if endings <= {".png"}:
        return {"image", "alpha"}
    return None if buffers is None or not endings <= set(ENDINGS) else {"image", "alpha", *buffers}


def check_names(buffers: Iterable[str] | None) -> None:
    """Raise InputError if one of the names is not a buffer's, or if they are not a sequence of names."""
    if isinstance(buffers, str) or not isinstance(buffers, Iterable | None):
        raise InputError(f"buffers are a sequence of names, such as ['image', 'depth'], not {buffers!r:.60}")
    unknown = [f"'{name}'{did_you_mean(name, BUFFERS)}" for name in buffers or () if name not in BUFFERS]
    if unknown:
        raise InputError(f"unknown buffer {', '.join(unknown)}; the buffers are {', '.join(BUFFERS)}")


def check_writable(path: Pathlike, buffers: Sequence[str] | None = None, others: Sequence[str] = ()) -> str:
    """Return an output's ending, one of ENDINGS, or "" for a folder, after checking that it can be written.

    The check before a long render prevents its loss. others: endings that the caller can write as well, for the error message.
    Raises InputError for an unknown ending or buffer, or if nothing can be written there. Leaves no file behind.
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
        known = ", ".join((*ENDINGS, *others))
        raise InputError(f"unknown ending '{ending}'; an output ends in {known}, or is a folder (no ending)", text)
    if ending == ".exr" and buffers is not None and not set(buffers) & set(CHANNELS):
        raise InputError("none of the chosen buffers is an image, so there is nothing to write; choose another or .npz", text)
    check_file(text)
    return ending


def numbered(pattern: str, frame: int) -> str:
    """Return the output's name for one frame of a path: its number in place of each {frame}, {frame:4d}, {frame:04d}, {frame:x}
    ….

    Raises InputError for any other field and for an unclosed brace; {{ and }} are plain braces.
    """
    try:
        for _, name, spec, conversion in string.Formatter().parse(pattern):
            if name is not None and (name != "frame" or conversion or not _NUMBER.fullmatch(spec or "")):
                raise ValueError
        return pattern.format(frame=frame)
    except ValueError:
        raise InputError("the one field in an output's name is {frame}, or with digits such as {frame:04d}", pattern) from None
