"""Skies from the six faces of a cube map, and from spherical harmonics."""

from __future__ import annotations

import numpy as np

from irrsplat.sky.sphere import solid_angles, texel_directions

# Directions of each face's centre, right and upper edge, seen from inside, in the order of glTF's EXT_lights_image_based. They
# are OpenGL's cube map faces, each mirrored about its vertical axis, as in the extension.
_FACES = np.array(
    [
        [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[-1, 0, 0], [0, 0, -1], [0, 1, 0]],
        [[0, 1, 0], [-1, 0, 0], [0, 0, -1]],
        [[0, -1, 0], [-1, 0, 0], [0, 0, 1]],
        [[0, 0, 1], [-1, 0, 0], [0, 1, 0]],
        [[0, 0, -1], [1, 0, 0], [0, 1, 0]],
    ],
    float,
)
_ROWS = 64  # of a map from harmonics, which are smooth
_MOST_ROWS = 2048
# factors of the bands from radiance to irradiance (Ramamoorthi and Hanrahan 2001, eq. 8)
_COSINE = np.pi * np.array([1.0, *[2.0 / 3.0] * 3, *[0.25] * 5])


def map_of_faces(faces: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return the (H, W, 3) float32 equirectangular map of a cube's faces (6, N, N, 3): +x, −x, +y, −y, +z, −z.

    The faces have the top row first, seen from inside. turn: (3, 3) maps directions of the map to the cube, `turn @ direction`.
    """
    size = faces.shape[1]
    height = min(2 * size, _MOST_ROWS)
    found = np.zeros((height, 2 * height, 3), np.float32)
    for row in range(0, height, 64):  # rows at once, to limit the memory
        rows = np.arange(row, min(row + 64, height))
        d = texel_directions(height, 2 * height, rows) @ turn.T
        face = np.argmax(d @ _FACES[:, 0].T, axis=-1)
        middle, right, up = (np.einsum("...i,...i", _FACES[face, k], d) for k in range(3))
        x, y = ((0.5 + 0.5 * part / middle) * size - 0.5 for part in (right, -up))
        found[rows] = _between(faces, face, x, y)
    return found


def _between(faces: np.ndarray, face: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return (…, 3) values at (x, y) from the centre of the upper left texel, bilinear; edges are clamped."""
    size = faces.shape[1]
    x, y = np.clip(x, 0.0, size - 1.0), np.clip(y, 0.0, size - 1.0)
    i, k = np.minimum(x.astype(int), max(size - 2, 0)), np.minimum(y.astype(int), max(size - 2, 0))
    s, t = (x - i)[..., None], (y - k)[..., None]
    right, below = np.minimum(i + 1, size - 1), np.minimum(k + 1, size - 1)
    upper = faces[face, k, i] * (1.0 - s) + faces[face, k, right] * s
    lower = faces[face, below, i] * (1.0 - s) + faces[face, below, right] * s
    found: np.ndarray = upper * (1.0 - t) + lower * t
    return found


def map_of_harmonics(irradiance: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return the (H, W, 3) float32 equirectangular radiance map whose irradiance has the coefficients (9, 3) of three bands.

    Negative radiance is clamped to 0, and the rest is scaled down so that the mean is right. turn: as for `map_of_faces`.
    """
    d = texel_directions(_ROWS, 2 * _ROWS) @ turn.T
    radiance = harmonics(d) @ (irradiance / _COSINE[:, None])
    area = solid_angles(_ROWS, 2 * _ROWS)[:, None, None]
    kept = np.maximum(radiance, 0.0)
    before, after = np.maximum((radiance * area).sum((0, 1)), 0.0), (kept * area).sum((0, 1))
    found: np.ndarray = kept * np.divide(before, after, out=np.zeros(3), where=after > 0.0)
    return found.astype(np.float32)


def harmonics(directions: np.ndarray) -> np.ndarray:
    """Return (…, 9) real spherical harmonics of bands 0 to 2 in unit directions (…, 3), in the order of Ramamoorthi and Hanrahan
    2001, eq. 3: 00, 1−1, 10, 11, 2−2, 2−1, 20, 21, 22."""
    x, y, z = np.moveaxis(directions, -1, 0)
    one = np.full(x.shape, 0.282095)
    first = [0.488603 * y, 0.488603 * z, 0.488603 * x]
    second = [1.092548 * x * y, 1.092548 * y * z, 0.315392 * (3.0 * z * z - 1.0), 1.092548 * x * z, 0.546274 * (x * x - y * y)]
    return np.stack([one, *first, *second], axis=-1)
