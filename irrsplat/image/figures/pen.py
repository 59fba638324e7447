"""A pen for diagrams over pictures: lines, arrows and labels with a light rim, legible on any background."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]
Point = np.ndarray | tuple[float, float]

_RIM = (255, 255, 255)
_LINE = 1.45  # line spacing of the legend, in font sizes
_SCRIPT = 0.68  # relative size of sub- and superscripts
_TOKENS = re.compile(r"_(\w)|\^(\w)|√\{(.*?)\}|([^_^√]+)")


class Pen:
    """Draws into an RGB `image`; widths are in sixteenths of `font`, the letter height in pixels.

    top: pixels at the image's upper edge without labels.
    """

    def __init__(self, image: Image.Image, font: float, top: float = 0.0) -> None:
        self.draw = ImageDraw.Draw(image, "RGBA")
        self.size = np.array(image.size)
        self.font = font
        self.unit = font / 16.0
        self.least = np.array([0.3 * font, top])

    def line(self, points: np.ndarray, colour: Colour, width: float, halo: bool = True) -> None:
        """Draw a line through points (N, 2)."""
        path = [(float(x), float(y)) for x, y in points]
        if halo:
            self.draw.line(path, (*_RIM, 150), round((width + 2.0) * self.unit), "curve")
        self.draw.line(path, colour, max(1, round(width * self.unit)), "curve")

    def dashes(self, points: np.ndarray, drawn: np.ndarray, colour: Colour, width: float) -> None:
        """Draw the segments of a line through points (N, 2) whose first point is marked in `drawn` (N,)."""
        for i in np.flatnonzero(drawn[:-1]):
            self.line(points[i : i + 2], colour, width, halo=False)

    def arrow(self, start: np.ndarray, end: np.ndarray, colour: Colour, width: float) -> None:
        """Draw a line with a head at `end`."""
        along = end - start
        length = float(np.linalg.norm(along))
        if length < 1.0:
            return
        along /= length
        across = np.array([-along[1], along[0]])
        head = min(9.0 * self.unit, 0.6 * length)
        neck = end - head * along
        corners = np.array([end, neck + 0.42 * head * across, neck - 0.42 * head * across])
        self.line(np.array([start, neck]), colour, width)
        self.line(np.array([*corners, corners[0]]), _RIM, 1.4, halo=False)
        self.draw.polygon([tuple(map(float, c)) for c in corners], colour)

    def polygon(self, corners: np.ndarray, colour: Colour, alpha: int, width: float = 1.3) -> None:
        """Draw a filled polygon with corners (N, 2); alpha: of the filling, 0..255."""
        self.draw.polygon([tuple(map(float, c)) for c in corners], (*colour, alpha))
        self.line(np.concatenate([corners, corners[:1]]), colour, width)

    def disc(self, centre: np.ndarray, radius: float, colour: Colour, alpha: int, width: float) -> None:
        """Draw a filled circle; alpha: of the filling, 0..255."""
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        self.polygon(centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), colour, alpha, width)

    def dot(self, centre: np.ndarray, radius: float, colour: Colour) -> None:
        """Draw a small disc with a light rim; radius: in sixteenths of the font."""
        for size, fill in (((radius + 1.0) * self.unit, _RIM), (radius * self.unit, colour)):
            self.draw.ellipse([*(centre - size), *(centre + size)], fill)

    def label(self, words: str, at: np.ndarray, direction: Point, colour: Colour) -> None:
        """Write words next to the point `at`, offset in `direction` (x, y), inside the image."""
        width, height = width_of(words, self.font), self.font * 1.2
        off = np.asarray(direction, float)
        off = off / max(float(np.linalg.norm(off)), 1e-9)
        middle = at + off * (5.0 * self.unit + np.array([width, height]) / 2.0)
        most = self.size - (width, height) - 0.3 * self.font
        corner = np.maximum(np.minimum(middle - (width / 2.0, height / 2.0), most), self.least)
        self.text(corner, words, colour)

    def text(self, corner: Point, words: str, colour: Colour) -> None:
        """Write words from their upper left corner, on a light rim; _k is a subscript, ^2 a superscript, √{…} a root."""
        for rim, fill in ((round(2.4 * self.unit), _RIM), (0, colour)):
            _set(self.draw, float(corner[0]), float(corner[1]), words, self.font, fill, rim)


def legend_height(font: float, lines: Sequence[object]) -> int:
    """Return the height of `write_legend` in pixels."""
    return round((_LINE * len(lines) + 0.7) * font)


def write_legend(image: Image.Image, top: int, font: float, lines: Sequence[tuple[Colour, str]]) -> None:
    """Write lines of text from `top` on, each after a patch of its colour; long lines are scaled down."""
    widest = max(width_of(words, font) for _, words in lines)
    small = font * min(1.0, (image.width - 2.8 * font) / widest)
    pen = Pen(image, small)
    pen.draw.rectangle([0, top, image.width, image.height], (255, 255, 255))
    for i, (colour, words) in enumerate(lines):
        y = top + (0.35 + _LINE * i) * font
        pen.draw.rectangle([0.7 * font, y + 0.35 * font, 1.5 * font, y + 1.15 * font], colour)
        pen.text((2.1 * font, y + 0.1 * font), words, (30, 30, 30))


@cache
def _font(size: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(max(size, 4.0))


def width_of(words: str, size: float) -> float:
    """Return the width of the words at this size, in pixels."""
    canvas = ImageDraw.Draw(Image.new("RGB", (1, 1)))
    return _set(canvas, 0.0, 0.0, words, size, (0, 0, 0), 0)


def _set(draw: ImageDraw.ImageDraw, x: float, y: float, words: str, size: float, fill: Colour, rim: int) -> float:
    """Write `words` from x on; return the end. Pillow's font lacks √ and subscripts, so they are drawn."""
    for below, above, rooted, plain in _TOKENS.findall(words):
        if rooted:
            start = x + 0.55 * size
            end = _set(draw, start, y, rooted, size, fill, rim)
            tick = [(x, y + 0.75 * size), (x + 0.15 * size, y + 0.65 * size), (x + 0.32 * size, y + 1.1 * size)]
            tick += [(x + 0.5 * size, y + 0.05 * size), (end, y + 0.05 * size)]
            draw.line(tick, fill, max(1, round(0.07 * size)) + rim, "curve")
            x = end
            continue
        part = below or above or plain
        font = _font(size * _SCRIPT if below or above else size)
        drop = 0.5 * size if below else -0.12 * size if above else 0.0
        draw.text((x, y + drop), part, fill, font=font, stroke_width=rim, stroke_fill=fill)
        x += draw.textlength(part, font=font)
    return x
