"""Log-log line plots, by matplotlib (extra `peers`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from irrsplat.core.errors import IrrsplatError
from irrsplat.image.false_colours import Colour

_SIZE, _DPI = (10.4, 7.2), 100  # inches; pixels per inch


@dataclass(frozen=True)
class Line:
    """Points (x, y), both (N,) and positive, joined in order; `words` are the legend's entry. colour: None for another each."""

    words: str
    x: np.ndarray
    y: np.ndarray
    colour: Colour | None = None


def require() -> None:
    """Raise IrrsplatError if matplotlib is missing."""
    if find_spec("matplotlib") is None:
        raise IrrsplatError("a plot needs the Python module 'matplotlib'; run: pip install 'irrsplat[peers]'")


def loglog(lines: Sequence[Line], title: str, x_label: str, y_label: str) -> np.ndarray:
    """Return display values (H, W, 3) in 0..1 of the lines with axes, grid, numbers, and a legend."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE, dpi=_DPI, layout="constrained")
    canvas, axes = FigureCanvasAgg(figure), figure.add_subplot()
    for line in lines:
        colour = None if line.colour is None else tuple(channel / 255.0 for channel in line.colour)
        axes.loglog(line.x, line.y, "o-", color=colour, label=line.words)
    axes.set(title=title, xlabel=x_label, ylabel=y_label)
    axes.grid(True, which="both", alpha=0.3)
    if lines:
        axes.legend()
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3] / 255.0
