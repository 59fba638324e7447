"""How long the last frames took."""

from __future__ import annotations

from collections import deque

FRAMES = 120  # that are kept


class FrameTimes:
    """Milliseconds of the last frames. frames: from picture to picture. work: without waiting. stages: the last frame's, by
    name, beside the core's own."""

    def __init__(self) -> None:
        self.frames: deque[float] = deque(maxlen=FRAMES)
        self.work: deque[float] = deque(maxlen=FRAMES)
        self.stages: dict[str, float] = {}

    def add(self, frame: float, work: float) -> None:
        """Add a frame, seconds each."""
        self.frames.append(1e3 * frame)
        self.work.append(1e3 * work)
