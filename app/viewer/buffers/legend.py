"""The legend of a buffer: the ends of its scale, their unit, and a line of text."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.image.tonemap import viridis


@dataclass(frozen=True)
class Legend:
    """The legend of a picture: `text`, and its scale from `low` to `high` in `unit`, as they are printed.

    colours: (N, 3) display colours 0..1 from low to high, None where there is no colour scale. mark: the position 0..1 on the
    scale of what the text calls the threshold, None for no mark.
    """

    text: str
    low: str = ""
    high: str = ""
    unit: str = ""
    colours: np.ndarray | None = None
    mark: float | None = None


def colour_map() -> np.ndarray:
    """(64, 3) display colours of the viridis map, for the scale of a legend."""
    return viridis(np.linspace(0.0, 1.0, 64))
