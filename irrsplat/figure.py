"""Figure 1 of the paper over a picture of the scene: how a record's sphere becomes a quad on the eye's screen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.output import Frame
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings


@dataclass(frozen=True)
class Shown:
    """The record that the figure shows: its place (3,) in world space and its radius R_k in metres."""

    position: np.ndarray
    radius: float


def choose(frame: Frame, camera: Camera) -> Shown:
    """A visible record in the middle of the view whose sphere is large enough to see."""
    raise NotImplementedError  # STUB the figure helper writes this


def side_camera(camera: Camera, record: Shown) -> Camera:
    """A camera beside the eye that sees the eye, the record and the line between them."""
    raise NotImplementedError


def draw(picture: np.ndarray, beside: Camera, eye: Camera, record: Shown, settings: Settings) -> np.ndarray:
    """`picture` (H, W, 3), display values 0..1 seen from `beside`, with the sphere, the quad and the eye vector on top."""
    raise NotImplementedError
