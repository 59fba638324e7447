"""The arrays of a rendered view, from which the picture and the output formats are made."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from irrsplat.image.backdrop import BackdropKind, display_picture
from irrsplat.image.statistics import Statistics
from irrsplat.scene.model import Camera


@dataclass(frozen=True, repr=False)
class FrameBuffers:
    """The arrays of a rendered view, as documented by `Frame`, without its input and output."""

    image: np.ndarray
    direct: np.ndarray
    indirect: np.ndarray
    irradiance: np.ndarray
    emission: np.ndarray
    weight: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    smooth_normal: np.ndarray
    albedo: np.ndarray
    opacity: np.ndarray
    depth: np.ndarray
    alpha: np.ndarray
    records_position: np.ndarray
    records_normal: np.ndarray
    records_irradiance: np.ndarray
    records_radius: np.ndarray
    stats: Statistics = field(default_factory=Statistics)
    figures: dict[str, np.ndarray] = field(default_factory=dict)
    backdrop: BackdropKind = "sky"
    camera: Camera | None = None

    @property
    def exposure(self) -> float:
        """The picture's exposure in stops (stats["exposure"]; 0 where that is missing)."""
        return float(self.stats.get("exposure", 0.0))

    @property
    def aspect(self) -> float:
        """Its width by its height."""
        height, width = self.image.shape[:2] if self.image.size else self.depth.shape
        return float(width / height)

    @property
    def picture(self) -> np.ndarray:
        """The image as a screen shows it, (H, W, 3) sRGB-encoded 0..1, before its backdrop; (H, W, 4) where that is clear."""
        return display_picture(self.image, self.exposure, self.alpha, self.backdrop)
