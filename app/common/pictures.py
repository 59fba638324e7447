"""Saving of the frames of `irrsplat render`, with false colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from irrsplat.app.common.false_colours import FalseColours
    from irrsplat.image.frame import Frame
    from irrsplat.renderer import Renderer
    from irrsplat.scene.model import Camera


@dataclass(frozen=True)
class Pictures:
    """Output options of frames. coloured: false colours of a .png, or None."""

    coloured: FalseColours | None = None

    def save(self, name: str, frame: Frame, buffers: list[str] | None, renderer: Renderer, camera: Camera) -> None:
        """Write a new frame of `renderer` from `camera`; raise IrrsplatError for a failed write."""
        if self.coloured is not None and name.lower().endswith(".png"):
            self.coloured.save(name, frame, renderer, camera)
        else:
            frame.save(name, buffers)
