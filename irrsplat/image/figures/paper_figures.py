"""The paper's figures 1, 3 and 4 (Jones 2010), made during a render; its other figures are buffers of the frame."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from irrsplat.image.frame import Frame
from irrsplat.image.view import Progress
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings


class PaperFigures:
    """Keeps the first round's splat buffer during a render: called after each round, it calls `on_round` in turn.

    splatted: returns the splat buffer's sums (H, W, 4) of the given number of records.
    """

    def __init__(self, splatted: Callable[[int], np.ndarray], on_round: Callable[[Progress], None] | None) -> None:
        self._splatted, self._on_round = splatted, on_round
        self._records: list[int] = []  # in the cache after each round
        self._first_samples: np.ndarray | None = None

    def __call__(self, now: Progress) -> None:
        self._records.append(now.records)
        if len(self._records) <= 2:  # again after the second round, which sets the first records' radii from their neighbours
            self._first_samples = self._splatted(self._records[0])
        if self._on_round is not None:
            self._on_round(now)

    def figures(self, frame: Frame, eye: Camera, settings: Settings) -> dict[str, np.ndarray]:
        """Return Frame.figures: the first and the final splat buffer as radiance, and figure 1."""
        from irrsplat.image.figures.figure1 import diagram  # and Pillow: other renders need neither

        first = self._splatted(0) if self._first_samples is None else self._first_samples
        splats = {"first_samples": first, "splat_buffer": self._splatted(frame.stats["records"])}
        pictures = {name: frame.albedo / np.float32(np.pi) * sums[..., :3] for name, sums in splats.items()}
        return pictures | {"quad": diagram(frame, eye, settings)}
