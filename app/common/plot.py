"""Log-log line plots, drawn with the pen of the diagrams."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from irrsplat.image.figures.pen import Colour, Pen, width_of

_SIZE = (1040, 720)  # pixels
_FONT = 20.0
_FINER = 2  # supersampling factor for smooth edges
_LEFT, _RIGHT, _TOP, _BOTTOM = 96, 32, 64, 84  # margins
_INK, _FAINT, _GRID = (40, 40, 40), (110, 110, 110), (224, 224, 224)
_PALETTE: tuple[Colour, ...] = ((27, 94, 160), (200, 80, 20), (60, 130, 60), (130, 60, 150), (90, 90, 90))
_STEPS = (1, 2, 5)  # numbered multiples in each decade
_WIDE = 500.0  # ratio of an axis's ends above which only powers of ten fit


Place = Callable[[np.ndarray, np.ndarray], np.ndarray]  # x and y to pixels (…, 2)


@dataclass(frozen=True)
class Line:
    """Points (x, y), both (N,) and positive, joined in order; `words` are the legend's entry."""

    words: str
    x: np.ndarray
    y: np.ndarray
    colour: Colour


def palette(count: int) -> list[Colour]:
    """Return `count` distinct, reproducible colours: a fixed list, then hues around the circle."""
    steps = np.arange(max(0, count - len(_PALETTE)))
    hues = (0.12 + steps * 0.618034) % 1.0  # steps of the golden ratio never repeat a hue
    made = [tuple(round(160 * channel) for channel in colorsys.hsv_to_rgb(hue, 0.9, 1.0)) for hue in hues]
    return [*_PALETTE[:count], *((r, g, b) for r, g, b in made)]


def loglog(lines: Sequence[Line], title: str, x_label: str, y_label: str) -> np.ndarray:
    """Return display values (H, W, 3) in 0..1 of the lines with axes, grid, numbers, and a legend."""
    size = tuple(_FINER * n for n in _SIZE)
    image = Image.new("RGB", (size[0], size[1]), (255, 255, 255))
    pen = Pen(image, _FINER * _FONT)
    frame = np.array([[_LEFT, _SIZE[1] - _BOTTOM], [_SIZE[0] - _RIGHT, _TOP]], float) * _FINER  # lower left, upper right
    spans = [_span(np.concatenate([getattr(line, axis) for line in lines] or [np.zeros(0)])) for axis in "xy"]

    def place(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        logs = np.log(np.stack([x, y], axis=-1))
        low, high = np.log(np.array(spans).T)
        pixels: np.ndarray = frame[0] + (logs - low) / (high - low) * (frame[1] - frame[0])
        return pixels

    legend = _legend_size(pen, lines)
    corner = _free_corner(frame, legend, pen.font, [place(line.x, line.y) for line in lines])
    if corner is None:  # place it outside the axes
        frame[1][0] -= legend[0]
        corner = frame[1][0], frame[1][1], False
    _axes(pen, frame, spans, place)
    places = [place(line.x, line.y) for line in lines]
    for line, at in zip(lines, places, strict=True):
        if len(at) > 1:
            pen.line(at, line.colour, 2.6)
        for point in at:
            pen.dot(point, 4.2, line.colour)
    _legend(pen, lines, legend, *corner)
    pen.text((frame[0][0], 0.9 * pen.font), title, _INK)
    pen.text(((frame.sum(0)[0] - width_of(x_label, pen.font)) / 2.0, size[1] - 1.7 * pen.font), x_label, _INK)
    _upright(image, pen, y_label, frame)
    return np.asarray(image.resize(_SIZE, Image.Resampling.LANCZOS)) / 255.0


def _span(values: np.ndarray) -> tuple[float, float]:
    """Return the ends of an axis for these values, with a margin; (1, 10) without values."""
    if not len(values):
        return 1.0, 10.0
    low, high = float(values.min()), float(values.max())
    room = max((high / low) ** 0.06, 1.12)
    return low / room, high * room


def ticks(low: float, high: float) -> Iterator[tuple[float, bool]]:
    """Yield multiples of powers of ten from low to high, with True for numbered ones; wide ranges have powers only."""
    steps = _STEPS if high < _WIDE * low else _STEPS[:1]
    for decade in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1):
        for step in range(1, 10):
            value = step * 10.0**decade
            if low <= value <= high:
                yield value, step in steps


def _axes(pen: Pen, frame: np.ndarray, spans: list[tuple[float, float]], place: Place) -> None:
    """Draw the grid, the frame, and its numbers."""
    for value, numbered in ticks(*spans[0]):
        x = place(np.array(value), np.array(spans[1][0]))[0]
        ends = np.array([[x, frame[0][1]], [x, frame[1][1]]])
        pen.line(ends, _GRID if numbered else (240, 240, 240), 1.2, halo=False)
        if numbered:
            words = f"{value:,.10g}"
            pen.text((x - width_of(words, pen.font) / 2.0, frame[0][1] + 0.5 * pen.font), words, _INK)
    for value, numbered in ticks(*spans[1]):
        y = place(np.array(spans[0][0]), np.array(value))[1]
        ends = np.array([[frame[0][0], y], [frame[1][0], y]])
        pen.line(ends, _GRID if numbered else (240, 240, 240), 1.2, halo=False)
        if numbered:
            words = f"{value:.10g}"
            pen.text((frame[0][0] - width_of(words, pen.font) - 0.5 * pen.font, y - 0.6 * pen.font), words, _INK)
    (left, bottom), (right, top) = frame
    pen.line(np.array([[left, top], [left, bottom], [right, bottom]]), _FAINT, 1.6, halo=False)


def _legend_size(pen: Pen, lines: Sequence[Line]) -> np.ndarray:
    """Return the size (2,) of the legend in pixels."""
    widest = max((width_of(line.words, pen.font) for line in lines), default=0.0)
    return np.array([widest + 2.2 * pen.font, (1.5 * len(lines) + 0.6) * pen.font])


def _free_corner(
    frame: np.ndarray, size: np.ndarray, room: float, places: Sequence[np.ndarray]
) -> tuple[float, float, bool] | None:
    """Return the upper left corner of a legend in a free corner of the frame, and True for a right corner.

    places: (N, 2) points of each line. room: margin in pixels. None: no corner is free.
    """
    (left, bottom), (right, top) = frame
    drawn = np.concatenate([np.zeros((0, 2)), *(_along(at) for at in places)])
    for x, y in ((right, top), (left, bottom), (right, bottom), (left, top)):  # falling curves leave the first corners free
        low = np.array([x - size[0] if x == right else x, y if y == top else y - size[1]])
        if not ((drawn > low - room) & (drawn < low + size + room)).all(1).any():
            return float(low[0]), float(low[1]), bool(x == right)
    return None


def _legend(pen: Pen, lines: Sequence[Line], size: np.ndarray, x: float, y: float, flush_right: bool) -> None:
    """Draw the legend in line colours, in the box with upper left corner (x, y)."""
    for number, line in enumerate(lines):
        width = width_of(line.words, pen.font)
        at = x + size[0] - 0.6 * pen.font - width if flush_right else x + 1.6 * pen.font
        level = y + (0.5 + 1.5 * number) * pen.font
        pen.dot(np.array([at - 0.8 * pen.font, level + 0.65 * pen.font]), 4.2, line.colour)
        pen.text((at, level), line.words, line.colour)


def _along(at: np.ndarray) -> np.ndarray:
    """Return dense points (M, 2) along the polyline (N, 2)."""
    steps = np.linspace(0.0, 1.0, 32)[:, None, None]
    return np.concatenate([at, (at[:-1] + steps * (at[1:] - at[:-1])).reshape(-1, 2)])


def _upright(image: Image.Image, pen: Pen, words: str, frame: np.ndarray) -> None:
    """Draw words along the left edge, upwards."""
    strip = Image.new("RGB", (math.ceil(width_of(words, pen.font)) + 8, math.ceil(1.5 * pen.font)), (255, 255, 255))
    Pen(strip, pen.font).text((4, 0.1 * pen.font), words, _INK)
    turned = strip.rotate(90, expand=True)
    image.paste(turned, (round(0.4 * pen.font), round((frame.sum(0)[1] - turned.height) / 2.0)))
