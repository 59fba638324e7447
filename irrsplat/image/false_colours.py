"""Light in false colours with isolines and a legend, as in the viewer's buffer `light`, without a window."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from irrsplat.core.files import eight_bits
from irrsplat.meter.light_scale import STEPS, LightScale, false_colours

Colour = tuple[int, int, int]

GROUND = (0.11, 0.11, 0.12)  # display colour of the legend and of pixels without a surface
LINE = 0.35  # brightness of an isoline
SAME = 0.02  # relative difference in depth of neighbouring pixels on one surface
_TEXT = (0.92, 0.92, 0.90)
_LINE = 1.45  # line spacing of a legend, in font sizes


def coloured(light: np.ndarray, depth: np.ndarray, scale: LightScale) -> np.ndarray:
    """Return (H, W, 3) display colours 0..1 of `light` (H, W), in the scale's unit, with isolines.

    depth: (H, W), +inf for pixels without a surface; both arrays top row first. The scale's upper end must be set. As in
    shaders/viewer/buffers/light.frag, a pixel is on an isoline if its light is in another step of the scale than the pixel right
    of it or above it on the same surface.
    """
    place, seen, palette = scale.place(light), np.isfinite(depth), false_colours()
    at = np.arange(len(palette)) / (len(palette) - 1.0)
    picture = np.stack([np.interp(place, at, channel) for channel in palette.T], axis=-1)
    if scale.lines:
        step = np.minimum(np.floor(place * STEPS), STEPS - 1)
        near = np.where(seen, depth, 0.0)
        line = np.zeros(light.shape, bool)
        for here, beside in (((slice(None), slice(None, -1)), (slice(None), slice(1, None))), (np.s_[1:], np.s_[:-1])):
            same = np.abs(near[beside] - near[here]) < SAME * near[here]
            line[here] |= same & (step[here] != step[beside])
        picture[line] *= LINE
    return np.where(seen[..., None], picture, GROUND)


def with_legend(picture: np.ndarray, scale: LightScale, title: str, unit: str) -> np.ndarray:
    """Return the picture (H, W, 3) with a legend at its right: colour scale, numbers, title and unit."""
    height = picture.shape[0]
    size = float(np.clip(height / 36.0, 9.0, 28.0))
    font = ImageFont.load_default(size)
    margin, bar = round(size), round(1.6 * size)
    room = (height - 5.0 * size) / (1.3 * size)  # number of labels that fit
    steps = next((n for n in (STEPS, STEPS // 2) if n <= room), 1)
    share = np.arange(steps + 1) / steps
    labels = [f"{value:.{3 if scale.logarithmic else 4}g}" for value in scale.at(share).tolist()]
    kind = f"logarithmic, {scale.decades} decade{'s' if scale.decades > 1 else ''}" if scale.logarithmic else ""
    head = [line for line in (title, unit, kind) if line]
    ruler = ImageDraw.Draw(Image.new("RGB", (1, 1)))
    text_width = max(ruler.textlength(label, font) for label in labels) + bar + 0.5 * size
    width = round(2 * margin + max(text_width, *(ruler.textlength(line, font) for line in head)))

    top = min(round(margin + 1.3 * size * len(head) + 0.8 * size), height - 1)
    bottom = max(height - margin, top + 1)
    panel = np.tile(np.array(GROUND), (height, width, 1))
    palette = false_colours()
    rows = (bottom - 0.5 - np.arange(top, bottom)) / (bottom - top)  # 0 at the lower end, 1 at the upper one
    colours = np.stack([np.interp(rows, np.arange(len(palette)) / (len(palette) - 1.0), c) for c in palette.T], axis=-1)
    if scale.lines:
        lines = np.clip(
            np.round(bottom - 1 - np.arange(1, STEPS) / STEPS * (bottom - top)).astype(int) - top, 0, bottom - top - 1
        )
        colours[lines] *= LINE
    panel[top:bottom, margin : margin + bar] = colours[:, None]

    image = Image.fromarray(eight_bits(np.concatenate([picture, panel], axis=1)))
    draw, left = ImageDraw.Draw(image), picture.shape[1] + margin
    ink = tuple(round(255.0 * value) for value in _TEXT)
    for i, line in enumerate(head):
        write_words(draw, (left, margin + 1.3 * size * i), line, ink, size)
    for part, label in zip(share.tolist(), labels, strict=True):
        draw.text((left + bar + 0.5 * size, bottom - part * (bottom - top)), label, ink, font, anchor="lm")
    return np.asarray(image, np.float32) / np.float32(255.0)


def write_words(draw: ImageDraw.ImageDraw, place: tuple[float, float], words: str, ink: tuple[int, ...], size: float) -> None:
    """Write words, with ² as a small raised 2, which Pillow's own font lacks."""
    x, y = place
    font = ImageFont.load_default(size)
    for i, part in enumerate(words.split("²")):
        if i:
            small = ImageFont.load_default(0.65 * size)
            draw.text((x, y - 0.12 * size), "2", ink, small)
            x += draw.textlength("2", small)
        draw.text((x, y), part, ink, font)
        x += draw.textlength(part, font)


# ---- a legend of colours, below or over a picture ----------------------------------------------------------------------


def legend_height(font: float, lines: Sequence[object]) -> int:
    """Return the height of `write_legend` in pixels."""
    return round((_LINE * len(lines) + 0.7) * font)


def write_legend(image: Image.Image, top: int, font: float, lines: Sequence[tuple[Colour, str]]) -> None:
    """Write lines of text from `top` on, each after a patch of its colour; long lines are scaled down. font: pixels."""
    draw = ImageDraw.Draw(image)
    widest = max(draw.textlength(words, ImageFont.load_default(font)) for _, words in lines)
    small = ImageFont.load_default(max(font * min(1.0, (image.width - 2.8 * font) / widest), 4.0))
    draw.rectangle([0, top, image.width, image.height], (255, 255, 255))
    for i, (colour, words) in enumerate(lines):
        y = top + (0.35 + _LINE * i) * font
        draw.rectangle([0.7 * font, y + 0.35 * font, 1.5 * font, y + 1.15 * font], colour)
        draw.text((2.1 * font, y + 0.1 * font), words, (30, 30, 30), small)
