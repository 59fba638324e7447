"""Where the samples of a pixel lie, and the camera that sees each of them: what antialiasing averages over."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from irrsplat.scene.model import Camera

_BASES = 2, 3, 5  # of the Halton sequence: x, y and the rotation


def sample_offset(number: int) -> tuple[float, float, float]:
    """Where sample `number` (0: the first) lies in its pixel: x to the right and y up from the centre, in pixels (-½..½), and the
    rotation of its shadow samples in radians. The first is the centre itself, unrotated, as every frame has it.

    However many samples there are, they fill the pixel evenly (Halton 1960, shifted by half a pixel).
    """
    x, y, rotation = (_radical_inverse(number, base) for base in _BASES)
    # the four shadow samples of a pixel form a square, so a quarter turn changes nothing
    return (x + 0.5) % 1.0 - 0.5, (y + 0.5) % 1.0 - 0.5, 0.5 * math.pi * rotation


def _radical_inverse(number: int, base: int) -> float:
    """The digits of `number` in `base`, mirrored at the point: 0..1."""
    value, place = 0.0, 1.0 / base
    while number:
        number, digit = divmod(number, base)
        value, place = value + digit * place, place / base
    return value


@dataclass(frozen=True)
class JitteredCamera(Camera):
    """A camera whose picture is shifted by `shift`: of its width to the right, and of its height up."""

    shift: tuple[float, float] = (0.0, 0.0)

    def clip_from_view(self, aspect: float, near: float, far: float) -> np.ndarray:
        """(4, 4) float64, as Camera's, off its centre."""
        matrix = super().clip_from_view(aspect, near, far)
        matrix[:2, 2] -= 2.0 * np.asarray(self.shift)
        return matrix


def jittered(camera: Camera, offset: tuple[float, float], size: tuple[int, int]) -> JitteredCamera:
    """`camera`, seeing at every pixel's centre what it saw at `offset` from there, in pixels to the right and up."""
    shift = -offset[0] / size[0], -offset[1] / size[1]
    return JitteredCamera(camera.eye, camera.target, camera.up, camera.fov, camera.name, shift)
