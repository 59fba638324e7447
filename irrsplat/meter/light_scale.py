"""The scale of light in false colours: unit, ends and colours; the automatic upper end is a round number."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from irrsplat.core.color import LUMINANCE, LUMINOUS_EFFICACY
from irrsplat.core.glsl import FALSE_COLOURS
from irrsplat.meter.readings import Unit

STEPS = 10  # of the scale, separated by isolines
PERCENTILE = 99.0  # of the pixels below the automatic upper end: spots near a light do not count
_ROUND = (1.0, 2.0, 5.0, 10.0)  # times a power of ten
# display colours from low to high, with the hues of Radiance's falsecolor
_ANCHORS = np.array(
    [
        *([0.24, 0.02, 0.36], [0.10, 0.12, 0.62], [0.00, 0.40, 0.78], [0.00, 0.60, 0.62], [0.08, 0.62, 0.26]),
        *([0.45, 0.62, 0.06], [0.72, 0.46, 0.08], [0.82, 0.20, 0.12], [0.96, 0.10, 0.04], [1.00, 0.55, 0.00], [1.00, 0.96, 0.20]),
    ]
)


@dataclass(frozen=True)
class LightScale:
    """A scale of light in false colours. highest: upper end in `unit`, None: automatic. decades: range of a logarithmic scale; a
    linear one begins at 0. lines: True for isolines between its STEPS."""

    unit: Unit = "lux"
    highest: float | None = None
    logarithmic: bool = False
    decades: int = 2
    lines: bool = True

    @property
    def weights(self) -> np.ndarray:
        """(3,) W/m² of red, green and blue in `unit`."""
        return LUMINANCE * np.float32(LUMINOUS_EFFICACY if self.unit == "lux" else 1.0)

    @property
    def shown_unit(self) -> str:
        """Unit for display."""
        return "lux" if self.unit == "lux" else "W/m²"

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper end in `unit`; the upper end must be set."""
        high = self.highest or 1.0
        return (high * 10.0**-self.decades if self.logarithmic else 0.0), high

    def up_to(self, brightest: float) -> LightScale:
        """Return the scale with an upper end: its own, or a round number above `brightest`, W/m² weighted like luminance."""
        if self.highest is not None:
            return self
        return replace(self, highest=round_above(brightest * (LUMINOUS_EFFICACY if self.unit == "lux" else 1.0)))

    def place(self, light: np.ndarray) -> np.ndarray:
        """Return the positions of light in `unit` on the scale, 0..1, of any shape."""
        low, high = self.ends
        place = np.log(np.maximum(light, 1e-30) / low) / np.log(high / low) if self.logarithmic else light / high
        return np.clip(place, 0.0, 1.0)

    def at(self, place: np.ndarray) -> np.ndarray:
        """Return the light in `unit` at positions 0..1 of the scale, of any shape."""
        low, high = self.ends
        return low * (high / low) ** place if self.logarithmic else high * place


def brightest(light: np.ndarray) -> float:
    """Return the automatic upper end of a scale for visible `light` (N,): a high percentile, 0 for none."""
    return float(np.percentile(light, PERCENTILE)) if len(light) else 0.0


def round_above(value: float) -> float:
    """Return the least 1, 2 or 5 times a power of ten that is at least `value`; 1 for values up to 0."""
    if not value > 0.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in _ROUND if step * power >= value * (1.0 - 1e-6))


def false_colours(count: int = FALSE_COLOURS) -> np.ndarray:
    """Return (count, 3) display colours 0..1 from low to high."""
    at = np.linspace(0.0, len(_ANCHORS) - 1.0, count)
    return np.stack([np.interp(at, np.arange(len(_ANCHORS)), channel) for channel in _ANCHORS.T], axis=1).astype(np.float32)
