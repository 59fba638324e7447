"""The colours of a signed error: in the pictures that `irrsplat verify` writes, and in the viewer."""

from __future__ import annotations

import numpy as np

FULL = 0.2  # of the mean irradiance: the error that has the full colour
BRIGHT, DARK, GREY = (178, 24, 43), (33, 102, 172), (120, 120, 120)  # too bright, too dark, no surface


def error_colours(share: np.ndarray) -> np.ndarray:
    """(..., 3) display colours 0..1 of errors (...) as shares of FULL: white at 0, BRIGHT from 1 and DARK to -1."""
    share = np.asarray(share)[..., None]
    end = np.where(share > 0.0, np.array(BRIGHT) / 255.0, np.array(DARK) / 255.0)
    found: np.ndarray = 1.0 + np.clip(np.abs(share), 0.0, 1.0) * (end - 1.0)
    return found
