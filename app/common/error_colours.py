"""Colours of a signed error, for `irrsplat verify` and the viewer."""

from __future__ import annotations

import numpy as np

FULL = 0.2  # share of the mean irradiance at full colour
BRIGHT, DARK, GREY = (178, 24, 43), (33, 102, 172), (120, 120, 120)  # too bright, too dark, no surface


def error_colours(share: np.ndarray) -> np.ndarray:
    """Return display colours (..., 3) in 0..1 of errors (...) as shares of FULL: white at 0, BRIGHT from 1, DARK to -1."""
    share = np.asarray(share)[..., None]
    end = np.where(share > 0.0, np.array(BRIGHT) / 255.0, np.array(DARK) / 255.0)
    found: np.ndarray = 1.0 + np.clip(np.abs(share), 0.0, 1.0) * (end - 1.0)
    return found
