"""The paper's figures 1, 3 and 4 (Jones 2010), taken while a view is rendered; its other figures are buffers of the frame."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from irrsplat.image.figures.figure1 import diagram
from irrsplat.image.frame import Frame
from irrsplat.image.view import Progress
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings


class PaperFigures:
    """Keeps the first round's splat buffer while a view is rendered: it is called after each round, and calls `on_round` in turn.

    splatted: returns the splat buffer's sums (H, W, 4) of the first so many records.
    """

    def __init__(self, splatted: Callable[[int], np.ndarray], on_round: Callable[[Progress], None] | None) -> None:
        self._splatted, self._on_round = splatted, on_round
        self._records: list[int] = []  # in the cache after each round
        self._first_samples: np.ndarray | None = None

    def __call__(self, now: Progress) -> None:
        self._records.append(now.records)
        if len(self._records) <= 2:  # again in the second round: the first one's records know their neighbours by then
            self._first_samples = self._splatted(self._records[0])
        if self._on_round is not None:
            self._on_round(now)

    def figures(self, frame: Frame, eye: Camera, settings: Settings) -> dict[str, np.ndarray]:
        """Frame.figures of what was rendered: the splat buffer at first and in the end, as radiance, and figure 1."""
        first = self._splatted(0) if self._first_samples is None else self._first_samples
        splats = {"first_samples": first, "splat_buffer": self._splatted(frame.stats["records"])}
        pictures = {name: frame.albedo / np.float32(np.pi) * sums[..., :3] for name, sums in splats.items()}
        return pictures | {"quad": diagram(frame, eye, settings)}
