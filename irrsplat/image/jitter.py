"""Sample positions within a pixel, and the camera of each sample, for antialiasing."""

from __future__ import annotations

import math

from irrsplat.scene.model import Camera, PictureCamera

_BASES = 2, 3, 5  # of the Halton sequence: x, y and the rotation


def sample_offset(number: int) -> tuple[float, float, float]:
    """Return the offset of sample `number` (from 0) in its pixel, x right and y up, in pixels (-½..½), and its shadow rotation in
    radians.

    Sample 0 is the centre, unrotated. Any number of samples fills the pixel evenly (Halton 1960, shifted by half a pixel).
    """
    x, y, rotation = (_radical_inverse(number, base) for base in _BASES)
    # a pixel's four shadow samples form a square, so a quarter turn changes nothing
    return (x + 0.5) % 1.0 - 0.5, (y + 0.5) % 1.0 - 0.5, 0.5 * math.pi * rotation


def _radical_inverse(number: int, base: int) -> float:
    """Return the radical inverse of `number` in `base`, 0..1."""
    value, place = 0.0, 1.0 / base
    while number:
        number, digit = divmod(number, base)
        value, place = value + digit * place, place / base
    return value


def jittered(camera: Camera, offset: tuple[float, float], size: tuple[int, int]) -> PictureCamera:
    """Return `camera` shifted so that pixel centres sample `offset`, in pixels right and up. size: (width, height) drawn."""
    whole = camera.whole(size)
    shift = -offset[0] / whole[0], -offset[1] / whole[1]
    part = camera.part if isinstance(camera, PictureCamera) else None
    return PictureCamera(camera.eye, camera.target, camera.up, camera.fov, camera.name, shift, part)
