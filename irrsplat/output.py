"""The finished frame as numpy arrays, and the files it can become: PNG, EXR, NPZ, or a folder of pictures."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Frame:
    """One rendered view; every array belongs to the caller, float32, linear, top row first (see buffers.CHANNELS).

    records_*: the cache, N rows. stats: records, rounds, converged, ms per stage with the clock's name, GL renderer,
    settings, exposure (stops, resolved). figures: further (H, W, 3) radiance pictures by name, for the figures of the paper.
    """

    image: np.ndarray
    direct: np.ndarray
    indirect: np.ndarray
    irradiance: np.ndarray
    emission: np.ndarray
    weight: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    albedo: np.ndarray
    depth: np.ndarray
    records_position: np.ndarray
    records_normal: np.ndarray
    records_irradiance: np.ndarray
    records_radius: np.ndarray
    stats: dict[str, Any] = field(default_factory=dict)
    figures: dict[str, np.ndarray] = field(default_factory=dict)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write this frame in the format that `path`'s ending names."""
        raise NotImplementedError  # STUB, replaced by the output helper
