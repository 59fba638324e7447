"""All buffers of a frame in one picture, each with its name, unit and colour scale."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from irrsplat.core.buffers import CHANNELS
from irrsplat.core.color import srgb
from irrsplat.core.errors import InputError
from irrsplat.core.files import eight_bits
from irrsplat.image.frame_buffers import FrameBuffers
from irrsplat.image.output.false_colours import GROUND, write_words
from irrsplat.image.tonemap import heat_scale, show, viridis

NARROW, WIDE = 300, 480  # pixels: smaller pictures are enlarged by an integer factor, larger ones reduced
_SHAPE = 1.5  # target width by height of the sheet
_TEXT, _FAINT = (235, 235, 230), (160, 160, 156)
_SIZE, _SMALL = 17.0, 13.0  # letter heights, pixels
_MARGIN = 14  # pixels between cells
_BAR = 9  # pixels: height of a colour bar


def contact_sheet(frame: FrameBuffers, names: Sequence[str]) -> np.ndarray:
    """Return (H, W, 3) float32 display values 0..1: the frame's buffers in `names` in cells of one size, under a headline.

    The order is that of buffers.CHANNELS. Raises InputError if the frame holds none of them.
    """
    held = [name for name in CHANNELS if name in names and getattr(frame, name).size]
    if not held:
        raise InputError("the frame holds none of these buffers, so there is nothing to put on a contact sheet")
    height, width = getattr(frame, held[0]).shape[:2]
    wide, high = _cell(width, height)
    above, below = round(1.5 * _SIZE), round(_BAR + 2.2 * _SMALL)
    step_x, step_y = wide + _MARGIN, above + high + below + _MARGIN
    columns = min(
        range(1, len(held) + 1), key=lambda n: (abs(math.log(n * step_x / (math.ceil(len(held) / n) * step_y) / _SHAPE)), n)
    )
    rows, head = math.ceil(len(held) / columns), round(2.2 * _SIZE)
    sheet = Image.new("RGB", (columns * step_x + _MARGIN, head + rows * step_y + _MARGIN), _ink(GROUND))
    draw = ImageDraw.Draw(sheet)
    seen = np.isfinite(frame.depth) if frame.depth.size else np.ones((height, width), bool)
    draw.text((_MARGIN, 0.5 * head), _headline(frame, width, height), _TEXT, ImageFont.load_default(_SIZE), anchor="lm")
    for i, name in enumerate(held):
        x, y = _MARGIN + i % columns * step_x, head + i // columns * step_y
        values = getattr(frame, name)
        draw.text((x, y + 0.5 * above), name, _TEXT, ImageFont.load_default(_SIZE), anchor="lm")
        unit = CHANNELS[name].unit
        if unit != "1":
            left = x + draw.textlength(name, ImageFont.load_default(_SIZE)) + _SIZE
            write_words(draw, (left, y + 0.5 * (above - _SMALL)), unit, _FAINT, _SMALL)
        shown = frame.picture[..., :3] if name == "image" and frame.alpha.size else show(name, values, frame.exposure, seen)
        picture = Image.fromarray(eight_bits(shown))
        method = Image.Resampling.NEAREST if wide > width else Image.Resampling.BOX
        sheet.paste(picture.resize((wide, high), method), (x, y + above))
        _legend(sheet, draw, (x, y + above + high + 5), wide, name, values, seen, frame.exposure)
    return np.asarray(sheet, np.float32) / np.float32(255.0)


def _cell(width: int, height: int) -> tuple[int, int]:
    """Return the displayed size of a picture of this size."""
    if width < NARROW:
        factor = math.ceil(NARROW / width)
        return factor * width, factor * height
    wide = min(width, WIDE)
    return wide, max(1, round(height * wide / width))


def _headline(frame: FrameBuffers, width: int, height: int) -> str:
    """Return the headline: scene, size, records, rounds and preset."""
    stats = frame.stats
    words = [str(stats["scene"])] if "scene" in stats else []
    words.append(f"{width} x {height} pixels")
    words += [f"{stats[name]} {name}" for name in ("records", "rounds") if name in stats]
    words += [f"preset {stats['preset']}"] if stats.get("preset") else []
    return ",  ".join(words)


def _legend(
    sheet: Image.Image,
    draw: ImageDraw.ImageDraw,
    place: tuple[int, int],
    wide: int,
    name: str,
    values: np.ndarray,
    seen: np.ndarray,
    exposure: float,
) -> None:
    """Draw a colour bar with numbers below a picture, or a line on its display."""
    way, (x, y) = CHANNELS[name].show, place
    share = np.linspace(0.0, 1.0, wide)
    if way == "heat":
        scale = heat_scale(values, seen & np.isfinite(values))
        if scale is None:
            return
        log = "   logarithmic" if scale.offset else ""
        _bar(sheet, draw, place, viridis(share), [f"{scale.at(part):.4g}" for part in (0.0, 0.5, 1.0)], log)
    elif way == "unit" and values.ndim == 2:
        _bar(sheet, draw, place, np.repeat(srgb(share)[:, None], 3, axis=1), ["0", "0.5", "1"])
    else:
        _line(draw, (x, y), _how(way, name, values, seen, exposure))


def _how(way: str, name: str, values: np.ndarray, seen: np.ndarray, exposure: float) -> str:
    """Return the display of a three-component buffer in words."""
    if way == "radiance":
        of = "of a white surface, " if name == "irradiance" else ""
        return f"{of}{exposure:+.2f} stops, filmic"
    if way == "signed":
        return "x y z from -1 to 1 as red green blue"
    if way == "unit":
        return "0 to 1"
    if not seen.any():
        return ""
    low, high = values[seen].min(axis=0), values[seen].max(axis=0)
    low, high = (np.where(abs(end) < 1e-3 * (high - low), 0.0, end) for end in (low, high))  # a floor at 9e-05 counts as 0
    ranges = (f"{axis} {a:.3g} to {b:.3g}" for axis, a, b in zip("xyz", low.tolist(), high.tolist(), strict=True))
    return ",  ".join(ranges)


def _bar(
    sheet: Image.Image, draw: ImageDraw.ImageDraw, place: tuple[int, int], colours: np.ndarray, labels: list[str], more: str = ""
) -> None:
    """Draw a bar of colours (W, 3), with labels below its ends and middle."""
    (x, y), wide = place, len(colours)
    sheet.paste(Image.fromarray(eight_bits(np.tile(colours, (_BAR, 1, 1)))), (x, y))
    font = ImageFont.load_default(_SMALL)
    for share, label, anchor in zip((0.0, 0.5, 1.0), labels, ("la", "ma", "ra"), strict=True):
        draw.text((x + share * wide, y + _BAR + 3), label + (more if share == 0.5 else ""), _FAINT, font, anchor=anchor)


def _line(draw: ImageDraw.ImageDraw, place: tuple[int, int], words: str) -> None:
    draw.text((place[0], place[1] + 1), words, _FAINT, ImageFont.load_default(_SMALL))


def _ink(display: tuple[float, float, float]) -> tuple[int, int, int]:
    red, green, blue = (round(255.0 * value) for value in display)
    return red, green, blue
