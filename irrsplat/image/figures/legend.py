"""A legend of colours, below or over a picture."""

from __future__ import annotations

from collections.abc import Sequence

from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]

_LINE = 1.45  # line spacing, in font sizes


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
