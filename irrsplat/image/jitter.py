"""Where the samples of a pixel lie, and the camera that sees each of them: what antialiasing averages over."""

from __future__ import annotations

import math

from irrsplat.scene.model import Camera, PictureCamera

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


def jittered(camera: Camera, offset: tuple[float, float], size: tuple[int, int]) -> PictureCamera:
    """`camera`, seeing at every pixel's centre what it saw at `offset` from there, in pixels to the right and up. size: of what
    is drawn, (width, height)."""
    whole = camera.whole(size)
    shift = -offset[0] / whole[0], -offset[1] / whole[1]
    part = camera.part if isinstance(camera, PictureCamera) else None
    return PictureCamera(camera.eye, camera.target, camera.up, camera.fov, camera.name, shift, part)
